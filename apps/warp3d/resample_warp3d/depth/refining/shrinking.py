"""Find the small map that a map was enlarged from, bilinearly or bicubically.

Interpolation is linear, so the small map that fits best follows from least squares, axis by axis.
Only a map that was enlarged is what its small map is enlarged to.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles, Floats
from resample_warp3d.depth.refining.inspecting import depth_of

if TYPE_CHECKING:
    from scipy.sparse import csr_array

LARGEST = 8  # times, largest bicubic enlargement that is found: of more, colors tell too little
LARGEST_LINEAR = 2  # times: wider ramps without overshoot are sharpened at least as well
LEAST_SIDE = 16  # samples of a small map
TRIED, LINES = 4, 64  # lines that are tried first, and then
OFF = 2e-4  # of the range: values farther off were not interpolated
FEW = 5e-3  # share of such values in enlarged maps, some of which were clipped
SHARPNESS = -0.75  # of bicubic interpolation, as of OpenCV
BAND = 3  # samples that a sample shares interpolated values with
MEANS = 3  # most means of two surfaces in a row
JUMP = 0.05  # of the larger value: least difference of two surfaces
PART = 0.1  # of this difference: a mean differs by more from both
STEEP = 2.0  # times what the slopes beside them explain: least difference of two surfaces
AROUND = 2  # samples around a mean among which its surface is looked for
DISTANT = 0.02  # of the value, per sample: what a more distant one must be more similar

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class SmallMap:
    """The map that a map was enlarged from."""

    values: Floats  # (h, w) depth or nearness
    is_depth: bool
    side: int  # enlargement


def small_map(nearness: Floats) -> SmallMap | None:
    """Return the map that a map was enlarged from; None if none is found."""
    for is_depth in (False, True):
        values = depth_of(nearness) if is_depth else nearness
        for is_cubic in (False, True):
            for side in range(LARGEST if is_cubic else LARGEST_LINEAR, 1, -1):
                if _is_met(values, side, is_cubic) and _is_met(values.T, side, is_cubic):
                    thin = _fitted(values, side, is_cubic)
                    small = _fitted(thin.T, side, is_cubic).T
                    return SmallMap(np.ascontiguousarray(small, np.float32), is_depth, side)
    return None


def _is_met(values: Floats, side: int, is_cubic: bool) -> bool:
    """Whether some rows are what the best fitting short ones are enlarged to."""
    if values.shape[1] // side < LEAST_SIDE:
        return False
    for count in (TRIED, LINES):
        some = values[:: max(1, len(values) // count)].astype(np.float64)
        short = _fitted(some, side, is_cubic)
        off = np.abs((_interpolation(some.shape[1], side, is_cubic) @ short.T).T - some)
        if np.mean(off > OFF * np.ptp(some)) > FEW:
            return False
    return True


def _fitted(rows: Floats | Doubles, side: int, is_cubic: bool) -> Doubles:
    """Return the short rows (H, w) that, enlarged, fit rows (H, W) best."""
    from scipy.linalg import solveh_banded

    matrix = _interpolation(rows.shape[1], side, is_cubic)
    normal = matrix.T @ matrix
    bands = np.zeros((BAND + 1, matrix.shape[1]))
    for n in range(BAND + 1):
        bands[BAND - n, n:] = normal.diagonal(n)
    return np.asarray(solveh_banded(bands, matrix.T @ rows.T).T)


def _interpolation(count: int, side: int, is_cubic: bool) -> "csr_array":
    """Return the weights (W, w) of the samples in the values interpolated between them."""
    from scipy.sparse import csr_array

    few = count // side
    place = (np.arange(count) + 0.5) * few / count - 0.5
    first = np.floor(place)
    taps = np.arange(-1, 3) if is_cubic else np.arange(2)
    sample = first[:, None] + taps
    away = np.abs(place[:, None] - sample)
    weight = 1.0 - away
    if is_cubic:  # Keys's kernel
        a = SHARPNESS
        near = ((a + 2.0) * away - (a + 3.0)) * away**2 + 1.0
        far = a * (((away - 5.0) * away + 8.0) * away - 4.0)
        weight = np.where(away <= 1.0, near, far)
    column = np.clip(sample, 0, few - 1).astype(np.int64)
    row = np.repeat(np.arange(count), taps.size)
    return csr_array((weight.ravel(), (row, column.ravel())), shape=(count, few))


def enlarged_linearly(small: SmallMap, shape: tuple[int, int]) -> Floats:
    """Return the nearness that bilinear enlargement of a small map leads to."""
    import cv2

    soft = cv2.resize(small.values, shape[::-1], interpolation=cv2.INTER_LINEAR)
    return depth_of(soft) if small.is_depth else np.asarray(soft)


def parted(values: Floats) -> tuple[Floats, Mask]:
    """Assign means of two surfaces to the more similar one; also return where they were."""
    is_mean = _means(values)
    found, least = values.copy(), np.full(values.shape, np.inf)
    for down in range(-AROUND, AROUND + 1):
        for across in range(-AROUND, AROUND + 1):
            there = _moved(_moved(values, down, 0), across, 1)
            price = np.abs(there - values) + DISTANT * np.hypot(down, across) * values
            is_better = is_mean & (price < least)
            is_better &= ~_moved(_moved(is_mean, down, 0), across, 1)
            found[is_better], least[is_better] = there[is_better], price[is_better]
    return found, is_mean


def _means(values: Floats) -> Mask:
    """Return which samples lie between two surfaces, along rows or columns."""
    found = np.zeros(values.shape, np.bool_)
    for axis in (0, 1):
        for count in range(1, MEANS + 1):
            line = [_moved(values, n, axis) for n in range(-2, count + 2)]
            steps = np.diff(np.stack(line), axis=0)
            inner, outer = steps[1:-1], np.abs(steps[[0, -1]]).max(axis=0)
            jump = inner.sum(axis=0)
            is_run = np.abs(jump) > JUMP * np.maximum(line[1], line[-2])
            is_run &= np.abs(jump) > STEEP * (count + 1) * outer
            is_run &= (inner * np.sign(jump) > PART * np.abs(jump)).all(axis=0)
            for n in range(count):
                found |= _moved(is_run, -n, axis)
    return found


def _moved(values: NDArray[Any], by: int, axis: int) -> NDArray[Any]:
    """Return the values that lie `by` samples ahead along an axis; the last are repeated."""
    place = np.clip(np.arange(values.shape[axis]) + by, 0, values.shape[axis] - 1)
    return np.take(values, place, axis)
