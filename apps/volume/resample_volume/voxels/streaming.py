"""Find visible voxels brick by brick; the others are never in memory together."""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import product
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from resample import memory
from resample.outofcore.bricks import Box, Step, bricks_in_memory, copy_shared, with_neighbours
from resample.outofcore.passes import in_order, thread_pool, threads_at_work
from resample.types import Doubles, Floats, Indices
from resample.watching import report
from resample_volume.classification.transfer import DataRange, Transfer, visible_places
from resample_volume.data.bricks import Bricks
from resample_volume.data.parts import kernel_layers, side_by_side
from resample_volume.data.scanning import are_few

BYTES_PER_VOXEL = 100  # bytes of a possibly visible voxel, from here to the picture, at most
BYTES_OF_SLOPE = 16  # additional bytes where its look depends on its slope
REMEDY = "give more memory, take a coarser level, or show less of it"


class TooManyVoxelsError(ValueError):
    """The visible voxels of a volume do not fit in memory together."""


R = TypeVar("R")


class Candidates(NamedTuple):
    """Voxels that may be visible by their value."""

    place: Indices  # (N,) index into the flat volume, z slowest
    value: NDArray[Any]  # (N,) data units
    slope: Floats  # (N, 3) data units per scene unit; or (0, 3)


class BrickClassifier(NamedTuple):
    """Parameters of a scan of bricks."""

    transfer: Transfer
    data_range: DataRange
    gradient: str | None  # see `visible.GRADIENTS`
    to_scene: Doubles  # (3, 3) takes slopes per voxel to slopes per scene unit


def visible_in_bricks(bricks: Bricks, wanted: BrickClassifier, name: str) -> Candidates:
    """Return the voxels with non-zero opacity, in the order of the painter's bricks.

    If the histogram of values is known, nothing is read if they are too many. A brick without
    visible values is not read, unless slopes beside it need it; every other one is read once. The
    result equals that for an array, in the same order.
    """
    chosen = visible_bricks(bricks, wanted.transfer, wanted.data_range)
    together = bricks_in_memory(_with_those_beside(bricks, chosen if wanted.gradient else ()))
    known = _known_count(bricks, wanted)
    _require(bricks, wanted.transfer, known, name, together * bricks.bytes_each)
    parts, count = [_no_candidates(bricks)], 0
    for n, part in enumerate(brick_by_brick(bricks, wanted, chosen, _as_it_is)):
        parts.append(part)
        count += part.place.size
        _require(bricks, wanted.transfer, count, name, bricks.most_held)
        report(n + 1, len(chosen))
    return _in_order(parts, bricks)


def brick_by_brick(
    bricks: Bricks,
    wanted: BrickClassifier,
    chosen: Sequence[Step],
    finish: Callable[[Candidates, Box], R],
) -> Iterator[R]:
    """Run a job on the visible voxels of each brick and its box, in the order of the bricks.

    It runs on several bricks at a time. Voxels that are not requested count as hidden.
    """

    def only(found: list[Candidates], boxes: list[Box]) -> R:
        return finish(found[0], boxes[0])

    return map_bricks([OnGrid(bricks, wanted, chosen)], only)


class OnGrid(NamedTuple):
    """Bricks of one of several volumes on one grid."""

    bricks: Bricks
    wanted: BrickClassifier  # parameters of the scan
    chosen: Sequence[Step]  # bricks that may have visible voxels, ascending

    def visible(self, index: Step, around: dict[Step, NDArray[Any]]) -> Candidates:
        """Return the visible voxels of a brick, given with adjacent ones if slopes need them."""
        box = self.bricks.box(index)
        if self.wanted.gradient is None:
            corner = [side.start for side in box]
            return _visible(self.bricks.brick(index), box, corner, self.bricks, self.wanted)
        values, corner = _padded(box, around, self.bricks)
        return _visible(values, box, corner, self.bricks, self.wanted)


def map_bricks(
    parts: Sequence[OnGrid], finish: Callable[[list[Candidates], list[Box]], R]
) -> Iterator[R]:
    """Do as `brick_by_brick` with several volumes: the job gets each one's voxels and box."""
    own = [set(part.chosen) for part in parts]
    chosen = sorted(set().union(*own))

    def classify(task: tuple[Step, list[dict[Step, NDArray[Any]]]]) -> R:
        index, around = task
        found = [
            part.visible(index, near) if index in some else _no_candidates(part.bricks)
            for part, near, some in zip(parts, around, own, strict=True)
        ]
        return finish(found, [part.bricks.box(index) for part in parts])

    with thread_pool() as pool:
        windows = [_Window(part, chosen, pool, threads_at_work()) for part in parts]
        tasks = ((chosen[n], [one.around(n) for one in windows]) for n in range(len(chosen)))
        yield from in_order(classify, tasks, pool)


def _as_it_is(part: Candidates, _: Box) -> Candidates:
    return part


def _known_count(bricks: Bricks, wanted: BrickClassifier) -> int:
    """Return the number of visible voxels, as far as known before reading."""
    codes = bricks.statistics.codes
    if codes is None or bricks.request is not None:
        return 0
    every = np.arange(codes.size, dtype=np.uint32).astype(f"u{bricks.dtype.itemsize}")
    values = every.view(bricks.dtype.newbyteorder("="))
    return int(codes[wanted.transfer.opacities(values, wanted.data_range) > 0].sum())


def _with_those_beside(bricks: Bricks, chosen: Sequence[Step]) -> NDArray[np.bool_]:
    is_chosen = np.zeros(bricks.count, bool)
    for index in chosen:
        is_chosen[index] = True
    return with_neighbours(is_chosen)


def _require(bricks: Bricks, transfer: Transfer, count: int, name: str, together: int) -> None:
    """Reject visible voxels that do not fit in the memory limit.

    Bricks held `together` count as well, in bytes, even after release, as freed memory is not
    always reused. Pinned bricks are evicted.
    """
    each = BYTES_PER_VOXEL + (BYTES_OF_SLOPE if transfer.needs_gradient else 0)
    what, size = f"{name} with {count} visible voxels", each * count + together
    if bricks.memory is not None and size <= bricks.memory < size + bricks.pinned_bytes:
        bricks.pin_bricks(bricks.memory - size)
    if bricks.memory is not None and size > bricks.memory:
        raise TooManyVoxelsError(
            f"{what} or more needs {memory.amount(size)}, {memory.amount(bricks.memory)} are "
            f"allowed; {REMEDY}"
        )
    memory.require_memory(size, what, REMEDY)


def visible_bricks(bricks: Bricks, transfer: Transfer, data_range: DataRange) -> list[Step]:
    """Return bricks that may have visible values; exact for types of few values."""
    least, greatest = bricks.ends
    is_seen = least <= greatest
    if are_few(bricks.dtype):
        info = np.iinfo(bricks.dtype)
        every = np.arange(info.min, info.max + 1).astype(bricks.dtype)
        seen = np.append(0, np.cumsum(transfer.opacities(every, data_range) > 0))
        low = np.where(is_seen, least, 0).astype(np.int64) - info.min
        high = np.where(is_seen, greatest, 0).astype(np.int64) - info.min
        is_seen &= seen[high + 1] > seen[low]
    else:
        values = np.where(is_seen, least, 0).astype(bricks.dtype)
        is_opaque = transfer.opacities(values.ravel(), data_range).reshape(values.shape) > 0
        is_seen &= is_opaque | (least < greatest)
    some = bricks.request
    chosen = [(int(z), int(y), int(x)) for z, y, x in np.argwhere(is_seen)]
    return [n for n in chosen if some is None or some.has_any(bricks.box(n))]


def _no_candidates(bricks: Bricks) -> Candidates:
    """Return empty typed arrays."""
    value = np.zeros(0, bricks.dtype)
    return Candidates(np.zeros(0, np.int64), value, np.zeros((0, 3), np.float32))


def near_to_each_other(part: Candidates, box: Box, size: Step) -> Candidates:
    """Return the voxels of a box of a volume (Z, Y, X), in the order of the painter's bricks."""
    from resample_volume.data.kernels.gradients import brick_order

    at = np.unravel_index(part.place, size)
    z, y, x = (n - side.start for n, side in zip(at, box, strict=True))
    own = [side.stop - side.start for side in box]
    order = np.empty(part.place.size, np.int64)
    brick_order((z * own[1] + y) * own[2] + x, (own[0], own[1], own[2]), order)
    slope = part.slope[order] if len(part.slope) else part.slope
    return Candidates(part.place[order], part.value[order], slope)


class _Window:
    """Sliding window of bricks: each is read once, slightly ahead, and released."""

    def __init__(
        self, part: OnGrid, chosen: Sequence[Step], pool: ThreadPoolExecutor, ahead: int
    ) -> None:
        bricks = part.bricks
        self._bricks, self._chosen, self._pool, self._ahead = bricks, chosen, pool, ahead
        self._held: dict[Step, Future[NDArray[Any]]] = {}
        is_needed = _with_those_beside(bricks, part.chosen if part.wanted.gradient else ())
        self._left = deque(index for index in bricks.all() if is_needed[index])

    def around(self, n: int) -> dict[Step, NDArray[Any]]:
        """Return brick n with adjacent ones; release bricks that no later one needs."""
        index, later = self._chosen[n], self._chosen[min(n + self._ahead, len(self._chosen) - 1)]
        last = (later[0] + 1, later[1] + 1, later[2] + 1)
        while self._left and self._left[0] <= last:
            following = self._left.popleft()
            self._held[following] = self._pool.submit(self._bricks.brick, following)
        first = (index[0] - 1, index[1] - 1, index[2] - 1)
        while self._held and (oldest := next(iter(self._held))) < first:
            del self._held[oldest]
        self._bricks.hold(len(self._held))
        beside = product(*(range(at - 1, at + 2) for at in index))
        return {at: self._held[at].result() for at in beside if at in self._held}


def _padded(
    box: Box, around: dict[Step, NDArray[Any]], bricks: Bricks
) -> tuple[NDArray[Any], list[int]]:
    """Return values of a box with a margin of one voxel, within the volume; and their origin."""
    padded = tuple(
        slice(max(most.start, part.start - 1), min(most.stop, part.stop + 1))
        for part, most in zip(box, bricks.limits, strict=True)
    )
    values = np.empty([side.stop - side.start for side in padded], bricks.dtype)
    for index, brick in around.items():
        copy_shared(values, padded, brick, bricks.box(index))
    return values, [side.start for side in padded]


def _visible(
    values: NDArray[Any], box: Box, corner: Sequence[int], bricks: Bricks, wanted: BrickClassifier
) -> Candidates:
    """Return the visible voxels of a box, from values that begin at a corner."""
    inner = tuple(slice(p.start - c, p.stop - c) for p, c in zip(box, corner, strict=True))
    own = np.ascontiguousarray(values[inner])
    flat = own.reshape(-1)
    local = visible_places(wanted.transfer, flat, wanted.data_range)
    within = np.unravel_index(local, own.shape)
    at = [n + part.start for n, part in zip(within, box, strict=True)]
    if bricks.request is not None:
        is_shown = bricks.request.holds(at)
        local, at = local[is_shown], [n[is_shown] for n in at]
    place = (at[0] * bricks.shape[1] + at[1]) * bricks.shape[2] + at[2]
    slope = np.empty((0, 3), np.float32)
    if wanted.gradient is not None:
        beside = [n - c for n, c in zip(at, corner, strict=True)]
        index = (beside[0] * values.shape[1] + beside[1]) * values.shape[2] + beside[2]
        slope = slopes_at(values, index, wanted.gradient, wanted.to_scene, aside=True)
    return Candidates(place, flat[local], slope)


def slopes_at(
    values: NDArray[Any], index: Indices, gradient: str, to_scene: Doubles, *, aside: bool = False
) -> Floats:
    """Return gradients (N, 3) at flat indices of values (Z, Y, X); see `visible.gradients_at`.

    `aside`: on one thread, as other threads work on other values.
    """
    from resample_volume.data.kernels.gradients import find_gradients

    slope, is_smooth = np.empty((index.size, 3), np.float32), gradient == "sobel"
    for voxels, near, first in kernel_layers(values, index):
        place, found = index[voxels] - first if first else index[voxels], slope[voxels]

        def fill(share: slice, near: Any = near, place: Any = place, found: Any = found) -> None:
            find_gradients(near, place[share], to_scene, is_smooth, found[share])

        if aside:
            fill(slice(None))
        else:
            side_by_side(fill, place.size)
    return slope


def _in_order(parts: list[Candidates], bricks: Bricks) -> Candidates:
    """Join the voxels of all bricks in the order of an array; parts are consumed."""
    from resample_volume.data.kernels.gradients import brick_order

    place = np.concatenate([part.place for part in parts])
    order = np.empty(place.size, np.int64)
    if all(side % 8 == 0 for side in bricks.side):
        brick_order(place, bricks.shape, order)
    else:  # a brick of the painter overlaps several bricks of the file
        ascending = np.argsort(place, kind="stable")
        brick_order(place[ascending], bricks.shape, order)
        order = ascending[order]
    value = np.concatenate([part.value for part in parts])[order]
    slope = np.concatenate([part.slope for part in parts])
    parts.clear()
    return Candidates(place[order], value, slope[order] if len(slope) else slope)
