"""Any way to warp under any pixel filter: painted on parts of pixels, composited, filtered last.

A pixel's color and coverage are filtered alike. Its depth and
magnification come from its own square, under any filter: the middle by nearness of its parts.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from resample.profiles.filters import PixelFilter
from resample.profiles.subpixels import Strip, Subpixels, subpixels_of
from resample.types import Floats
from resample_warp3d.methods.hybrid import Hybrid, empty
from resample_warp3d.projection_models import Way
from resample_warp3d.sheet.filling import bridged
from resample_warp3d.types import Method, Rendered, Source

WayMethod = Callable[[Source, Any, tuple[int, int]], Rendered]  # along a way that the method knows

TRACE = 1e-4  # coverage below which a pixel is empty


def filtered(
    method: Method,
    pixel_filter: PixelFilter,
    source: Source,
    equation: Way,
    shape: tuple[int, int],
) -> Rendered:
    """Warp a prepared source into a frame of (height, width) px under a pixel filter."""
    parts = subpixels_of(pixel_filter)
    if parts.weight.size == 1:  # the mean over a pixel's square, as all methods have it
        look: WayMethod = method
        return look(source, equation, shape)
    check_method(method)
    image, coverage, squares = _painted(method, parts, source, equation, shape)
    # Cover at most all of a pixel; light goes with the coverage, so that what has one color keeps
    # it where filters with negative weights overshoot.
    total = coverage[..., 0]
    is_seen, is_whole = total > TRACE, getattr(method, "is_whole", False)
    share = np.where(is_seen, np.float32(1) if is_whole else np.minimum(total, 1), 0)
    scale = np.divide(share, total, out=np.zeros_like(total), where=is_seen)
    # Pixels whose own squares are empty are as far as the nearest pixel that the filter reads.
    margin, (nearness, magnification) = parts.margin, np.zeros((2, *shape), np.float32)
    steps = np.arange(-margin, margin + 1)
    offsets = sorted(
        ((int(y), int(x)) for y in steps for x in steps), key=lambda at: at[0] ** 2 + at[1] ** 2
    )
    for down, right in offsets:
        missing = is_seen & (nearness <= 0)
        if not missing.any():
            break
        there = _inner(margin, shape, down, right)
        nearness[missing] = squares.nearness[there][missing]
        magnification[missing] = squares.magnification[there][missing]
    return Rendered(
        image * scale[..., None].astype(np.float32), share.astype(np.float32), nearness,
        magnification, squares.bridged[_inner(margin, shape)] & is_seen,
    )  # fmt: skip


def check_method(method: Method) -> None:
    """Reject methods that do not support filters."""
    if getattr(method, "is_per_pixel", False):
        name = type(method).__name__
        raise ValueError(f"{name} copies samples to whole pixels; leave out the pixel filter")
    if getattr(method, "labels", False):
        raise ValueError("labels are not mixed; leave out the pixel filter")


def _painted(
    method: Method, parts: Subpixels, source: Source, equation: Way, shape: tuple[int, int]
) -> tuple[Floats, Floats, Rendered]:
    """Filter what a method paints on sub-pixels: image, coverage, and squares with the margin."""
    from resample.engine.surfaces import resolve_rows

    paint: WayMethod = method.layers if isinstance(method, Hybrid) else method
    around = shape[0] + 2 * parts.margin, shape[1] + 2 * parts.margin
    channels = source.color.shape[2]
    image, coverage = (np.empty((*shape, count), np.float32) for count in (channels, 1))
    squares = empty(around, channels)
    for strip in parts.strips(shape):
        fine = paint(source, equation.in_frame(strip.matrix), strip.shape)
        rows = slice(strip.first, strip.last)
        resolve_rows(_flat(fine.image), parts.weight, parts.count, image[rows])
        resolve_rows(fine.coverage, parts.weight, parts.count, coverage[rows])
        _show_squares(fine, parts, strip, squares)
    if not isinstance(method, Hybrid):
        return image, coverage, squares
    # What closes a narrow gap lies evenly over its pixel, and is filtered like all else.
    closed = bridged(squares._replace(image=squares.image.copy(), nearness=squares.nearness.copy()))
    for picture, before, after in (
        (image, squares.image, closed.image), (coverage, squares.coverage, closed.coverage)
    ):  # fmt: skip
        more = np.empty_like(picture)
        resolve_rows(_flat(after - before), parts.per_pixel, 1, more)
        picture[:] = picture + more
    return image, coverage, closed


def _show_squares(fine: Rendered, parts: Subpixels, strip: Strip, squares: Rendered) -> None:
    """Fill in the surfaces in the own squares of a strip's pixels and those around it."""
    from resample.engine.surfaces import middle_of_rows, resolve_rows

    n, rows = parts.count, slice(strip.first, strip.last + 2 * parts.margin)
    mean = np.full(n, 1.0 / n, np.float32)
    resolve_rows(_flat(fine.image), mean, n, squares.image[rows])
    resolve_rows(fine.coverage, mean, n, squares.coverage[rows][..., None])
    middle_of_rows(
        fine.nearness, fine.magnification, n, squares.nearness[rows], squares.magnification[rows]
    )
    squares.magnification[rows] /= np.float32(n * n)
    height, width = squares.bridged[rows].shape
    bridges = fine.bridged.reshape(height, n, width, n).sum(axis=(1, 3))
    seen = (fine.coverage > 0).reshape(height, n, width, n).sum(axis=(1, 3))
    squares.bridged[rows] = (bridges > 0) & (2 * bridges >= seen)


def _inner(
    margin: int, shape: tuple[int, ...], down: int = 0, right: int = 0
) -> tuple[slice, slice]:
    """Slices of a picture, moved by some pixels, in its surroundings."""
    top, left = margin + down, margin + right
    return slice(top, top + shape[0]), slice(left, left + shape[1])


def _flat(picture: Floats) -> Floats:
    """Picture (H, W[, C]) with channels side by side, (H, W C)."""
    return np.ascontiguousarray(picture.reshape(picture.shape[0], -1))
