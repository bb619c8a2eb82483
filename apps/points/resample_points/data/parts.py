"""Process clouds part by part, in memory or in memory-mapped files.

Code that uses such a cloud does not depend on where its arrays are stored, but processes them in
parts of `STEP` points, so that copies are small.
"""

import logging
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

from resample.memory import ALLOWED, amount, available_memory, memory_in_use
from resample.memory.mapped import array_in_file, array_like, folder, most_of
from resample.outofcore.passes import DIGIT, counts_by_digit, ranked, thread_pool
from resample_points.data.cloud import Cloud, some_of

Part = TypeVar("Part")

LOG = logging.getLogger("resample")
STEP = 1 << 18  # points per part
PER_POINT = 180  # most bytes per point in memory: read, prepared and painted
SIGN = np.uint64(1 << 63)  # bit of a float64
LEAST_SHARE = 8  # a cloud may take 1 / 8 of `--memory`, whatever else is in memory


class Storage(NamedTuple):
    """Storage of a cloud's arrays: memory or files."""

    points: int  # largest number of points
    pages: int | None  # bytes of pages in memory, of arrays in files; None: all are in memory
    what: str  # name of the cloud for messages

    def array(self, width: tuple[int, ...], kind: DTypeLike) -> NDArray[Any]:
        """Allocate an array (points, ...) of zeros."""
        shape = (self.points, *width)
        if self.pages is None or not self.points:
            return np.zeros(shape, kind)
        return array_in_file(shape, kind, self.pages, self.what)


def storage_for(count: int, what: str, hint: str = "") -> Storage:
    """Choose storage for a number of points; log it if it is in files."""
    left = memory_left()
    if left is None or count * PER_POINT <= left:
        return Storage(count, None, what)
    LOG.info(
        "%s has %s points, which would take %s of memory, and %s may be used: they are in files "
        "of %s meanwhile%s",
        *(what, f"{count:,}", amount(count * PER_POINT), amount(left), folder(), hint),
    )
    return Storage(count, left // 4, what)


def memory_left() -> int | None:
    """Return the bytes that a cloud may take; None if the platform does not tell."""
    allowed = ALLOWED.get()
    if allowed is None:
        return available_memory()
    return max(allowed - memory_in_use(), allowed // LEAST_SHARE)


class CloudBuilder:
    """Collector of a cloud that arrives in parts with the same columns."""

    def __init__(self, storage: Storage) -> None:
        self._storage = storage
        self._filled = 0
        self._arrays: dict[str, NDArray[Any]] = {}
        self._columns: dict[str, NDArray[Any]] = {}

    def add(self, part: Cloud) -> None:
        """Add the points of a part that have a finite position."""
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
        """Return all points added."""
        if not self._filled:
            raise ValueError("has no points")
        arrays = {name: array[: self._filled] for name, array in self._arrays.items()}
        columns = {name: array[: self._filled] for name, array in self._columns.items()}
        return Cloud(**arrays, columns=columns)


def rows_of(values: NDArray[Any]) -> Iterator[slice]:
    """Yield the rows of an array, `STEP` at a time."""
    for first in range(0, len(values), STEP):
        yield slice(first, min(first + STEP, len(values)))


def on_threads(work: Callable[[Part], None], parts: Iterable[Part]) -> None:
    """Run NumPy work for each part, on as many threads as kernels use."""
    from resample.engine.jit import workers

    with thread_pool(workers()) as pool:
        list(pool.map(work, parts))  # raises what work does


def zeros_beside(values: NDArray[Any], shape: tuple[int, ...], kind: DTypeLike) -> NDArray[Any]:
    """Allocate zeros in the same storage as `values`."""
    if most_of(values) is None or 0 in shape:
        return np.zeros(shape, kind)
    return array_like(values, shape, kind, "a cloud")


def span_in(values: NDArray[Any]) -> tuple[float, float] | None:
    """Return the least and greatest finite value of (N,); None if there are none."""
    low, high = np.inf, -np.inf
    for part in _finite(values):
        low, high = min(low, float(part.min())), max(high, float(part.max()))
    return (low, high) if low <= high else None


def quantile_of(values: NDArray[Any], share: float) -> float:
    """Return a quantile of the finite values of (N,); at least one must be finite.

    It interpolates linearly between values, as NumPy's `quantile` does.
    """
    if not 0.0 <= share <= 1.0:
        raise ValueError(f"a quantile of {share:g}; give a share from 0 to 1")
    count = sum(part.size for part in _finite(values))
    place = share * (count - 1)
    n, rest = int(place), place - int(place)

    def counted(prefix: int, digit: int) -> NDArray[np.int64]:
        counts = np.zeros(1 << DIGIT, np.int64)
        for part in _finite(values):
            bits = (part + 0.0).view(np.uint64)  # -0 is 0
            ordered = np.where(bits & SIGN, ~bits, bits | SIGN)  # as values are
            counts += counts_by_digit(ordered, prefix, digit)
        return counts

    bits = np.array(ranked([n, min(n + 1, count - 1)], counted, 4), np.uint64)
    low, high = map(float, np.where(bits & SIGN, bits ^ SIGN, ~bits).view(np.float64))
    return low + (high - low) * rest if rest < 0.5 else high - (high - low) * (1.0 - rest)


def _finite(values: NDArray[Any]) -> Iterator[NDArray[np.float64]]:
    """Yield the finite values, part by part."""
    for rows in rows_of(values):
        part = np.asarray(values[rows], np.float64)
        part = part[np.isfinite(part)]
        if part.size:
            yield part
