"""Fields of two values, with thin parts as thick as their voxels.

A cubic spline through samples of two values crosses the middle between them where voxels of both
kinds touch, but it is 1.16 voxels wide across a wall of one voxel, and 1.22 where it overshoots at
the wall's edges. So voxels that differ from both neighbours along an axis get other values.
"""

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from math import prod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import workers
from resample.memory.mapped import array_like, most_of
from resample.painting.choices import MEASURING, Projection
from resample.painting.splines import FIELD, bytes_of_field
from resample.types import Doubles, Flags, Floats
from resample_volume.data.values import require_memory
from resample_volume.types import Volume

# Value, from 0 to 1, of the higher kind by the number of axes along which a voxel is thin: of
# solids, walls (a large one is 1.0 wide seen edge on, 0.9 along one ray), lines (their cross
# section is 1) and points (their volume is 1). The lower kind's share is 1 minus it.
VALUES = (1.0, 0.75, 0.95, 1.1)


def with_true_thickness(values: NDArray[np.generic], two: Doubles) -> tuple[Flags, float, float]:
    """Samples of a spline as thick as the voxels of the higher of two values.

    Result: levels (Z, Y, X) of 8 bits, and the value of level 0 and of a step.
    """
    zero = 1.0 - max(VALUES)
    scale = (max(VALUES) - zero) / np.iinfo(np.uint8).max
    fraction = np.array([1.0 - np.array(VALUES), VALUES])
    table = np.rint((fraction - zero) / scale).astype(np.uint8)
    level = array_like(values, values.shape, np.uint8, FIELD)
    before = here = values[0] == two[1]
    for z in range(len(values)):
        behind = values[z + 1] == two[1] if z + 1 < len(values) else here
        thin = ((here != before) & (here != behind)).astype(np.uint8)
        for axis in (0, 1):
            # Voxels that differ from both neighbours along an axis; at its ends none do
            line, is_thin = np.moveaxis(here, axis, 0), np.zeros(here.shape, bool)
            differs = line[1:] != line[:-1]
            np.moveaxis(is_thin, axis, 0)[1:-1] = differs[1:] & differs[:-1]
            thin += is_thin
        level[z] = table[here.view(np.uint8), thin]
        before, here = here, behind
    span = float(two[1] - two[0])
    return level, float(two[0]) + zero * span, scale * span


BYTES_PER_THIN = 8  # bytes of a sample between thick slices, besides its field
EXTREMES = (Projection.MAXIMUM, Projection.MINIMUM)  # of values that voxels have
THICK = 2.5  # ratio of slice distance to sample distance from which slices are made thin
MOST = 4  # thin slices per thick slice
MOST_SAMPLES = 1 << 26  # type of the thin slices, to save memory
LEAST_SIDE = 16  # samples per side of slices from which flow is computed
SMOOTH = 1.0  # samples, width of the window for differences
UNSURE = 0.2  # of the fourth difference of slices: error bound of a spline
WHITE = 3.4  # ratio of fourth to second differences for noise
GROWTH, SHARP = 4, 4  # exponents of the weights of splines and of fits
SLACK = 0.002  # of the range of values: difference that counts as none
TURNS = 3  # iterations of the search for a flow's start
MOST_TURN = 0.25  # tolerance between the flows before and behind a slice
FINE_SIDE = 320  # samples, of slices with a flow per sample
ASTRAY = 0.05  # of the range of values, per sample by which forward and backward flow disagree
MOST_ASTRAY = np.float32(2.0)  # samples
DARK = 4  # levels of 255, of the least value for optical flow
GROUP = 9  # thick slices processed together

Plane = NDArray[np.float32]


class Thin(NamedTuple):
    """Number of samples per voxel along one axis of the values."""

    axis: int  # 0 is z
    parts: int  # 1: a field of the voxels themselves


SAME = Thin(0, 1)


def thin_of(volume: Volume) -> Thin:
    """Return the method for thin slices; `SAME` if they are near, many, colored or in a file."""
    spacing = np.abs(np.asarray(volume.spacing, np.float64))[::-1]
    axis = int(spacing.argmax())
    within = [n for n in range(3) if n != axis]
    shape = volume.values.shape
    ratio = float(spacing[axis] / spacing[within].max())
    if ratio < THICK or volume.colors is not None or most_of(volume.values) is not None:
        return SAME
    if min(shape[n] for n in within) < LEAST_SIDE or shape[axis] < 2:
        return SAME
    count = min(MOST, round(ratio), MOST_SAMPLES // volume.values.size)
    return Thin(axis, max(1, count))


def thin_that_fits(volume: Volume, projection: Projection, *, stays: bool) -> Thin:
    """Return the method for thin slices, if they fit in memory and rays do not average."""
    is_mean = projection in MEASURING and projection not in EXTREMES
    thin = SAME if is_mean or stays else thin_of(volume)
    for one in dict.fromkeys((thin, SAME)):
        shape, per_thin = of_samples(volume, one).values.shape, BYTES_PER_THIN * (one != SAME)
        size = bytes_of_field(shape, volume.values.dtype, most_of(volume.values))
        try:
            require_memory(size + per_thin * prod(shape), f"{volume.name} as a field")
        except ValueError:
            if one == SAME:
                raise
        else:
            return one
    return SAME


def of_samples(volume: Volume, thin: Thin) -> Volume:
    """Return the lattice of a field's samples as a volume without values."""
    if thin.parts == 1:
        return volume
    across = 2 - thin.axis
    shape, spacing = list(volume.values.shape), np.array(volume.spacing, np.float64)
    shape[thin.axis] *= thin.parts
    spacing[across] /= thin.parts
    shift = np.zeros(3)
    shift[across] = 0.5 * (spacing[across] - volume.spacing[across])
    origin = np.asarray(volume.origin + volume.direction @ shift)
    values = np.broadcast_to(np.zeros((), volume.values.dtype), shape)
    return volume._replace(values=values, spacing=spacing, origin=origin)


def voxels_of(sample: NDArray[np.int64], shape: tuple[int, ...], thin: Thin) -> NDArray[np.int64]:
    """Return flat indices of the voxels (Z, Y, X) of samples; negative: none."""
    if thin.parts == 1:
        return sample
    fine = list(shape)
    fine[thin.axis] *= thin.parts
    place = list(np.unravel_index(np.maximum(sample, 0), fine))
    place[thin.axis] = place[thin.axis] // thin.parts
    return np.where(sample < 0, sample, np.ravel_multi_index(place, shape))


def thinned(values: NDArray[Any], thin: Thin, *, is_within: bool) -> tuple[Floats, float]:
    """Compute samples of thin slices minus the least value, and it; clamped if `is_within`."""
    from scipy.ndimage import spline_filter1d

    shape = list(values.shape)
    shape[thin.axis] *= thin.parts
    low, high = float(values.min()), float(values.max())
    thick = np.empty(np.moveaxis(values, thin.axis, 0).shape, np.float32)
    for n, plane in enumerate(np.moveaxis(values, thin.axis, 0)):
        thick[n] = plane.astype(np.float64) - low
    across = spline_filter1d(thick, 3, 0, np.float32, "reflect")
    # A faint static texture fixes the flow along straight edges.
    texture = np.random.default_rng(7).normal(size=thick.shape[1:]).astype(np.float32)
    texture = _smooth(texture)
    grain = np.asarray(texture / texture.std() + np.float32(DARK))
    slices = _Slices(thick, across, high - low, is_within, grain)
    found = np.empty(shape, np.float32)
    put = partial(_put_group, slices, np.moveaxis(found, thin.axis, 0), thin.parts)
    with ThreadPoolExecutor(workers()) as pool:
        list(pool.map(put, range(-1, len(thick), GROUP)))
    return found, low


class _Slices(NamedTuple):
    """Thick slices (Z, Y, X)."""

    value: Floats  # above the least one
    coefficient: Floats  # of cubic splines across them
    span: float  # the greatest value
    is_within: bool  # as in `thinned`
    grain: Plane  # levels of 255, the same on all slices: straight edges only move across


def _put_group(slices: _Slices, found: Floats, parts: int, first: int) -> None:
    """Write the thin slices of a group of thick ones."""
    last = len(slices.value) - 1
    # Flows (Y, X, 2) from a slice to the next and back, samples, by the first slice of the pair.
    flows: dict[int, tuple[Plane, Plane]] = {}
    for before in range(first, min(first + GROUP, last + 1)):
        # Thin slices at or after a thick one, and before the next
        start, end = (-((-(2 * n + 1) * parts + 1) // 2) for n in (before, before + 1))
        start, end = max(0, start), min(len(found), end)
        at = [(n + 0.5) / parts - 0.5 for n in range(start, end)]
        if before < 0 or before == last or slices.span == 0:
            # Beyond the outermost slices there is only a spline.
            found[start:end] = [_spline_at(slices, one) for one in at]
            continue
        for pair in range(max(0, before - 1), min(last, before + 2)):
            if pair not in flows:
                flows[pair] = _flows(slices, pair)
        for pair in [pair for pair in flows if pair < before - 1]:
            del flows[pair]
        on, back = flows[before]
        others = flows.get(before - 1, (None, None))[1], flows.get(before + 1, (None, None))[0]
        paths = []  # how flows from a slice differ from those to it, given negated
        for way, opposite, other in ((on, back, others[0]), (back, on, others[1])):
            turn = np.zeros_like(way)
            if other is not None:
                most = np.float32(MOST_TURN) * (np.abs(way) + np.abs(other))
                turn = _smooth(np.clip(way + other, -most, most))
            paths.append((way, opposite, turn, way is back))
        # Bound the spline's error between two slices: small where differences do not grow
        fourth, second = np.zeros((2, *slices.value.shape[1:]), np.float32)
        for middle in (before, before + 1):
            a, b, c, d, e = (slices.value[_mirrored(middle + n, slices)] for n in range(-2, 3))
            np.maximum(fourth, np.abs(a + e - 4 * (b + d) + 6 * c), out=fourth)
            np.maximum(second, np.abs(b + d - 2 * c), out=second)
        fourth, second = _smooth(fourth), _smooth(second)
        growth = fourth / (np.float32(WHITE) * second + np.float32(SLACK * slices.span))
        error = np.float32(UNSURE / slices.span) * np.asarray(fourth * growth**GROWTH)
        trust = np.asarray((error + np.float32(SLACK)) ** -SHARP)  # its weight
        for n, place in enumerate(at, start):
            share = trust
            total = trust * _spline_at(slices, place)
            for path in paths:
                between, apart = _along(slices, before, place - before, *path)
                error = np.float32(1.0 / slices.span) * _smooth(apart)
                fit = np.asarray((error + np.float32(SLACK)) ** -SHARP)
                share = share + fit
                total += fit * between
            found[n] = total / share


def _spline_at(slices: _Slices, at: float) -> Plane:
    """Evaluate the spline across slices, mirrored beyond the ends."""
    first = int(np.floor(at))
    t = at - first
    u = 1.0 - t
    inner = (3 * t**3 - 6 * t * t + 4) / 6, (3 * u**3 - 6 * u * u + 4) / 6
    weight = (u**3 / 6, *inner, t**3 / 6)
    planes = (slices.coefficient[_mirrored(first + n, slices)] for n in range(-1, 3))
    found = np.asarray(sum(np.float32(w) * p for w, p in zip(weight, planes, strict=True)))
    if not slices.is_within:
        return found
    one, two = (slices.value[_mirrored(first + n, slices)] for n in range(2))
    return np.asarray(np.clip(found, np.minimum(one, two), np.maximum(one, two)))


def _mirrored(n: int, slices: _Slices) -> int:
    """Return the index of a slice after mirroring at the ends."""
    count = len(slices.value)
    n %= 2 * count
    return n if n < count else 2 * count - 1 - n


def _smooth(plane: Plane) -> Plane:
    import cv2

    return np.asarray(cv2.GaussianBlur(plane, (0, 0), SMOOTH))


def _flows(slices: _Slices, before: int) -> tuple[Plane, Plane]:
    """Compute the flow (Y, X, 2) from a slice to the next, and back, samples."""
    import cv2

    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    flow.setVariationalRefinementIterations(0)
    flow.setFinestScale(int(max(slices.value.shape[1:]) > FINE_SIDE))
    scale = np.float32((255 - 2 * DARK) / slices.span)
    pair = (scale * slices.value[n] + slices.grain for n in (before, before + 1))
    one, two = (np.clip(np.rint(levels), 0, 255).astype(np.uint8) for levels in pair)
    return np.asarray(flow.calc(one, two, None)), np.asarray(flow.calc(two, one, None))


def _along(
    slices: _Slices, before: int, t: float, way: Plane, opposite: Plane, turn: Plane, is_back: bool
) -> tuple[Plane, Plane]:
    """Interpolate at 0..1 along the flow between slices; also return how much they differ.

    `way`: flow (Y, X, 2) from a slice to an adjacent one, before it if `is_back`, and `opposite`
    on that one, back; samples.
    """
    import cv2

    height, width = way.shape[:2]
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    edge = cv2.BORDER_REPLICATE
    passed = np.float32(1.0 - t if is_back else t)
    here, aside = way, np.float32(0.5 * t * (1.0 - t)) * turn
    bent = aside
    for _ in range(TURNS):
        right = x - passed * here[..., 0] + bent[..., 0]
        down = y - passed * here[..., 1] + bent[..., 1]
        here = cv2.remap(way, right, down, cv2.INTER_LINEAR, borderMode=edge)
        bent = cv2.remap(aside, right, down, cv2.INTER_LINEAR, borderMode=edge)
    before_it, behind_it = -passed, np.float32(1.0) - passed
    start, end = (before + 1, before) if is_back else (before, before + 1)
    right, down = x + bent[..., 0], y + bent[..., 1]
    one = _moved(slices, start, right + before_it * here[..., 0], down + before_it * here[..., 1])
    right, down = right + behind_it * here[..., 0], down + behind_it * here[..., 1]
    two = _moved(slices, end, right, down)
    lost = here + cv2.remap(opposite, right, down, cv2.INTER_LINEAR, borderMode=edge)
    astray = np.hypot(lost[..., 0], lost[..., 1])
    between = behind_it * one + passed * two
    off = np.abs(one - two) + np.float32(ASTRAY * slices.span) * np.minimum(astray, MOST_ASTRAY)
    return np.asarray(between), np.asarray(off)


def _moved(slices: _Slices, n: int, right: Plane, down: Plane) -> Plane:
    """Sample a slice at displaced points."""
    import cv2

    value, edge = slices.value[n], cv2.BORDER_REPLICATE
    found = np.asarray(cv2.remap(value, right, down, cv2.INTER_CUBIC, borderMode=edge))
    if not slices.is_within:
        return found
    beside = np.ones((3, 3), np.uint8)
    least, most = (
        cv2.remap(take(value, beside), right, down, cv2.INTER_NEAREST, borderMode=edge)
        for take in (cv2.erode, cv2.dilate)
    )
    return np.asarray(np.clip(found, least, most))
