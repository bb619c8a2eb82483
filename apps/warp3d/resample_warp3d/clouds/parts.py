"""Clouds part by part: in arrays that lie in memory or, where it does not hold them, in files.

Who takes such a cloud need not know where its arrays lie, but goes through them in parts of `STEP`
points, so that copies are small.
"""

import logging
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

from resample.memory import ALLOWED, amount, available_memory, held
from resample.memory.mapped import array_in_file, array_like, folder, most_of
from resample_warp3d.clouds.cloud import Cloud, some_of

Part = TypeVar("Part")

LOG = logging.getLogger("resample")
STEP = 1 << 18  # points that are looked at together
PER_POINT = 180  # bytes that a point takes in memory at most: read, measured and painted
MOST_SORTED = 1 << 20  # values that are put in order at once
RANGES = 1024  # that values are counted in
LEAST_SHARE = 8  # part of `--memory` that a cloud may take, whatever else is in memory


class Storage(NamedTuple):
    """Where the arrays of a cloud lie."""

    points: int  # at most
    pages: int | None  # bytes of pages in memory, of arrays in files; None: all are in memory
    what: str  # name of the cloud for messages

    def array(self, width: tuple[int, ...], kind: DTypeLike) -> NDArray[Any]:
        """Array (points, ...) of zeros.

        Raises
        ------
        ValueError
            Neither memory nor the disk holds it.
        """
        shape = (self.points, *width)
        if self.pages is None or not self.points:
            return np.zeros(shape, kind)
        return array_in_file(shape, kind, self.pages, self.what)


def storage_for(count: int, what: str, hint: str = "") -> Storage:
    """Where a cloud of so many points lies; files, which is said, if memory does not hold it.

    Parameters
    ----------
    count
        Points at most.
    what
        Name of the cloud for messages.
    hint
        What else could be done where memory does not hold it.
    """
    left = memory_left()
    if left is None or count * PER_POINT <= left:
        return Storage(count, None, what)
    LOG.info(
        "%s has %s points, which would take %s of memory, and %s may be taken: they are in files "
        "of %s meanwhile%s",
        *(what, f"{count:,}", amount(count * PER_POINT), amount(left), folder(), hint),
    )
    return Storage(count, left // 4, what)


def memory_left() -> int | None:
    """Bytes that a cloud may take, beside what is in memory; None where the platform is silent."""
    allowed = ALLOWED.get()
    if allowed is None:
        return available_memory()
    return max(allowed - held(), allowed // LEAST_SHARE)


class Gathering:
    """A cloud that comes in parts, all with the same columns."""

    def __init__(self, storage: Storage) -> None:
        self._storage = storage
        self._filled = 0
        self._arrays: dict[str, NDArray[Any]] = {}
        self._columns: dict[str, NDArray[Any]] = {}

    def add(self, part: Cloud) -> None:
        """Take the points of a part that have a place.

        Raises
        ------
        ValueError
            The disk has no room for them.
        """
        known = np.asarray(np.isfinite(part.position).all(axis=1))
        kept = part if known.all() else some_of(part, known)
        rows = slice(self._filled, self._filled + len(kept.position))
        for name in ("position", "normal", "color", "radius"):
            is_there = name == "position" or len(getattr(part, name)) > 0
            self._put(self._arrays, name, rows if is_there else slice(0), getattr(kept, name))
        for name, column in kept.columns.items():
            self._put(self._columns, name, rows, column)
        self._filled = rows.stop

    def _put(
        self, arrays: dict[str, NDArray[Any]], name: str, rows: slice, given: NDArray[Any]
    ) -> None:
        if name not in arrays:
            storage = self._storage
            if rows.start is None:
                storage = storage._replace(points=0)
            arrays[name] = storage.array(given.shape[1:], given.dtype)
        arrays[name][rows] = given

    def cloud(self) -> Cloud:
        """All that was taken.

        Raises
        ------
        ValueError
            There are no points.
        """
        if not self._filled:
            raise ValueError("has no points")
        arrays = {name: array[: self._filled] for name, array in self._arrays.items()}
        columns = {name: array[: self._filled] for name, array in self._columns.items()}
        return Cloud(**arrays, columns=columns)


def rows_of(values: NDArray[Any]) -> Iterator[slice]:
    """Rows of an array, so many at a time as are looked at together."""
    for first in range(0, len(values), STEP):
        yield slice(first, min(first + STEP, len(values)))


def on_threads(work: Callable[[Part], None], parts: Iterable[Part]) -> None:
    """Do a piece of work of NumPy for each of some parts, on as many threads as kernels take."""
    from resample.engine.jit import workers

    with ThreadPoolExecutor(workers()) as pool:
        list(pool.map(work, parts))  # raises what work does


def room_beside(values: NDArray[Any], shape: tuple[int, ...], kind: DTypeLike) -> NDArray[Any]:
    """Array of zeros for what is made of values, which lies where these do.

    Raises
    ------
    ValueError
        The disk has no room for it.
    """
    if most_of(values) is None or 0 in shape:
        return np.zeros(shape, kind)
    return array_like(values, shape, kind, "a cloud")


def span_in(values: NDArray[Any]) -> tuple[float, float] | None:
    """Least and greatest of those values (N,) that are finite; None if there are none."""
    low, high = np.inf, -np.inf
    for part in _finite(values):
        low, high = min(low, float(part.min())), max(high, float(part.max()))
    return (low, high) if low <= high else None


def quantile_of(values: NDArray[Any], share: float) -> float:
    """Quantile of those values (N,) that are finite, of which there is one at least.

    Between two values it is linear, as of NumPy's `quantile`.

    Raises
    ------
    ValueError
        The share is not from 0 to 1.
    """
    if not 0.0 <= share <= 1.0:
        raise ValueError(f"a quantile of {share:g}; give a share from 0 to 1")
    count = sum(part.size for part in _finite(values))
    place = share * (count - 1)
    n, rest = int(place), place - int(place)
    low, high = _ranked(values, n), _ranked(values, min(n + 1, count - 1))
    return low + (high - low) * rest if rest < 0.5 else high - (high - low) * (1.0 - rest)


def _ranked(values: NDArray[Any], rank: int) -> float:
    """That finite value of all, in order, which has so many before it.

    The range that it lies in is made closer, until its values are few.
    """
    low, high = span_in(values) or (0.0, 0.0)
    while True:
        count = sum(int(((part >= low) & (part <= high)).sum()) for part in _finite(values))
        if low == high or count <= MOST_SORTED:
            break
        share = np.arange(1, RANGES) / RANGES
        edges = np.maximum.accumulate(low * (1.0 - share) + high * share)
        edges[-1] = high  # so that not all are in one range
        held = np.zeros(RANGES, np.int64)
        for part in _finite(values):
            inside = part[(part >= low) & (part <= high)]
            held += np.bincount(np.searchsorted(edges, inside, "right"), minlength=RANGES)
        which = int(np.searchsorted(np.cumsum(held), rank, "right"))
        rank -= int(held[:which].sum())
        ends = np.concatenate([[low], edges, [np.nextafter(high, np.inf)]])
        least, most = np.inf, -np.inf
        for part in _finite(values):
            inside = part[(part >= ends[which]) & (part < ends[which + 1])]
            least = min(least, float(inside.min(initial=np.inf)))
            most = max(most, float(inside.max(initial=-np.inf)))
        low, high = least, most
    few = [part[(part >= low) & (part <= high)] for part in _finite(values)] if low < high else []
    return float(np.sort(np.concatenate(few))[rank]) if few else low


def _finite(values: NDArray[Any]) -> Iterator[NDArray[np.float64]]:
    """Finite values, some at a time."""
    for rows in rows_of(values):
        part = np.asarray(values[rows], np.float64)
        part = part[np.isfinite(part)]
        if part.size:
            yield part
