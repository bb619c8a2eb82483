"""Warps as differentiable functions of PyTorch's tensors.

`pip install hybrid-resample-gradients[torch]` brings PyTorch. Everything is computed on the CPU in
float64 by `LinearWarp`, whatever the tensors' type and device. Gradients are exact; second
derivatives are not available.
"""

from collections.abc import Callable
from typing import Any, Unpack

import numpy as np
import torch
from torch.autograd.function import once_differentiable

from resample.calling import takes
from resample.types import Doubles
from resample_gradients.places import MapPlaces, MatrixPlaces
from resample_gradients.warping import LinearWarp, Places
from resample_texture.types import AnyEdge, PlaceOptions

LINEAR = "area-spline:limit=none"
Maker = Callable[[Doubles], Places]
Tensor = Any

__all__ = ["warp", "warp_by_map"]


@takes(PlaceOptions)
def warp(
    image: Tensor,
    matrix: Tensor,
    shape: tuple[int, int],
    *,
    interpolation: Any = LINEAR,
    edge: AnyEdge = "transparent",
    quality: float = 1.0,
    threads: int | None = None,
    **options: Unpack[PlaceOptions],
) -> Tensor:
    """Warp pictures by a matrix, differentiable with respect to both.

    Values are filtered as given: neither encoded nor divided by the coverage. The coverage is the
    warp of a picture of ones.

    Parameters
    ----------
    image
        (N, C, H, W) float32 or float64.
    matrix
        (3, 3) homography or (2, 3) affine map from source to target, for all pictures, or one for
        each, (N, 3, 3) or (N, 2, 3).
    shape
        Height and width of the target, px.
    interpolation, edge, quality, threads
        As `LinearWarp` takes them.
    options
        `convention` and `inverse`, as `MatrixPlaces` takes them.

    Returns
    -------
    (N, C, height, width) of the image's type and device.

    Raises
    ------
    ValueError, LookupError
        A tensor, size or choice cannot be worked with.
    """
    _check_image(image)
    _check_geometry(matrix, image, 2, "a matrix has the shape (3, 3) or (N, 3, 3)")
    source_shape = int(image.shape[2]), int(image.shape[3])

    def made(one: Doubles) -> MatrixPlaces:
        return MatrixPlaces(one, shape, source_shape, **options)

    chosen = LinearWarp(interpolation, edge, quality, threads)
    return _Warp.apply(image, matrix, made, chosen)


def warp_by_map(
    image: Tensor,
    places: Tensor,
    *,
    interpolation: Any = LINEAR,
    edge: AnyEdge = "transparent",
    quality: float = 1.0,
    threads: int | None = None,
) -> Tensor:
    """Warp pictures by a backward map, differentiable with respect to both.

    Parameters
    ----------
    image
        (N, C, H, W) float32 or float64.
    places
        (height, width, 2) or (N, height, width, 2): x and y in the source of every pixel's center,
        px; the first texel's center is at (0.5, 0.5). Of the `grid` of `grid_sample` without
        `align_corners` it is `(grid + 1) / 2 * torch.tensor([W, H])`. Not a number (nan) where a
        pixel shows nothing.
    interpolation, edge, quality, threads
        As `LinearWarp` takes them.

    Returns
    -------
    (N, C, height, width) of the image's type and device.

    Raises
    ------
    ValueError, LookupError
        A tensor or choice cannot be worked with.
    """
    _check_image(image)
    _check_geometry(places, image, 3, "a map has the shape (height, width, 2) or (N, ..., 2)")
    if places.shape[-1] != 2:
        raise ValueError(f"a map holds x and y of each pixel, not {places.shape[-1]} numbers")

    def made(one: Doubles) -> MapPlaces:
        return MapPlaces(one[..., 0], one[..., 1])

    return _Warp.apply(image, places, made, LinearWarp(interpolation, edge, quality, threads))


class _Warp(torch.autograd.Function):  # type: ignore[misc]
    """A warp and its gradients, as autograd calls them."""

    @staticmethod
    def forward(
        ctx: Any, image: Tensor, geometry: Tensor, made: Maker, chosen: LinearWarp
    ) -> Tensor:
        ctx.save_for_backward(image, geometry)
        ctx.made, ctx.chosen = made, chosen
        is_shared = _is_shared(geometry)
        pictures = [
            chosen(picture, made(one), axis=-1)
            for picture, one in zip(_pictures(image, is_shared), _geometries(geometry), strict=True)
        ]
        return _as_tensor(_batch(pictures, image.shape[1]), image)

    @staticmethod
    @once_differentiable  # type: ignore[untyped-decorator]
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        image, geometry = ctx.saved_tensors
        is_shared = _is_shared(geometry)
        places = [ctx.made(one) for one in _geometries(geometry)]
        given = _pictures(gradient, is_shared)
        by_image = by_geometry = None
        if ctx.needs_input_grad[0]:
            size = int(image.shape[2]), int(image.shape[3])
            pairs = zip(given, places, strict=True)
            texels = [ctx.chosen.by_image(one, at, size) for one, at in pairs]
            by_image = _as_tensor(_batch(texels, image.shape[1]), image)
        if ctx.needs_input_grad[1]:
            triples = zip(given, _pictures(image, is_shared), places, strict=True)
            each = [ctx.chosen.by_places(one, texels, at) for one, texels, at in triples]
            by_geometry = _as_tensor(each[0] if is_shared else np.stack(each), geometry)
        return by_image, by_geometry, None, None


def _is_shared(geometry: Tensor) -> bool:
    """Tell whether one matrix (3, 3) or map (h, w, 2) serves all pictures."""
    return bool(geometry.ndim == 2 or (geometry.ndim == 3 and geometry.shape[-1] == 2))


def _geometries(geometry: Tensor) -> list[Doubles]:
    """Return the matrix or map of all pictures, or one of each."""
    array = _as_array(geometry)
    return [array] if _is_shared(geometry) else list(array)


def _pictures(tensor: Tensor, is_shared: bool) -> list[Doubles]:
    """Split (N, C, H, W) into pictures (H, W, C), or make it one of N × C channels."""
    array = np.moveaxis(_as_array(tensor), (2, 3), (0, 1))  # (H, W, N, C)
    if is_shared:
        return [np.ascontiguousarray(array.reshape(*array.shape[:2], -1))]
    return [np.ascontiguousarray(array[:, :, n]) for n in range(array.shape[2])]


def _batch(pictures: list[Doubles], channels: int) -> Doubles:
    """Stack what `_pictures` returned into (N, C, H, W)."""
    shape = pictures[0].shape[:2]
    flat = np.concatenate(pictures, axis=2).reshape(*shape, -1, channels)
    return np.moveaxis(flat, (0, 1), (2, 3))


def _as_array(tensor: Tensor) -> Doubles:
    """Copy a tensor from any device into a float64 array."""
    return np.array(np.from_dlpack(tensor.detach().cpu()), np.float64)


def _as_tensor(array: Doubles, like: Tensor) -> Tensor:
    """Convert an array to a tensor of another's type and device."""
    return torch.from_dlpack(np.ascontiguousarray(array)).to(device=like.device, dtype=like.dtype)


def _check_image(image: Tensor) -> None:
    if image.ndim != 4 or image.numel() == 0 or image.dtype not in (torch.float32, torch.float64):
        raise ValueError(
            f"an image is float32 or float64 of (N, C, H, W), not {image.dtype} "
            f"of {tuple(image.shape)}"
        )


def _check_geometry(geometry: Tensor, image: Tensor, dimensions: int, shapes: str) -> None:
    """Refuse a geometry that is neither one for all pictures nor one for each."""
    many = geometry.ndim == dimensions + 1 and geometry.shape[0] == image.shape[0]
    if not (many or geometry.ndim == dimensions) or not geometry.is_floating_point():
        raise ValueError(
            f"{shapes}, of floats; not {geometry.dtype} of {tuple(geometry.shape)} for "
            f"{image.shape[0]} pictures"
        )
