"""Inspect depth maps: valid samples, quantization, noise, links between samples, defects.

Everything is measured: soft edges span several samples, displaced ones run beside edges of the
picture, and enlarged maps change only every few samples.
"""

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles, Floats
from resample_warp3d.types import DepthImage, Links

if TYPE_CHECKING:
    from resample_warp3d.depth.refining.kernels.ramps import Edges

CLEAR = 0.1  # relative nearness: least jump examined
REACHES = (4, 8, 16, 32, 64)  # px within which edges are looked for, the nearest first
WIDE = 1.7  # px: edges this wide from 10 to 90 % are soft
MANY_SOFT = 0.5  # share of soft edges from which a map is soft
FAINT = 0.8  # px, standard deviation of a blur below which edges count as hard
SHARPEST = 0.8  # px, width of a hard edge between two samples
LARGE = 0.25  # of the larger value: jumps with measured skew
LITTLE = 0.05  # of an edge's steepest step: smaller ones do not count in its skew
BLUR_WIDTH = 2.563  # from 10 to 90 % of a blurred edge, standard deviations
EXAMINED = 1 << 17  # samples along each axis whose edges are measured
BESIDE = 2  # px around a measured edge where no wider window measures another
SOFTEST = 5.0  # px, deviation of a blur beyond which colors no longer tell where edges were
WIDEST = 2.7  # px: the same of edges with overshoot, and of edges that votes reach across
OVERSHOOT = 0.02  # of the jump: edges exceed both of their sides by more in sharpened maps
DISPLACED = 0.8  # of the largest color change near edges: with less at them, edges are displaced
HOLEY = 1e-3  # share of samples without depth from which they are filled
RENDERED = 3e-4  # relative nearness: noise and steps up to which depth counts as computed
SPARSE = 0.3  # share of known samples below which a map may be sparse
MANY_ALONE = 0.5  # share of samples without neighbours along an axis from which it is
FEWEST_SAMPLES = 64  # of a sparse map
MANY_GAPS = 50  # of a map; a sky visible through objects makes fewer
FEW = 100  # edges; fewer are not evaluated
CLOSE = 6  # px on each side of an edge where colors are compared with those at it
UNSHIFTED = 0.85  # of the largest color change: with more at edges, the map is not shifted
HARDLY = 0.8  # px, offset up to which a map is not shifted
APART = 0.75  # px that a map with an offset may be too wide or too narrow
CONTRAST = 1.5  # least ratio of color change near edges to that farther away
MOST_EDGES = 1 << 16
USUAL = 0.5587  # mean of the lower 80 % of |x|, x normal with deviation 1
FLAT = 2e-3  # relative nearness: smaller jumps are not edges
FEWEST, MOST = 8, 4096  # distinct values of a coarse map; fewer are a scene of few flat objects
MANY = 1 << 16  # samples; of larger maps a quarter is examined
LEVEL = 0.2  # share of neighbours, along both axes, with equal values in a coarse map
COARSEST = 0.02  # of the largest nearness: larger steps are between objects


class Findings(NamedTuple):
    """Defects of a depth map."""

    soft: float  # share of its edges that span several samples
    sigma: float  # px, standard deviation of the blur of its edges
    is_depth: bool  # depth was blurred, not nearness
    aligned: float  # color change at edges, of the largest beside them; 1: not measurable
    unknown: float  # share of its samples without depth
    is_measured: bool  # noisy, quantized or full of gaps: unknown samples were lost, not empty
    overshoot: float = 0.0  # of the jump, by which soft edges exceed both of their sides
    offset: tuple[float, float] = (0.0, 0.0)  # px right and down, from the map to the picture
    is_sparse: bool = False  # scattered samples, or lines of them
    enlargement: float = 1.0  # times, by which a smaller map was enlarged

    @property
    def is_soft(self) -> bool:
        """Whether edges span several samples."""
        return self.soft > MANY_SOFT and self.sigma > FAINT

    @property
    def shift(self) -> tuple[int, int]:
        """Whole px right and down from the map to the picture, 0 if the map is hardly off."""
        right, down = (round(each) if abs(each) > HARDLY else 0 for each in self.offset)
        return right, down

    @property
    def remedy(self) -> str:
        """Refinement to apply: one of `conditioning.REFINES`, except auto."""
        if self.is_sparse:
            return "densify"
        if self.is_soft and self.sigma <= (WIDEST if self.overshoot > OVERSHOOT else SOFTEST):
            return "sharpen"
        if self.shift != (0, 0):
            return "shift"
        if self.aligned < DISPLACED:
            return "snap"
        return "complete" if self.is_measured and self.unknown > HOLEY else "none"


NOTHING = Findings(0.0, 0.0, False, 1.0, 0.0, False)


def inspect(color: Floats, nearness: Floats, noise: float, step: float) -> Findings:
    """Find the defects of a depth map.

    `color`: (H, W, C) finite. `nearness`: (H, W); 0 where unknown. `step`: quantization step of
    nearness.
    """
    from resample_warp3d.depth.refining.kernels.ramps import Edges

    if is_sparse(nearness):
        unknown = float(np.mean(nearness <= 0))
        return NOTHING._replace(unknown=unknown, is_measured=True, is_sparse=True)
    least = max(CLEAR, 10.0 * noise)
    soft, sigma, is_depth, overshoot = softness_of(nearness, noise, step)
    sharp = edges_of(nearness, Edges(1, 1.0, least, 2.0 * step))
    unknown = float(np.mean(nearness <= 0))
    is_measured = bool(noise > RENDERED or step > RENDERED * nearness.max())
    if not is_measured and np.count_nonzero(nearness <= 0) >= MANY_GAPS:
        import cv2

        is_measured = cv2.connectedComponents((nearness <= 0).astype(np.uint8))[0] > MANY_GAPS
    aligned, offset = _aligned(color, sharp)
    return Findings(soft, sigma, is_depth, aligned, unknown, is_measured, overshoot, offset)


def is_sparse(nearness: Floats) -> bool:
    """Whether most samples are unknown, and most known ones are alone along an axis."""
    is_known = nearness > 0
    count = np.count_nonzero(is_known)
    if not FEWEST_SAMPLES <= count < SPARSE * is_known.size:
        return False
    around = np.pad(is_known, 1)
    is_alone = ~(around[:-2, 1:-1] | around[2:, 1:-1]) | ~(around[1:-1, :-2] | around[1:-1, 2:])
    return bool(np.count_nonzero(is_known & is_alone) > MANY_ALONE * count)


def edges_of(nearness: Floats, edges: "Edges") -> NDArray[np.uint8]:
    """Return the steps of edges (H, W, 2), as `ramps.mark_edges` marks them."""
    from resample_warp3d.depth.refining.kernels.ramps import mark_edges

    mark = np.zeros((*nearness.shape, 2), np.uint8)
    mark_edges(nearness, edges, mark)
    return mark


def is_sharpened(nearness: Floats) -> bool:
    """Return whether the remedy for a map's edges is to sharpen them."""
    soft, sigma, is_depth, overshoot = softness_of(nearness, 0.0, 0.0)
    found = NOTHING._replace(soft=soft, sigma=sigma, is_depth=is_depth, overshoot=overshoot)
    return found.remedy == "sharpen"


def softness_of(nearness: Floats, noise: float, step: float) -> tuple[float, float, bool, float]:
    """Return the share of soft edges, blur, whether depth was blurred, and overshoot.

    A blur is symmetric, so edges are not skewed in the quantity that was blurred.
    """
    least = max(CLEAR, 10.0 * noise) + 2.0 * step / float(nearness.max())
    found = [_edges(values, least) for values in (nearness, depth_of(nearness))]
    if min(map(len, found)) < FEW:
        return 0.0, 0.0, False, 0.0
    # Slopes beside small jumps skew them, too.
    large = [edges[edges[:, 1] > LARGE, 3] for edges in found]
    skew = [abs(float(np.median(each))) if each.size else math.inf for each in large]
    is_depth = skew[1] < skew[0]
    width, _, overshoot, _ = np.median(found[is_depth], axis=0)
    sigma = math.sqrt(max(width**2 - SHARPEST**2, 0.0)) / BLUR_WIDTH
    return float(np.mean(found[0][:, 0] > WIDE)), sigma, is_depth, float(overshoot)


def _edges(values: Floats, least: float) -> Doubles:
    """Return the edges along both axes: width, jump, overshoot and skew, (N, 4).

    The first three are as `softness.measure_widths` writes them. The narrowest window that finds an
    edge measures it.
    """
    from resample_warp3d.depth.refining.kernels.softness import measure_widths

    sparse = max(1, values.size // EXAMINED)
    found = []
    for lines in (values[::sparse], values.T[::sparse]):
        some = np.ascontiguousarray(lines)
        taken = np.zeros(some.shape, np.bool_)
        for reach in REACHES:
            edges: Doubles = np.empty((MOST_EDGES, 5))
            edges = edges[: measure_widths(some, reach, least, edges)]
            row, column = edges[:, 3].astype(np.int64), edges[:, 4].astype(np.int64)
            is_new = ~taken[row, column]
            edges, row, column = edges[is_new], row[is_new], column[is_new]
            around = column[:, None] + np.arange(-reach + 1, reach + 1)
            found.append(np.c_[edges[:, :3], _skews(some[row[:, None], around])])
            for n in range(-BESIDE, BESIDE + 1):
                taken[row, np.clip(column + n, 0, some.shape[1] - 1)] = True
    return np.concatenate(found)


def _skews(windows: Floats) -> Doubles:
    """Return the skew (N,) toward the far side of the steps (N, K) of edges amid windows, px³."""
    step = np.diff(windows.astype(np.float64), axis=1)
    middle = step.shape[1] // 2
    sign = np.sign(step[:, middle])
    step *= sign[:, None]
    step[step < LITTLE * step.max(axis=1, keepdims=True)] = 0.0
    place = np.arange(step.shape[1]) - middle
    total = step.sum(axis=1)
    mean = step @ place / total
    return np.asarray(sign * ((place - mean[:, None]) ** 3 * step).sum(axis=1) / total)


def depth_of(nearness: Floats) -> Floats:
    """Return 1 / nearness, 0 where unknown; converts depth to nearness, too."""
    found = np.zeros_like(nearness)
    np.divide(np.float32(1), nearness, out=found, where=nearness > 0)
    return found


def _aligned(color: Floats, mark: NDArray[np.uint8]) -> tuple[float, tuple[float, float]]:
    """Return the color change at edges, of the largest within a few px, and a common shift.

    The first is 1 if not measurable: few edges, or colors that change equally everywhere.
    """
    from resample_warp3d.depth.refining.kernels.ramps import REACH, profile_edges

    profile, even, count = np.zeros((4, 2 * REACH + 1)), np.zeros((4, 2 * REACH + 1)), np.zeros(4)
    profile_edges(color, mark, profile, even, count)
    # Edges with their near sides at the right and left, below and above.
    right, down = (_common(even[n : n + 2], count[n : n + 2]) for n in (0, 2))
    total = profile[:, REACH - CLOSE : REACH + CLOSE + 1].sum(axis=0)
    if count.sum() < FEW or not total.max() > CONTRAST * np.median(total):
        return 1.0, (right, down)
    beside = np.delete(total, CLOSE)
    return float(total[CLOSE] / max(beside.max(), 1e-30)), (right, down)


def _common(even: Doubles, count: Doubles) -> float:
    """Return the shift along an axis that edges of both sides agree on, px; 0 if it is not clear.

    Where the map is too wide or too narrow, edges of both sides are off in opposite directions.
    """
    middle = even.shape[1] // 2
    lag = [_peak(each) - middle for each in even]
    peak = even.max(axis=1)
    is_clear = (peak > CONTRAST * np.median(even, axis=1)) & (even[:, middle] < UNSHIFTED * peak)
    is_common = abs(lag[0] + lag[1]) < 2.0 * APART and bool(is_clear.all()) and count.min() >= FEW
    return 0.5 * (lag[0] - lag[1]) if is_common else 0.0


def _peak(values: Doubles) -> float:
    """Return where values are largest, by a parabola through three of them."""
    n = min(max(int(values.argmax()), 1), values.size - 2)
    before, here, after = values[n - 1 : n + 2]
    bend = before - 2.0 * here + after
    return float(n + 0.5 * (before - after) / bend) if bend < 0 else float(n)


def known(image: DepthImage) -> Floats:
    """Return the nearness in float32, 0 where it, its position or its color is unknown."""
    nearness = np.ascontiguousarray(image.nearness, np.float32)
    if image.color.ndim != 3 or nearness.shape != image.color.shape[:2]:
        height, width = nearness.shape[:2]
        raise ValueError(
            f"color of {image.color.shape[1]} × {image.color.shape[0]} px does not fit depth of "
            f"{width} × {height} px"
        )
    is_known = np.isfinite(nearness) & (nearness > 0)
    for c in range(image.color.shape[2]):  # ten times as fast as all channels at once
        is_known &= np.isfinite(image.color[..., c])
    if image.place.size:
        is_known &= np.isfinite(image.place).all(axis=2)
    nearness = np.where(is_known, nearness, np.float32(0))
    if not nearness.any():
        raise ValueError("no pixel has a depth; check its unit and its file")
    return nearness


def quantum_of(nearness: Floats) -> float:
    """Return the quantization step of nearness if values are few, as in 8-bit maps; else 0."""
    some = nearness if nearness.size < MANY else nearness[::2, ::2]
    values = np.unique(some[some > 0])
    if not FEWEST <= values.size <= MOST:
        return 0.0
    smallest = float(np.min(np.diff(values)))
    is_flat = min(
        np.mean(nearness[::8, 1:] == nearness[::8, :-1]),
        np.mean(nearness[1:, ::8] == nearness[:-1, ::8]),
    )
    is_coarse = is_flat > LEVEL and smallest < COARSEST * float(values[-1])
    return smallest if is_coarse else 0.0


def linked(nearness: Floats, quantum: float, noise: float) -> Links:
    """Return the links between neighbours on one surface."""
    from resample_warp3d.depth.kernels.linking import join_rows, link_rows

    links = np.zeros(nearness.shape, np.uint8)
    tolerance = np.array([1.5 * quantum, max(FLAT, 6.0 * math.sqrt(2.0) * noise)])
    link_rows(nearness, tolerance, links)
    join_rows(links)
    return links


def noise_of(nearness: Floats, links: Links) -> float:
    """Return the relative standard deviation of the nearness about its surfaces.

    From the mean of all but the largest fifth of absolute second differences. Their deviation is √6
    times that of the noise. A median would miss surfaces that are quantized.
    """
    from resample_warp3d.depth.kernels.linking import curvatures

    sparse = max(1, math.isqrt(nearness.size // 65536))
    curvature: Doubles = np.full([max(1, n // sparse) for n in nearness.shape], np.nan)
    curvatures(nearness, links, sparse, curvature)
    found = np.sort(np.abs(curvature[np.isfinite(curvature)]))
    usual = found[: math.ceil(0.8 * found.size)]
    return float(usual.mean() / USUAL / math.sqrt(6.0)) if usual.size else 0.0
