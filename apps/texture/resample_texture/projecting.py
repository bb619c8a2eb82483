"""Convert pictures between projections: panoramas, cube maps, fisheyes, flat views."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from resample import registry
from resample.files.exchange.inputs import picture_and_encoding
from resample_texture.arguments import check_shape, whole_pair
from resample_texture.geometry.mappings import BackwardMap
from resample_texture.geometry.projections import Projection, rotation, source_tiles
from resample_texture.types import Warped
from resample_texture.warping import warp


def project(
    image: Any,
    source: str | Projection,
    target: str | Projection,
    shape: tuple[int, int],
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0),
    **choices: Any,
) -> Warped:
    """Show a picture of one projection in another, antialiased and without seams.

    Parameters
    ----------
    image
        As `warp` takes it, but no batch.
    source, target
        Projection of the picture and of the result, by name or as an object: `equirectangular`,
        `cubemap:layout=row`, `fisheye:fov=180,model=equidistant`, `stereographic:fov=240`,
        `cylindrical:fov=360` or `perspective:fov=90`.
    shape
        Height and width of the result, px.
    turn
        Degrees by which the result looks to the right, up, and turns clockwise.
    choices
        Options of `warp`: `method`, `interpolation`, `linear_light`, `fill`, `threads` ...

    Raises
    ------
    ValueError, LookupError
        A size does not fit its projection, an angle is none, or as `warp` does.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_texture import project
    >>> panorama = np.full((64, 128, 3), 200, np.uint8)
    >>> project(panorama, "equirectangular", "perspective:fov=70", (48, 64), turn=(30, 10, 0))
    Warped(48 × 64 × 3 uint8, 100 % covered)
    >>> project(panorama, "equirectangular", "fisheye:fov=220", (64, 64))
    Warped(64 × 64 × 3 uint8, 78.8 % covered)
    """
    picture, is_encoded = picture_and_encoding(image)
    if picture.ndim not in (2, 3):
        raise ValueError(f"a picture is (H, W) or (H, W, C), not {picture.shape}")
    shape = whole_pair(shape, "height", "width")
    check_shape(shape)
    before, after = _projection(source), _projection(target)
    before.check((picture.shape[0], picture.shape[1]))
    after.check(shape)
    choices.setdefault("linear_light", is_encoded)
    turned = rotation(turn)
    made: Warped | None = None
    for n, (left, top, width, height) in enumerate(after.tiles(shape)):
        # One pixel more on each side tells how large those at the sides are.
        y, x = np.mgrid[top - 1 : top + height + 1, left - 1 : left + width + 1] + 0.5
        place = np.stack([x, y], axis=-1)
        ray = after.rays(place, shape, n) @ turned.T
        part = _drawn(picture, before, ray, choices)
        made = _background(part, shape) if made is None else made
        is_shown, here = (
            after.shows(place[1:-1, 1:-1], shape),
            np.s_[top : top + height, left : left + width],
        )
        made.image[here][is_shown] = part.image[is_shown]
        made.coverage[here][is_shown] = part.coverage[is_shown]
    assert made is not None
    return made


def _projection(given: str | Projection) -> Projection:
    """Return a projection by name, or as given."""
    found: Projection = registry.build("projections", given) if isinstance(given, str) else given
    return found


def _background(part: Warped, shape: tuple[int, int]) -> Warped:
    """Return a picture of nothing, of the type and with the fill of a part."""
    image = part.image
    is_measured = image.dtype.kind == "f" and not part.is_premultiplied
    form = (*shape, *image.shape[2:])
    empty: NDArray[Any] = np.full(form, np.nan if is_measured else 0, image.dtype)
    if isinstance(image, np.ma.MaskedArray):
        empty = np.ma.MaskedArray(empty, np.ones(form, np.bool_), fill_value=image.fill_value)
    return type(part)(empty, np.zeros(shape, np.float32))


def _step(ray: NDArray[Any]) -> float:
    """Angle between neighbouring directions (h, w, 3), rad, at most."""
    unit = ray / np.linalg.norm(ray, axis=-1, keepdims=True)
    steps = [np.linalg.norm(np.diff(unit, axis=axis), axis=-1) for axis in (0, 1)]
    return max(float(np.nanmax(step, initial=0.0)) for step in steps)


def _drawn(
    picture: NDArray[Any], before: Projection, ray: NDArray[Any], choices: dict[str, Any]
) -> Warped:
    """Draw what directions (h, w, 3) show."""
    form, made = (ray.shape[0], ray.shape[1]), None
    inner, roi = np.s_[1:-1, 1:-1], (1, 1, form[1] - 2, form[0] - 2)
    for image, places, shows, is_endless in source_tiles(picture, before, _step(ray)):
        is_here = shows(ray)
        around = ndimage.binary_dilation(is_here, np.ones((3, 3), np.bool_))
        place = np.where(around[..., None], places(ray), np.nan)
        lookup, edge = (
            BackwardMap(place[..., 0], place[..., 1]),
            "wrap" if is_endless else "transparent",
        )
        part = warp(image, lookup, form, edge=edge, roi=roi, **choices)
        if made is None:
            made = part
        there = is_here[inner]
        made.image[there], made.coverage[there] = part.image[there], part.coverage[there]
    assert made is not None
    return made
