"""Pictures on sub-pixels, strip by strip, under a pixel filter: composited first, filtered last."""

from collections.abc import Callable

import numpy as np

from resample.profiles.subpixels import Strip, Subpixels
from resample.progress import Progress
from resample.types import Film, Floats, View


def painted_on_subpixels(
    paint: Callable[[View, tuple[int, int]], Film],
    view: View,
    size: tuple[int, int],
    parts: Subpixels,
    progress: Progress | None,
) -> Film:
    """Picture of a size (height, width); `paint` gives one of sub-pixels, by a view of these."""
    from resample.engine.surfaces.resolve import resolve_rows

    rgba, coverage, depth = (np.empty((*size, count), np.float32) for count in (4, 1, 1))
    first = np.empty(size, np.float32)
    mean = np.full(parts.count, 1.0 / parts.count, np.float32)
    for strip in parts.strips(size):
        fine, rows = paint(_seen_by(view, strip), strip.shape), slice(strip.first, strip.last)
        resolve_rows(fine.rgba.reshape(len(fine.rgba), -1), parts.weight, parts.count, rgba[rows])
        resolve_rows(fine.coverage, parts.weight, parts.count, coverage[rows])
        # Depths are of a pixel's own square, by what is seen of them.
        alpha, own = fine.rgba[..., 3], np.empty((strip.last - strip.first, size[1], 2), np.float32)
        inner = _without_margin(parts, strip)
        far = np.where(alpha > 0, fine.depth, 0) * alpha
        stack = np.stack([far[inner], alpha[inner]], axis=-1)
        resolve_rows(stack.reshape(len(stack), -1), mean, parts.count, own)
        with np.errstate(divide="ignore", invalid="ignore"):
            depth[rows, :, 0] = np.where(own[..., 1] > 0, own[..., 0] / own[..., 1], np.inf)
        first[rows] = _least(fine.first_depth[inner], parts.count)
        if progress is not None:
            progress(strip.last / size[0])
    # Lobes of filters are negative beside what is bright.
    rgba[..., 3] = np.clip(rgba[..., 3], 0, 1)
    np.maximum(rgba[..., :3], 0, out=rgba[..., :3])
    return Film(rgba, depth[..., 0], first, np.clip(coverage[..., 0], 0, 1))


def _seen_by(view: View, strip: Strip) -> View:
    """View whose pixels are a strip's sub-pixels."""
    (n, _, left), (_, _, top) = strip.matrix[:2]
    return view._replace(focal=n * view.focal, principal=n * view.principal + [left, top])


def _without_margin(parts: Subpixels, strip: Strip) -> tuple[slice, slice]:
    """Return the rows and columns of a strip's own pixels."""
    around = parts.margin * parts.count
    return slice(around, strip.shape[0] - around), slice(around, strip.shape[1] - around)


def _least(fine: Floats, n: int) -> Floats:
    """Smallest of each pixel's n × n sub-pixels."""
    height, width = fine.shape
    return np.asarray(fine.reshape(height // n, n, width // n, n).min(axis=(1, 3)))
