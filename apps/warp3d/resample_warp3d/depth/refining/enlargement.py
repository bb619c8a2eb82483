"""Find the small map that a map was enlarged from, by any ratio, and its samples.

Sample k of the small map lies where step · px + start = k, along each axis. Enlarged by
repetition, a map steps only between blocks; interpolated, it bends only at samples. The periods of
steps, or bends, are ratios up to aliases; fits of all borders of blocks, or of the interpolation by
least squares, decide among these and refine ratio and phase.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles, Floats
from resample_warp3d.depth.refining.inspecting import depth_of

if TYPE_CHECKING:
    from scipy.sparse import csr_array

LARGEST, LEAST = 20.0, 1.25  # times, ratios that are looked for
LARGEST_CUBIC = 9.0  # times: of more, colors tell too little
SHORTEST = 32  # px, least side of an enlarged map
LINES = 256  # lines in which periods are looked for
WINDOW = 384  # px in which periods are tried
FITTED = 6  # lines with most bends, to which the interpolation is fitted
ROUNDS = 6  # of such a fit
SETTLED = 0.99  # of the squared error: a round that leaves more ends the fit
MOST_EVEN = 4.0  # of the mean around: more counts as this
PEAKS = 8  # periods that are tried, per kind of difference
FEWEST_BLOCKS = 8  # with steps at their borders
BESIDE, NOISY_BESIDE = 0.03, 0.15  # of the steps that chance puts beside borders: most there
UNUSUAL = 0.3  # of the steps that chance puts beside borders: fewer are not looked at closely
BETTER = 0.01  # of all steps: smaller blocks have more of them at their borders
FEW_STEPS = 0.01  # of all samples: a map with fewer steps shows flat objects
LARGE_STEP = 0.08  # of the larger value: steps of noisy maps that count, between surfaces
FEW_LARGE = 64  # of them: fewer tell nothing
UNLIKE = 0.7  # of a fit half a sample beside: fits that leave more at first are not refined
ROUGH = 10.0  # times what a fit may leave: the same where most bends are
CLEAR = 4.0  # times the error of a fit: error of one half a sample beside
ALIKE = 4e-3  # of the bends: what interpolated maps may leave, stored as they are
OFF = 2e-4  # of the range: values farther off were not interpolated
FEW = 1e-2  # share of such values in enlarged maps, where some were clipped
SHARPNESS = -0.75  # of bicubic interpolation, as in OpenCV
BAND = 3  # samples that a sample shares interpolated values with
UNSEEN = 0.2  # of a sample: outer ones that lie farther outside are not solved for
ON_CORNERS = 0.03  # of a sample: outermost px this close to outermost samples were aligned
MEANS = 3  # most means of two surfaces in a row
JUMP = 0.05  # of the larger value: least difference of two surfaces
PART = 0.1  # of this difference: a mean differs by more from both
STEEP = 2.0  # times what the slopes beside them explain: least difference of two surfaces
AROUND = 2  # samples around a mean among which its surface is looked for
DISTANT = 0.02  # of the value, per sample: what a more distant one must be more similar

Mask = NDArray[np.bool_]


class Axis(NamedTuple):
    """Where samples lie along an axis: sample k at the px with step · px + start = k."""

    step: float
    start: float

    def places(self, count: int) -> Doubles:
        """Return the places of `count` px among the samples."""
        return self.step * np.arange(count, dtype=np.float64) + self.start


class Enlargement(NamedTuple):
    """Enlargement of a map; pictures of a shot share it."""

    rows: Axis  # as fitted
    columns: Axis
    is_repeated: bool  # in blocks, not interpolated
    is_depth: bool = False  # interpolated quantity
    is_cubic: bool = False


@dataclass(frozen=True)
class SmallMap:
    """The map that a map was enlarged from."""

    values: Floats  # (h, w) depth or nearness
    rows: Axis
    columns: Axis
    how: Enlargement

    @property
    def is_depth(self) -> bool:
        """Whether the values are depth, not nearness."""
        return self.how.is_depth

    @property
    def is_repeated(self) -> bool:
        """Whether it was enlarged in blocks."""
        return self.how.is_repeated

    @property
    def side(self) -> float:
        """Enlargement."""
        return float(1.0 / np.sqrt(self.rows.step * self.columns.step))

    def repeated(self, samples: NDArray[Any], shape: tuple[int, int]) -> NDArray[Any]:
        """Return samples (h, w) enlarged by repetition."""
        row, column = (
            np.clip(np.rint(axis.places(count)).astype(np.int64), 0, few - 1)
            for axis, count, few in zip(
                (self.rows, self.columns), shape, samples.shape, strict=True
            )
        )
        return samples[row[:, None], column]

    def means(self, values: Floats) -> Doubles:
        """Return the means (h, w) of a map over the cells around the samples."""
        found = values.astype(np.float64)
        for axis, few in ((self.rows, self.values.shape[0]), (self.columns, self.values.shape[1])):
            total = np.concatenate([np.zeros((1, found.shape[1])), np.cumsum(found, axis=0)])
            border = (np.arange(few + 1) - 0.5 - axis.start) / axis.step + 0.5
            border = np.clip(border, 0.0, len(found))
            whole = np.minimum(border.astype(np.int64), len(found) - 1)
            part = total[whole] + (border - whole)[:, None] * found[whole]
            found = (np.diff(part, axis=0) / np.maximum(np.diff(border), 1e-9)[:, None]).T
        return found


def small_map(nearness: Floats, step: float, *, is_soft: bool) -> SmallMap | None:
    """Return the map that a map was enlarged from; None if not found.

    `nearness`: (H, W); 0 where unknown. `step`: its quantization. `is_soft`: most edges span
    several samples; others were not interpolated.
    """
    if min(nearness.shape) < SHORTEST:
        return None
    found = _of_blocks(nearness)
    is_interpolated = found is None and is_soft and bool(nearness.all())
    return _interpolated(nearness, step) if is_interpolated else found


def small_map_like(nearness: Floats, step: float, how: Enlargement) -> SmallMap | None:
    """Return a map's small map by another's enlargement; None if it does not fit.

    `nearness`, `step`: as in `small_map`.
    """
    if how.is_repeated:
        return _amid_blocks(nearness, how)
    return _of_samples(nearness, step, how)


def _of_blocks(nearness: Floats) -> SmallMap | None:
    """Return the map that was enlarged by repetition, with values from the blocks' middles.

    In noisy maps, such as from JPEG files, only steps between surfaces count. Where half of the map
    is flat along an axis, the other axis tells the ratio.
    """
    for is_noisy, most in ((False, BESIDE), (True, NOISY_BESIDE)):
        if is_noisy and not nearness.all():  # a sensor's
            return None
        profiles = [
            _steps(values[:: max(1, len(values) // LINES)], is_noisy=is_noisy)
            for values in (nearness.T, nearness)
        ]
        axes = [_borders(each, sorted(_periods([each])), most) for each in profiles]
        known = [axis.step for axis in axes if axis is not None]
        for n in (0, 1):
            if known and axes[n] is None:
                axes[n] = _borders(profiles[n], known, most, FEWEST_BLOCKS)
        rows, columns = axes
        if rows is None or columns is None:
            continue
        return _amid_blocks(nearness, Enlargement(rows, columns, is_repeated=True))
    return None


def _amid_blocks(nearness: Floats, how: Enlargement) -> SmallMap:
    """Return the values amid blocks."""
    height, width = nearness.shape
    (rows, row), (columns, column) = _amid(how.rows, height), _amid(how.columns, width)
    return SmallMap(np.ascontiguousarray(nearness[row[:, None], column]), rows, columns, how)


def _amid(axis: Axis, count: int) -> tuple[Axis, NDArray[np.int64]]:
    """Count the blocks along an axis from the first one seen, and return the px amid each."""
    first, last = np.rint(axis.places(count)[[0, -1]])
    axis = Axis(axis.step, axis.start - float(first))
    place = (np.arange(int(last - first) + 1) - axis.start) / axis.step
    return axis, np.clip(np.rint(place), 0, count - 1).astype(np.int64)


def _steps(values: Floats, *, is_noisy: bool) -> Doubles:
    """Count the steps between each column and the next; 0 where they are few.

    In noisy maps large ones are added up, relative to the larger value.
    """
    first, second = values[:, :-1], values[:, 1:]
    if is_noisy:
        size = np.abs(first - second) / np.maximum(np.maximum(first, second), np.float32(1e-30))
        is_step = size > LARGE_STEP
        total = (size * is_step).sum(axis=0, dtype=np.float64)
    else:
        is_step = first != second
        total = is_step.sum(axis=0, dtype=np.float64)
    least = FEW_LARGE if is_noisy else FEW_STEPS * is_step.size
    return total if np.count_nonzero(is_step) >= least else np.zeros_like(total)


def _periods(profiles: Iterable[Doubles]) -> list[float]:
    """Return the samples per px of the strongest periods and their aliases, the strongest first."""
    found: list[tuple[int, float]] = []
    for profile in profiles:
        even = _evened(profile)
        power = np.abs(np.fft.rfft((even - even.mean()) * np.hanning(even.size), 8 * even.size))
        around = np.pad(power, 1)
        is_peak = (power > around[:-2]) & (power >= around[2:])
        rate = np.arange(power.size) / (8.0 * even.size)
        peaks = np.flatnonzero(is_peak & (rate > 1.0 / LARGEST))
        for n, there in enumerate(rate[peaks[np.argsort(-power[peaks])][:PEAKS]]):
            found += [(n, float(there)), (n, 1.0 - float(there))]
    return list(dict.fromkeys(step for _, step in sorted(found) if step < 1.0 / LEAST))


def _evened(profile: Doubles) -> Doubles:
    """Return a profile relative to its local mean, clamped so that no object dominates."""
    window = np.ones(min(2 * int(LARGEST) + 1, profile.size))
    mean = np.convolve(profile, window, "same") / np.convolve(np.ones_like(profile), window, "same")
    return np.asarray(np.minimum(profile / np.maximum(mean, 1.0), MOST_EVEN))


def _phase(profile: Doubles, step: float) -> float:
    """Return the share of a period that a profile's maxima come before its start."""
    even = _evened(profile)
    return float(np.angle(even @ np.exp(-2j * np.pi * step * np.arange(even.size))) / (2 * np.pi))


def _borders(
    profile: Doubles, steps: Iterable[float], most: float, fewest: int | None = None
) -> Axis | None:
    """Return the largest blocks with nearly all steps at their borders; None if not found.

    `most`: share of steps beside borders, of the steps expected by chance. `fewest`: borders with
    steps; half of those between the outermost steps by default. Of all places of borders with the
    same steps the middle is taken.
    """
    if not profile.any():
        return None
    count, middle = profile.size + 1, 0.5 * profile.size
    shift, stretch = np.mgrid[-0.6:0.6:25j, -0.6:0.6:25j].reshape(2, -1, 1)  # px, at both ends
    moves = shift + stretch * (np.arange(count) - middle) / middle
    found, least_share = None, 0.0
    for step in steps:
        start = _phase(profile, step) - 0.5 * step
        usual = np.diff(np.floor(step * np.arange(count) + start)) @ profile / profile.sum()
        if usual < step + UNUSUAL * (1.0 - step):
            continue
        is_border = np.diff(np.floor(step * (np.arange(count) + moves) + start), axis=1) > 0
        share = is_border @ profile / profile.sum()
        best = share >= share.max() - 1e-9
        used = np.count_nonzero(is_border[share.argmax()] & (profile > 0))
        least = fewest or max(FEWEST_BLOCKS, step * np.ptp(np.flatnonzero(profile)) / 2.0)
        if share.max() < max(least_share, 1.0 - most * (1.0 - step)) or used < least:
            continue
        shifted, stretched = float(shift[best].mean()), float(stretch[best].mean())
        found = Axis(step * (1.0 + stretched / middle), start + step * (shifted - stretched) - 0.5)
        least_share = float(share.max()) + BETTER
    return found


def _interpolated(nearness: Floats, step: float) -> SmallMap | None:
    """Return the map that nearness, or depth, was interpolated from, linearly or cubically."""
    for is_depth in (False, True):
        values = depth_of(nearness) if is_depth else nearness
        noise = 0.0 if is_depth else step
        for is_cubic in (False, True):
            columns = _fitted_axis(values, noise, is_cubic=is_cubic)
            rows = columns and _fitted_axis(values.T, noise, [columns.step], is_cubic=is_cubic)
            if columns is None or rows is None:
                continue
            how = Enlargement(rows, columns, False, is_depth, is_cubic)
            if (found := _of_samples(nearness, step, how)) is not None:
                return found
    return None


def _of_samples(nearness: Floats, step: float, how: Enlargement) -> SmallMap | None:
    """Return the map that a map was interpolated from in this way; None if it was not."""
    values = depth_of(nearness) if how.is_depth else nearness
    noise = 0.0 if how.is_depth else step
    thin, columns, _ = _solved(values, how.columns, is_cubic=how.is_cubic)
    small, rows, _ = _solved(thin.T, how.rows, is_cubic=how.is_cubic)
    found = SmallMap(small.T.astype(np.float32), rows, columns, how)
    off = np.abs(enlarged_by(found, nearness.shape, is_cubic=how.is_cubic) - values)
    if np.mean(off > OFF * np.ptp(values) + noise) > FEW:
        return None
    return _trimmed(found, nearness.shape)


def _trimmed(small: SmallMap, shape: tuple[int, ...]) -> SmallMap:
    """Drop samples with cells outside the frame, and return the others' positions.

    Enlargement that puts the outermost samples on the outermost px (`align_corners`) stretches what
    they show, which are equal parts of the frame, as in any other small map.
    """
    axes, kept = [], []
    for axis, few, count in zip(
        (small.rows, small.columns), small.values.shape, shape, strict=True
    ):
        ends = axis.places(count)[[0, -1]]
        if np.abs(ends - (0, few - 1)).max() < ON_CORNERS:
            axes.append(Axis(few / count, 0.5 * few / count - 0.5))
            kept.append(slice(None))
            continue
        first, last = (min(max(round(end), 0), few - 1) for end in (ends[0] + 1e-3, ends[1] - 1e-3))
        axes.append(Axis(axis.step, axis.start - first))
        kept.append(slice(first, last + 1))
    values = np.ascontiguousarray(small.values[kept[0], kept[1]])
    return replace(small, values=values, rows=axes[0], columns=axes[1])


def _fitted_axis(
    values: Floats, noise: float, likely: Sequence[float] = (), *, is_cubic: bool
) -> Axis | None:
    """Return where samples lie along rows, if these were interpolated from them.

    `likely`: steps that are tried first. A fit counts if one between its samples is far worse:
    smooth maps agree with any ratio and phase.
    """
    lines = values[:: max(1, len(values) // LINES)].astype(np.float64)
    bends = [np.abs(np.diff(lines, order, axis=1)) for order in (2, 3)]
    floor = OFF * float(np.ptp(lines))
    profiles = [
        (each > max(8.0 * float(np.median(each)), floor)).sum(axis=0).astype(np.float64)
        for each in bends
    ]
    most = np.argsort(-(bends[0] > floor).sum(axis=1))[: 4 * FITTED : 4]
    rows, size = lines[np.sort(most)], float(np.sqrt(np.mean(np.square(bends[0][most]))))
    enough = ALIKE * size + 0.1 * floor + 1.5 * noise / np.sqrt(12.0)
    # Try the periods where most bends are, and refine what fits there.
    width = min(WINDOW, rows.shape[1])
    at = int(np.argmax(np.convolve(profiles[0], np.ones(max(1, width - 2)), "valid")))
    whole, part = (
        partial(_refined, each, is_cubic=is_cubic) for each in (rows, rows[:, at : at + width])
    )
    for step in (*likely, *_periods(profiles)):
        if is_cubic and step < 1.0 / LARGEST_CUBIC:
            continue
        phase = _phase(np.pad(profiles[0], 1), step) + step * at
        # Bends amid two px have no phase.
        starts = [Axis(step, phase + quarter) for quarter in (0.0, 0.25, 0.5, 0.75)]
        errors = [part(axis, 0)[1] for axis in starts]
        if min(errors) > UNLIKE * max(errors):
            continue
        axis, error = part(starts[int(np.argmin(errors))], ROUNDS)
        if error > ROUGH * enough:
            continue
        axis, error = whole(axis._replace(start=axis.start - axis.step * at), ROUNDS)
        if error <= enough and whole(axis._replace(start=axis.start + 0.5), 0)[1] > CLEAR * error:
            return _coarsest(axis, whole, enough)
    return None


def _coarsest(axis: Axis, fit: Callable[[Axis, int], tuple[Axis, float]], enough: float) -> Axis:
    """Return the samples among given ones that suffice: all, each second or each third."""
    for every in (3, 2):
        for first in range(every):
            found = Axis(axis.step / every, (axis.start - first) / every)
            if fit(found, 0)[1] <= ROUGH * enough:
                found, error = fit(found, ROUNDS)
                if error <= enough:
                    return found
    return axis


def _refined(rows: Doubles, axis: Axis, rounds: int, *, is_cubic: bool) -> tuple[Axis, float]:
    """Fit ratio and phase of an interpolation by Gauss-Newton; also return the rms error."""
    half = 0.5 * rows.shape[1]

    def error(place: Doubles) -> Doubles:  # of the axis amid the row, and half of its length
        found = Axis(place[1] / half, place[0] - place[1])
        short, _, matrix = _solved(rows, found, is_cubic=is_cubic)
        return np.asarray((matrix @ short.T).T - rows).ravel()

    place = np.array([axis.start + half * axis.step, half * axis.step])
    left, small = error(place), 1e-3
    for _ in range(rounds):
        slope = np.stack([(error(place + small * way) - left) / small for way in np.eye(2)], axis=1)
        moved = place - np.clip(np.linalg.lstsq(slope, left)[0], -0.3, 0.3)
        again = error(moved)
        if not again @ again < SETTLED * (left @ left):
            break
        place, left = moved, again
    return Axis(place[1] / half, place[0] - place[1]), float(np.sqrt(np.mean(left**2)))


def _solved(
    rows: Floats | Doubles, axis: Axis, *, is_cubic: bool
) -> tuple[Doubles, Axis, "csr_array"]:
    """Return the short rows (H, w) that, enlarged, fit rows (H, W) best; axis and interpolation."""
    from scipy.linalg import solveh_banded

    matrix, first = _interpolation(rows.shape[1], axis, is_cubic=is_cubic)
    normal = matrix.T @ matrix
    bands = np.zeros((BAND + 1, matrix.shape[1]))
    for n in range(min(BAND + 1, matrix.shape[1])):
        bands[BAND - n, n:] = normal.diagonal(n)
    bands[BAND] += 1e-9
    short = np.asarray(solveh_banded(bands, matrix.T @ rows.T).T)
    return short, Axis(axis.step, axis.start - first), matrix


def _interpolation(
    count: int, axis: Axis, few: int | None = None, *, is_cubic: bool
) -> tuple["csr_array", int]:
    """Return the weights (W, w) of samples in the values between them, and the first sample.

    `few`: how many samples there are, from 0 on; by default, as many as are between the values.
    """
    from scipy.sparse import csr_array

    place = axis.places(count)
    taps = np.arange(-1, 3) if is_cubic else np.arange(2)
    sample = np.floor(place)[:, None] + taps
    away = np.abs(place[:, None] - sample)
    weight = 1.0 - away
    if is_cubic:  # Keys's kernel
        a = SHARPNESS
        near = ((a + 2.0) * away - (a + 3.0)) * away**2 + 1.0
        far = a * (((away - 5.0) * away + 8.0) * away - 4.0)
        weight = np.where(away <= 1.0, near, far)
    first, last = 0, (few or 1) - 1
    if few is None:
        first, last = int(np.floor(place[0] + UNSEEN)), int(np.ceil(place[-1] - UNSEEN))
    column = np.clip(sample, first, last).astype(np.int32) - first
    begins = np.arange(0, column.size + 1, taps.size, dtype=np.int32)
    shape = count, last - first + 1
    return csr_array((weight.ravel(), column.ravel(), begins), shape=shape), first


def enlarged_by(small: SmallMap, shape: tuple[int, ...], *, is_cubic: bool = False) -> Floats:
    """Return the values that interpolation of a small map leads to."""
    rows, columns = (
        _interpolation(count, axis, few, is_cubic=is_cubic)[0]
        for count, axis, few in zip(
            shape, (small.rows, small.columns), small.values.shape, strict=True
        )
    )
    return np.asarray((columns @ (rows @ small.values).T).T, np.float32)


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
    """Return flags of samples between two surfaces, along rows or columns."""
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
