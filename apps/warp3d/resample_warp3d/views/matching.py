"""Match several sources: colors by gain and bias, depths by a scale each, poses by both."""

import math
from collections.abc import Sequence
from itertools import combinations, permutations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from resample.types import Doubles, Floats, Indices
from resample_warp3d.depth.equation import places, warp_places
from resample_warp3d.types import DOWN, LEFT, RIGHT, UP, DepthImage, Equation, Source, Warped

ROUNDS = 20
TIGHT = 1e-3  # in the unknowns' unit: smaller errors count squared, larger ones linearly
HOLD = 1e-6  # weight that holds unknowns without equations at `start`
COLORS = ("gain", "gain-bias", "none")
SAME = 0.02  # relative nearness within which views show the same surface
BLOCK = 8  # px per side; means over such blocks hardly depend on misalignment
WHOLE = 0.95  # coverage from which a pixel is not border
FULL = 0.75  # share of a block's pixels that both views must show
FEWEST_BLOCKS = 12  # blocks that two views must share to be compared
DARK, BRIGHT = 0.02, 0.98  # of the largest value: below is noise, above is clipped
UNNOTICED_GAIN = 1e-3  # smaller gains or biases are ignored
MOST = 2.0  # largest gain
DEPTHS = ("scale", "none")
COMPARED = 40_000  # approximate number of points per source
ALIGNMENTS = 3
CLOSE = 0.08  # relative nearness within which a point belongs to a surface
FEWEST_POINTS = 200  # points that two sources must share to be compared
STEP = 1e-3  # relative step of the nearness for finite differences
UNNOTICED_SCALE = 2e-4  # smaller corrections are ignored
ALL = RIGHT | DOWN | LEFT | UP
BLURS = (4.0, 2.0, 1.0, 0.0)  # px, deviations of the blur of colors, one after another
STEPS = 6  # of Gauss-Newton for each
FITTED = 4_000  # approximate number of points per view, for fitting and for checking
FEWEST = 200  # points that two views must share to be compared
FAINT = 0.02  # of the brightest color, added to all before their logarithm is taken
TOLERANT = 2.0  # deviations at which an error counts half
STILL = 1e-4  # of a view's mean weight: what holds it where it is
SLIGHT = 1e-5  # rad, or of the median depth: shorter steps are the last
BETTER = 1.03  # times the agreement of points that are not fitted: with less, poses stay


def solved(rows: Doubles, right: Doubles, sums: Doubles, start: Doubles) -> Doubles:
    """Minimize the sum of absolute errors of `rows @ x = right`.

    `rows`, `right`: (N, M) and (N,). `sums`: (K, M) sums of unknowns that keep their value at
    `start`. `start`: (M,) values of unknowns without equations.
    """
    count, held = start.size, len(sums)
    found = start.copy()
    for _ in range(ROUNDS):
        error = np.abs(np.einsum("nm,m->n", rows, found) - right)
        weight = 1.0 / np.maximum(error, TIGHT)
        weight /= weight.sum()
        normal = np.zeros((count + held, count + held))
        weighed = rows * weight[:, None]
        normal[:count, :count] = np.einsum("nm,nk->mk", weighed, rows) + HOLD * np.eye(count)
        normal[:count, count:], normal[count:, :count] = sums.T, sums
        told = np.einsum("nm,n->m", weighed, right) + HOLD * start
        after = np.linalg.solve(normal, np.concatenate([told, sums @ start]))[:count]
        moved = float(np.abs(after - found).max())
        found = after
        if moved < 1e-7:
            break
    return found


class Match(NamedTuple):
    """Gain and bias for each view and channel."""

    gain: Doubles  # (V, C)
    bias: Doubles  # (V, C)


def check_colors(colors: str) -> None:
    """Reject an unknown way to match colors."""
    if colors not in COLORS:
        raise ValueError(f"unknown way to match colors {colors!r}; known: {', '.join(COLORS)}")


def match_colors(views: Sequence[Warped], colors: str = "gain") -> Match:
    """Return gains and biases that make views alike where they show the same surface.

    Result: the gains' product over the views is 1 and the biases' sum 0, as no view is known to be
    right. They are 1 and 0 for a view that shares nothing with the others, and for differences
    below 0.1 %.
    """
    check_colors(colors)
    count, channels = len(views), views[0].image.shape[2]
    match = Match(np.ones((count, channels)), np.zeros((count, channels)))
    if colors == "none" or count < 2:
        return match
    # Average blocks of pixels that two views share, colors (N, C) of both, and mark usable ones.
    top, pairs = np.max([view.image.max(axis=(0, 1)) for view in views], axis=0), []
    for first, second in combinations(range(count), 2):
        one, other = views[first], views[second]
        shared = (one.coverage >= WHOLE) & (other.coverage >= WHOLE)
        far, near = (choose(one.depth, other.depth) for choose in (np.maximum, np.minimum))
        shared &= near >= np.where(shared, far, 0) * (1.0 - SAME)
        clear = shared[..., None] & (one.image < BRIGHT * top) & (other.image < BRIGHT * top)
        color = _means(one, clear), _means(other, clear)
        usable = (_blocks(clear) >= FULL) & (np.minimum(*color) > DARK * top)
        pairs.append((first, second, color, usable))
    for channel in range(channels):
        linked = [
            (first, second, [each[use[:, channel], channel, None] for each in color])
            for first, second, color, use in pairs
            if use[:, channel].sum() >= FEWEST_BLOCKS
        ]
        if not linked:
            continue
        gain, bias = _of_channel(linked, count, has_bias=colors == "gain-bias")
        if max(np.abs(np.log(gain)).max(), np.abs(bias).max()) > UNNOTICED_GAIN:
            match.gain[:, channel], match.bias[:, channel] = gain, bias
    return match


def balanced(views: Sequence[Warped], match: Match) -> list[Warped]:
    """Apply gains and biases to views; uncovered pixels stay empty."""
    made = []
    for view, gain, bias in zip(views, match.gain, match.bias, strict=True):
        if (gain == 1).all() and (bias == 0).all():
            made.append(view)
            continue
        added = view.coverage[..., None] * bias.astype(np.float32)
        made.append(view._replace(image=view.image * gain.astype(np.float32) + added))
    return made


def _of_channel(
    linked: Sequence[tuple[int, int, list[Doubles]]], count: int, *, has_bias: bool
) -> tuple[Doubles, Doubles]:
    """Gain (V,) and bias (V,) of a channel, by colors (N, 1) that two views share.

    Gains alone are found by their logarithms. With biases, views without common surfaces, also by
    way of others, each keep a mean of their own: the errors of one half get less as it gets darker.
    """
    rows, right, views = [], [], np.eye(count)
    for first, second, (color, beside) in linked:
        one, other = views[first], views[second]
        right.append(np.zeros(len(color)) if has_bias else np.log(beside / color)[:, 0])
        gains = color * one - beside * other if has_bias else one - other + 0.0 * color
        rows.append(np.c_[gains, (one - other) * has_bias + 0.0 * color])
    between = np.zeros((count, count))
    between[tuple(np.transpose([(first, second) for first, second, _ in linked]))] = 1.0
    parts, part = connected_components(between, directed=False)
    sums = np.kron(np.eye(2), part == np.arange(parts)[:, None])
    start = np.repeat([float(has_bias), 0.0], count)
    found = solved(np.concatenate(rows), np.concatenate(right), sums, start)
    gain = found[:count] if has_bias else np.exp(found[:count])
    gain = np.clip(gain, 1.0 / MOST, MOST)
    level = np.exp(sums[:parts, :count] @ np.log(gain) / sums[:parts, :count].sum(axis=1))[part]
    return gain / level, found[count:] / level


def _means(view: Warped, where: NDArray[np.bool_]) -> Doubles:
    share = np.maximum(_blocks(where), 1e-9)
    color = view.image / np.maximum(view.coverage, np.float32(WHOLE))[..., None]
    return np.asarray(_blocks(np.where(where, color, 0)) / share, np.float64)


def _blocks(values: NDArray[np.generic]) -> Doubles:
    """Average (H, W, C) over blocks, (N, C)."""
    height, width, channels = values.shape
    size = min(BLOCK, height, width)
    cut = values[: height // size * size, : width // size * size].astype(np.float64)
    shape = height // size, size, width // size, size, channels
    return np.asarray(cut.reshape(shape).mean(axis=(1, 3)).reshape(-1, channels), np.float64)


def check_depths(depths: str) -> None:
    """Reject an unknown way to match depths."""
    if depths not in DEPTHS:
        raise ValueError(f"unknown way to match depths {depths!r}; known: {', '.join(DEPTHS)}")


def match_depths(
    sources: Sequence[Source], equations: Sequence[Sequence[Equation]], depths: str = "scale"
) -> Doubles:
    """Return factors (V,) of the sources' nearness that make their surfaces agree.

    Result: factors with product 1, as no source is known to be right. All are 1 if the sources
    agree within 0.02 %; a source that shares nothing with the others gets 1.
    """
    check_depths(depths)
    count = len(sources)
    scale = np.zeros(count)
    if depths == "none" or count < 2:
        return np.exp(scale)
    points = []  # positions (N, 2) and nearness (N,) of some samples inside surfaces
    for source in sources:
        sparse = max(1, math.isqrt(source.nearness.size // COMPARED))
        chosen = slice(sparse // 2, None, sparse)
        image = DepthImage(source.color, source.nearness, source.place)
        inside = (source.links[chosen, chosen] & ALL) == ALL
        near = source.nearness[chosen, chosen].astype(np.float64)
        points.append((places(image)[chosen, chosen][inside], near[inside]))
    for _ in range(ALIGNMENTS):
        rows, right = [], []
        for first, second in permutations(range(count), 2):
            if sources[second].place.size:
                continue
            place, nearness = points[first]
            seen = nearness * math.exp(scale[first])
            # Logarithms of ratios of nearness where points meet a surface of the other source,
            # and their derivatives by the point's logarithm.
            way, other = equations[first][second], sources[second]
            error = _errors(place, seen, way, other)
            moved = _errors(place, seen * math.exp(STEP), way, other)
            known = np.isfinite(error) & np.isfinite(moved)
            known[known] = np.abs(error[known] + scale[second]) < CLOSE
            change = (moved[known] - error[known]) / STEP
            error = error[known] + scale[second]
            if error.size < FEWEST_POINTS:
                continue
            row = np.zeros((error.size, count))
            row[:, first], row[:, second] = change, 1.0
            rows.append(row)
            right.append(row[:, first] * scale[first] + scale[second] - error)
        if not rows:
            break
        scale = solved(np.concatenate(rows), np.concatenate(right), np.ones((1, count)), scale)
    if np.abs(scale).max() <= UNNOTICED_SCALE:
        scale = np.zeros(count)
    return np.exp(scale)


def scaled(source: Source, scale: float) -> Source:
    """Return a source with its nearness multiplied."""
    if scale == 1.0:
        return source
    factor = np.float32(scale)
    return source._replace(
        nearness=source.nearness * factor, slope=source.slope * factor, step=source.step * scale
    )


def _errors(place: Doubles, nearness: Doubles, equation: Equation, other: Source) -> Doubles:
    """Return log ratios (N,) of the other's nearness to the points'; nan off its surfaces."""
    seen, expected = warp_places(equation, place, nearness)
    found = inside_surface(other, seen)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.log(found) - np.log(expected), np.float64)


def inside_surface(source: Source, place: Doubles) -> Doubles:
    """Interpolate a source's nearness (N,) at places (N, 2); nan off its surfaces."""
    height, width = source.nearness.shape
    at = np.where(np.isfinite(place), place, -1.0) - 0.5
    column, row = (np.floor(at[:, axis]).astype(np.int64) for axis in (0, 1))
    good = (column >= 0) & (row >= 0) & (column < width - 1) & (row < height - 1)
    column, row = np.where(good, column, 0), np.where(good, row, 0)
    links = source.links
    good &= (links[row, column] & (RIGHT | DOWN)) == (RIGHT | DOWN)
    good &= (links[row + 1, column + 1] & (LEFT | UP)) == (LEFT | UP)
    x, y = at[:, 0] - column, at[:, 1] - row
    nearness = source.nearness.astype(np.float64)
    above = (1 - x) * nearness[row, column] + x * nearness[row, column + 1]
    below = (1 - x) * nearness[row + 1, column] + x * nearness[row + 1, column + 1]
    return np.where(good, (1 - y) * above + y * below, np.nan)


class Sampled(NamedTuple):
    """Data of a view that are compared with others."""

    matrix: Doubles  # (3, 3) of its camera
    bright: Floats  # (H, W) log of the color
    near: Floats  # (H, W) nearness; nan where unknown
    slope: Floats  # (H, W, 2) of the nearness
    chosen: tuple[tuple[Indices, Indices], ...]  # samples, for fitting and for checking
    points: tuple[Doubles, ...]  # (N, 3) of both, in the camera


# Errors of the colors and depths (2, N) of points of a view in another one, and their slopes
# (2, N, 12) by translation and rotation of the first and the second view.
Pairs = dict[tuple[int, int], tuple[Doubles, Doubles]]


def refined_poses(
    sources: Sequence[Source], matrices: Sequence[Doubles], poses: Sequence[Doubles]
) -> list[Doubles]:
    """Return poses (4, 4) world-to-camera of views at which their colors and depths agree best.

    Gauss-Newton on log color and log nearness at points of each view in each other one, with colors
    blurred less and less (Steinbruecker, Sturm, Cremers 2011). No view is known to be right, so
    their mean stays. All stay unless points that are not fitted agree better afterwards.
    """
    import cv2
    from scipy.spatial.transform import Rotation

    views = [_sampled(s, m) for s, m in zip(sources, matrices, strict=True)]
    depth = np.median(np.concatenate([view.points[0][:, 2] for view in views]))
    unit = np.repeat([depth, 1.0], 3)
    given = [np.asarray(pose, np.float64) for pose in poses]
    found, moved, soft = given, np.zeros((len(views), 6)), list[list[Floats]]()
    for blur in BLURS:
        soft = []  # blurred colors, and their slopes
        for view in views:
            color = cv2.GaussianBlur(view.bright, (0, 0), blur) if blur else view.bright
            down, across = np.gradient(np.asarray(color))
            soft.append([np.asarray(color), across, down])
        for _ in range(STEPS):
            pairs = _compared(views, soft, found, 0)
            if not pairs:
                return given
            step = _step(pairs, moved, unit)
            moved = moved + step
            turns = Rotation.from_rotvec((step * unit)[:, 3:]).as_matrix()
            motion = np.tile(np.eye(4), (len(found), 1, 1))  # of each camera, in its coordinates
            motion[:, :3] = np.concatenate([turns, (step * unit)[:, :3, None]], axis=2)
            found = [move @ pose for move, pose in zip(motion, found, strict=True)]
            if np.abs(step).max() < SLIGHT:
                break
    before, after = (_compared(views, soft, each, 1) for each in (given, found))
    deviations = _deviations(before or after)
    is_better = _agreement(after, deviations) > BETTER * _agreement(before, deviations)
    return found if is_better else given


def _sampled(source: Source, matrix: Doubles) -> Sampled:
    """Take what is compared from a source."""
    bright = source.color.mean(axis=2)
    bright = np.log(bright / np.float32(max(float(bright.max()), 1e-9)) + np.float32(FAINT))
    place = places(DepthImage(source.color, source.nearness, source.place))
    row, column = np.nonzero((source.nearness > 0) & ((source.links & ALL) == ALL))
    every = max(1, row.size // (2 * FITTED))
    chosen = tuple((row[n :: 2 * every], column[n :: 2 * every]) for n in (0, every))
    back = np.linalg.inv(matrix)
    points = tuple(
        np.c_[place[at], np.ones(at[0].size)] @ back.T / source.nearness[at].astype(float)[:, None]
        for at in chosen
    )
    near = np.where(source.nearness > 0, source.nearness, np.float32(np.nan))
    return Sampled(matrix, np.asarray(bright, np.float32), near, source.slope, chosen, points)


def _compared(
    views: Sequence[Sampled], soft: Sequence[Sequence[Floats]], poses: Sequence[Doubles], which: int
) -> Pairs:
    """Compare the points of each view with each other view."""
    found = {}
    for first, second in permutations(range(len(views)), 2):
        color = soft[first][0][views[first].chosen[which]].astype(np.float64)
        turn = poses[second] @ np.linalg.inv(poses[first])
        errors = _differences(views[second], soft[second], turn, views[first].points[which], color)
        if errors[0].shape[1] >= FEWEST:
            found[first, second] = errors
    return found


def _differences(
    view: Sampled, soft: Sequence[Floats], turn: Doubles, point: Doubles, color: Doubles
) -> tuple[Doubles, Doubles]:
    """Compare points (N, 3) of another camera, and their colors, with a view."""
    there = point @ turn[:3, :3].T + turn[:3, 3]
    there[:, 2] = np.where(there[:, 2] > 0, there[:, 2], np.nan)
    flat = there[:, :2] / there[:, 2:]
    at = flat @ view.matrix[:2, :2].T + view.matrix[:2, 2] - 0.5
    seen = _interpolated([*soft, view.near, view.slope[..., 0], view.slope[..., 1]], at)
    depth = np.log(seen[3] * there[:, 2])
    shared = np.abs(depth) < CLOSE
    point, there, depth = point[shared], there[shared], depth[shared]
    change = (seen[0] - color)[shared]
    change -= np.median(change) if change.size else 0.0  # exposures may differ
    # How both errors change as the point moves in the view's camera.
    across = np.zeros((len(there), 2, 3))
    across[:, [0, 1], [0, 1]], across[:, :, 2] = 1.0, -flat[shared]
    across = view.matrix[:2, :2] @ across / there[:, 2, None, None]
    slope = seen[1:3], seen[4:] / seen[3]
    toward = [np.einsum("kn,nkx->nx", each[:, shared], across) for each in slope]
    toward[1][:, 2] += 1.0 / there[:, 2]
    slopes = []
    for by in toward:
        back = by @ turn[:3, :3]
        slopes.append(np.c_[-back, -np.cross(point, back), by, np.cross(there, by)])
    return np.stack([change, depth]), np.stack(slopes)


def _interpolated(maps: Sequence[Floats], at: Doubles) -> Doubles:
    """Interpolate maps (H, W) at places (N, 2), (K, N); nan outside."""
    low = np.floor(np.nan_to_num(at, nan=-1.0))
    column, row = np.clip(low, -1, np.array(maps[0].shape[::-1])).astype(np.int64).T
    inside = (column >= 0) & (row >= 0)
    inside &= (column < maps[0].shape[1] - 1) & (row < maps[0].shape[0] - 1)
    column, row = np.where(inside, column, 0), np.where(inside, row, 0)
    x, y = (at - low).T
    parts = [(0, 0, (1 - x) * (1 - y)), (0, 1, x * (1 - y)), (1, 0, (1 - x) * y), (1, 1, x * y)]
    found = [sum(w * each[row + r, column + c] for r, c, w in parts) for each in maps]
    return np.where(inside, np.stack(found), np.nan)


def _deviations(pairs: Pairs) -> Doubles:
    """Return the median absolute errors of colors and depths."""
    errors = np.abs(np.concatenate([error for error, _ in pairs.values()], axis=1))
    return np.asarray(np.maximum(np.median(errors, axis=1), 1e-6))


def _agreement(pairs: Pairs, deviations: Doubles) -> float:
    """Count the points that agree, those that are off by two deviations half."""
    errors = (error / (TOLERANT * deviations[:, None]) for error, _ in pairs.values())
    return sum(float(np.sum(1.0 / (1.0 + np.square(each)))) for each in errors)


def _step(pairs: Pairs, moved: Doubles, unit: Doubles) -> Doubles:
    """Return the step (V, 6) of all views, in median depths and rad, by weighted least squares."""
    count = len(moved)
    normal, right = np.zeros((count, 6, count, 6)), np.zeros((count, 6))
    deviations = _deviations(pairs)[:, None]
    for pair, (off, by) in pairs.items():
        error, slope = off / deviations, by * np.tile(unit, 2) / deviations[..., None]
        weight = 1.0 / (1.0 + np.square(error / TOLERANT))
        square = np.einsum("kn,kni,knj->ij", weight, slope, slope, optimize=False)
        toward = np.einsum("kn,kni->i", weight * error, slope).reshape(2, 6)
        for n, view in enumerate(pair):
            right[view] -= toward[n]
            for m, other in enumerate(pair):
                normal[view, :, other] += square[6 * n : 6 * n + 6, 6 * m : 6 * m + 6]
    flat = normal.reshape(6 * count, 6 * count)
    hold = STILL * np.trace(flat) / len(flat)
    step = np.linalg.solve(flat + hold * np.eye(len(flat)), right.ravel() - hold * moved.ravel())
    return np.asarray(step.reshape(count, 6))
