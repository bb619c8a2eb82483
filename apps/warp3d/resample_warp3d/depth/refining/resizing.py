"""Resize depth maps: to their pictures' size surface by surface, and smaller by means."""

from collections.abc import Callable

import numpy as np

from resample.types import Floats
from resample_warp3d.depth.refining.enlargement import Axis
from resample_warp3d.depth.refining.inspecting import is_sharpened, is_sparse, linked, quantum_of
from resample_warp3d.types import DepthImage

PROPORTION = 0.02  # by which the aspect ratios of depth and color may differ


def fitted(image: DepthImage, is_soft: Callable[[Floats], bool] = is_sharpened) -> DepthImage:
    """Enlarge a depth image's depth to the size of its color.

    Soft edges, as from networks, stay smooth for refinement, which finds them by color; others are
    kept apart, surface by surface. `is_soft` tells of nearness without gaps.
    """
    height, width = image.nearness.shape
    shape = image.color.shape[0], image.color.shape[1]
    if (height, width) == shape:
        return image
    rows, columns = height / shape[0], width / shape[1]
    if abs(rows / columns - 1.0) > PROPORTION:
        raise ValueError(
            f"color of {shape[1]} × {shape[0]} px does not fit depth of {width} × {height} px; "
            "give maps of the same frame, with the same aspect ratio"
        )
    is_known = np.isfinite(image.nearness) & (image.nearness > 0)
    nearness = np.where(is_known, image.nearness, np.float32(0))
    if is_sparse(nearness):
        return image._replace(nearness=spread(nearness, shape))
    if rows < 1.0 and is_known.all() and is_soft(nearness):
        import cv2

        smooth = cv2.resize(nearness, shape[::-1], interpolation=cv2.INTER_LINEAR)
        return image._replace(nearness=np.asarray(smooth, np.float32))
    return image._replace(nearness=enlarged(nearness, shape))


def enlarged(
    nearness: Floats, shape: tuple[int, int], axes: tuple[Axis, Axis] | None = None
) -> Floats:
    """Enlarge a map, surface by surface.

    `nearness`: (h, w); 0 where unknown. `axes`: where its rows and columns lie in the result; by
    default both show the same frame.
    """
    from resample_warp3d.depth.refining.kernels.voting import enlarge_rows

    small = np.ascontiguousarray(nearness, np.float32)
    result = np.empty(shape, np.float32)
    ratio = small.shape[0] / shape[0], small.shape[1] / shape[1]
    places = axes or [Axis(step, 0.5 * step - 0.5) for step in ratio]
    enlarge_rows(small, linked(small, quantum_of(small), 0.0), np.array(places).ravel(), result)
    return result


def spread(nearness: Floats, shape: tuple[int, int]) -> Floats:
    """Move the samples of a sparse map to the pixels of another size that contain their centers."""
    row, column = np.nonzero(nearness)
    found = np.zeros(shape, np.float32)
    rows, columns = (
        ((place + 0.5) * size / count).astype(np.int64)
        for place, size, count in zip((row, column), shape, nearness.shape, strict=True)
    )
    found[rows, columns] = nearness[row, column]
    return found


def reduced(values: Floats, shape: tuple[int, int]) -> Floats:
    """Reduce an array (H, W) or (H, W, C) to the means of areas."""
    import cv2

    found = cv2.resize(values, shape[::-1], interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(found.reshape(*shape, *values.shape[2:]), np.float32)


def reduced_known(values: Floats, shape: tuple[int, int]) -> Floats:
    """Reduce nearness or depth to the means of known values, 0 where less than half is known."""
    share = reduced((values > 0).astype(np.float32), shape)
    mean = reduced(values, shape) / np.maximum(share, np.float32(0.5))
    return np.where(share >= 0.5, mean, np.float32(0))
