"""A look at all values in bricks, by this process or by several.

Each looks at some layers of bricks. What they find are ends of values, counts and values
themselves, so that parts put together in their order are the whole, bit by bit, whoever found them.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from itertools import pairwise, product
from math import prod
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles
from resample.watching import Executor, look, shared_out

Step = tuple[int, int, int]  # z, y, x
Box = tuple[slice, slice, slice]  # z, y, x
R = TypeVar("R")

SAMPLED = 2e6  # voxels that the distribution of floating-point values is taken from
LITTLE = 1 << 21  # values that NumPy has counted before OpenCV is imported
PARTS = 16  # that several processes look at


class Glance(NamedTuple):
    """What is known of the values of bricks after each was read once."""

    least: Doubles  # (Z, Y, X) of each brick's finite values; inf where there is none
    greatest: Doubles  # (Z, Y, X) likewise; -inf
    infinite: int  # voxels
    missing: int  # voxels
    some: NDArray[Any]  # every so many voxels along each axis, see `step_of`
    rim: NDArray[Any]  # (N,) all on the six sides
    beyond: NDArray[Any]  # finite values outside of the range of `some`; none of few
    codes: NDArray[np.int64] | None  # how often each value occurs, by its bits, where these are few


class Helpers(NamedTuple):
    """Who looks at parts."""

    executor: Executor
    threads: int | None  # of each part; None: all


class InBricks(Protocol):
    """What is looked at: `bricks.Bricks`, which pickle for other processes."""

    shape: Step
    dtype: np.dtype[Any]
    reads: int

    @property
    def count(self) -> Step:
        """Bricks along z, y and x."""
        ...

    def box(self, index: Step) -> Box:
        """Voxels of a brick."""
        ...

    def brick(self, index: Step) -> NDArray[Any]:
        """Values of a brick."""
        ...

    def anew(self) -> "InBricks":
        """The same, which counts its own reads."""
        ...

    def each(self, job: Callable[[Step], R], indices: Sequence[Step]) -> Iterator[R]:
        """What a job gives for bricks, in their order."""
        ...


class _Layers(NamedTuple):
    """What was found in some layers of bricks."""

    least: Doubles
    greatest: Doubles
    infinite: int
    missing: int
    some: NDArray[Any]
    sides: list[NDArray[Any]]  # two along each axis; of others than the outermost layers none of z
    codes: NDArray[np.int64] | None
    reads: int


def looked_at(bricks: InBricks, helpers: Helpers | None = None) -> Glance:
    """What a look at all values finds; each brick is read once, some of floating-point twice.

    Parameters
    ----------
    bricks
        Values.
    helpers
        Who looks at parts; None: this process at all. A part may be looked at again, if who did
        it ended.
    """
    executor, threads = helpers or (None, None)
    layers, _, _ = bricks.count
    cuts = sorted({layers * n // PARTS for n in range(PARTS + 1)})
    spans = [(0, layers)] if executor is None else list(pairwise(cuts))
    found: list[_Layers] = []
    for part in shared_out(executor, partial(_look_at_layers, bricks, threads), spans):
        found.append(part)
        bricks.reads += part.reads
        look(spans[len(found) - 1][1], layers)
    least, greatest, some = (np.concatenate([part[n] for part in found]) for n in (0, 1, 4))
    codes = [part.codes for part in found if part.codes is not None]
    beyond = _beyond(bricks, least, greatest, some, helpers)
    return Glance(
        least,
        greatest,
        sum(part.infinite for part in found),
        sum(part.missing for part in found),
        some,
        _rim(found),
        beyond,
        np.sum(codes, axis=0) if codes else None,
    )


def _rim(found: list[_Layers]) -> NDArray[Any]:
    """All values on the six sides, of layers in their order."""
    across = [
        np.concatenate([part.sides[n] for part in found]) for n in range(2, len(found[0].sides))
    ]
    ends = [found[0].sides[0], found[-1].sides[1]]
    return np.concatenate([side.ravel() for side in (*ends, *across)])


def _look_at_layers(bricks: InBricks, threads: int | None, span: tuple[int, int]) -> _Layers:
    """What is found in layers of bricks from one to before another."""
    own, (first, last), (_, down, across) = bricks.anew(), span, bricks.count
    indices = list(product(range(first, last), range(down), range(across)))
    low, high = bricks.box(indices[0])[0].start, bricks.box(indices[-1])[0].stop
    shape, step = (high - low, *bricks.shape[1:]), step_of(prod(bricks.shape))
    planes = range(-(-low // step), -(-high // step))
    some = np.empty((len(planes), *(-(-size // step) for size in shape[1:])), bricks.dtype)
    sides = [np.empty(shape[:n] + shape[n + 1 :], bricks.dtype) for n in (0, 0, 1, 1, 2, 2)]
    least, greatest = np.full((2, last - first, down, across), [[[[np.inf]]], [[[-np.inf]]]])
    few = are_few(bricks.dtype)
    codes = np.zeros(1 << 8 * bricks.dtype.itemsize, np.int64) if few else None

    def see(index: Step) -> tuple[int, int, NDArray[np.int64] | None]:
        values, box = own.brick(index), own.box(index)
        at = (index[0] - first, *index[1:])
        least[at], greatest[at], infinite, missing = extent(values)
        _keep_some(some, values, box, step, planes.start)
        inner = (slice(box[0].start - low, box[0].stop - low), *box[1:])
        for axis, end in product(range(3), (0, 1)):
            if inner[axis].start == 0 if end == 0 else inner[axis].stop == shape[axis]:
                others = tuple(part for n, part in enumerate(inner) if n != axis)
                sides[2 * axis + end][others] = values.take(-end, axis)
        return infinite, missing, count_codes(values) if few else None

    infinite = missing = 0
    with _on(threads):
        for n, (more, none, counted) in enumerate(own.each(see, indices)):
            look(n + 1, len(indices))
            infinite, missing = infinite + more, missing + none
            if codes is not None and counted is not None:
                codes += counted
    for side, is_outer in ((0, low == 0), (1, high == bricks.shape[0])):
        sides[side] = sides[side] if is_outer else sides[side][:0]
    return _Layers(least, greatest, infinite, missing, some, sides, codes, own.reads)


def _beyond(
    bricks: InBricks,
    least: Doubles,
    greatest: Doubles,
    some: NDArray[Any],
    helpers: Helpers | None,
) -> NDArray[Any]:
    """Finite values outside of the range of a sample, of bricks with such ends."""
    if are_few(bricks.dtype):
        return some[:0].ravel()
    low, high, *_ = extent(some)
    chosen = [
        (int(z), int(y), int(x)) for z, y, x in np.argwhere((least < low) | (greatest > high))
    ]
    executor, threads = helpers or (None, None)
    cuts = sorted({len(chosen) * n // PARTS for n in range(PARTS + 1)})
    parts = [chosen[first:last] for first, last in pairwise(cuts)]
    found = [some[:0].ravel()]
    for values, reads in shared_out(
        executor, partial(_look_beyond, bricks, threads, (low, high)), parts
    ):
        found.append(values)
        bricks.reads += reads
        look(len(found) - 1, len(parts))
    return np.concatenate(found)


def _look_beyond(
    bricks: InBricks, threads: int | None, ends: tuple[float, float], chosen: list[Step]
) -> tuple[NDArray[Any], int]:
    """Finite values of some bricks that are not between two ends, and how many were read."""
    own, (low, high) = bricks.anew(), ends

    def see(index: Step) -> NDArray[Any]:
        values = own.brick(index)
        return np.asarray(values[((values < low) | (values > high)) & np.isfinite(values)])

    with _on(threads):
        found = np.concatenate(list(own.each(see, chosen)))
    return found, own.reads


def _on(count: int | None) -> AbstractContextManager[None]:
    """At most so many threads; None: as many as there are here."""
    from resample.engine.jit import threads

    return nullcontext() if count is None else threads(count)


def step_of(size: int) -> int:
    """Voxels from one to the next that a sample of so many is made of."""
    return max(1, int(np.cbrt(size / SAMPLED)))


def are_few(dtype: np.dtype[Any]) -> bool:
    """Whether there are few possible values of a type."""
    return dtype.kind in "iu" and dtype.itemsize <= 2


def count_codes(values: NDArray[Any], *, of: int | None = None) -> NDArray[np.int64]:
    """How often each of few possible values occurs, by its bits.

    Parameters
    ----------
    values
        What is counted.
    of
        How many values are counted in all, where these are a part. OpenCV is ten times as quick as
        NumPy, and not worth its import where they are few.
    """
    size = 1 << (values.dtype.itemsize * 8)
    code = np.ascontiguousarray(values).view(f"u{values.dtype.itemsize}").reshape(1, -1)
    if of is not None and of <= LITTLE:
        return np.bincount(code[0], minlength=size)
    import cv2

    count = cv2.calcHist([code], [0], None, [size], [0, size])
    return np.asarray(count.ravel().astype(np.int64))


def extent(values: NDArray[Any]) -> tuple[float, float, int, int]:
    """Least and greatest finite value, and how many are infinite and missing."""
    if values.dtype.kind in "iu":
        return float(values.min()), float(values.max()), 0, 0
    is_finite = np.isfinite(values)
    known = values if is_finite.all() else values[is_finite]
    missing = int(np.isnan(values).sum()) if known.size < values.size else 0
    infinite = values.size - known.size - missing
    if not known.size:
        return np.inf, -np.inf, infinite, missing
    return float(known.min()), float(known.max()), infinite, missing


def _keep_some(some: NDArray[Any], values: NDArray[Any], box: Box, step: int, plane: int) -> None:
    """Put those of a brick's values into a sample, which begins at a plane, that belong there."""
    starts = [-(-part.start // step) for part in box]
    firsts = [n * step - part.start for n, part in zip(starts, box, strict=True)]
    found = values[tuple(slice(first, None, step) for first in firsts)]
    starts[0] -= plane
    ends = [n + size for n, size in zip(starts, found.shape, strict=True)]
    some[tuple(map(slice, starts, ends))] = found
