"""Zarr arrays as volumes, with chunks read on demand."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from resample.files.stores.metadata import Holes, values_of
from resample.files.stores.opening import Place, reading
from resample.outofcore.bricks import Box, Step
from resample_volume.data.bricks import Bricks
from resample_volume.data.values import Stored
from resample_volume.files.parsing.headers import WIDENED
from resample_volume.files.stores.statistics_cache import Portion, StoredStatistics

if TYPE_CHECKING:
    import zarr

ORDER = "tczyx"
SIDE = 64  # voxels; smaller chunks are read together


@dataclass(frozen=True, eq=False)
class Single:
    """One volume as (1, 1, Z, Y, X), also if its values stay in a file."""

    values: Stored

    @property
    def shape(self) -> tuple[int, ...]:
        """Elements along all five axes."""
        return (1, 1, *self.values.shape)

    @property
    def dtype(self) -> np.dtype[Any]:
        """Of the voxels."""
        return self.values.dtype

    def swapaxes(self, _first: int, _second: int, /) -> "Single":
        """Return it as it is."""
        return self

    def __getitem__(self, _: tuple[int, int]) -> Stored:
        return self.values


@dataclass(frozen=True, eq=False)
class Boxes:
    """Reads boxes of one time and channel of an array, in any process."""

    array: "zarr.Array[Any]"  # array of a store opened by its path
    axes: str  # its letters
    at: tuple[tuple[str, int], ...]  # time and channel
    dtype: np.dtype[Any]  # that voxels get
    holes: Holes | None = None  # what is missing of the array

    def __setstate__(self, state: dict[str, Any]) -> None:
        from resample.files.stores.guarding import guard

        self.__dict__.update(state)
        guard(self.array, self.array.name)  # shards forget it on their way

    def __call__(self, box: Box) -> NDArray[Any]:
        """Read the values (Z, Y, X) of a box."""
        space = [letter for letter in self.axes if letter in "zyx"]
        part = dict(self.at) | dict(zip("zyx", box, strict=True))
        with reading(self.array.name.strip("/") or "the array"):
            found = values_of(self.array, self.holes, [part[letter] for letter in self.axes])
        turned = found.transpose([space.index(letter) for letter in "zyx"])
        return np.ascontiguousarray(turned, self.dtype)


@dataclass(frozen=True, eq=False)
class StackedBoxes:
    """Reads boxes of several volumes stacked along z."""

    reads: tuple[Callable[[Box], NDArray[Any]], ...]
    depth: int  # voxels along z, of each

    def __call__(self, box: Box) -> NDArray[Any]:
        """Read the values (Z, Y, X) of a box within one of them."""
        number, start = divmod(box[0].start, self.depth)
        own = slice(start, start + box[0].stop - box[0].start)
        found: NDArray[Any] = self.reads[number]((own, box[1], box[2]))
        return found


@dataclass(frozen=True, eq=False)
class Chunked:
    """An array as (T, C, Z, Y, X), with the interface that `recordings.volume_at` needs.

    Indexing by time and channel gives a volume as `Bricks`.
    """

    array: "zarr.Array[Any]"
    axes: str  # its letters, see `metadata.Layout`
    order: str = ORDER  # of the first two; swapped they are "ct"
    brick: Step | None = None  # voxels read together; None: by chunks
    store: Place | None = None  # folder, zip file or address whose statistics are cached
    alone: tuple[str, int] | None = None  # the only time or channel
    holes: Holes | None = None  # what is missing of the array

    @property
    def shape(self) -> tuple[int, ...]:
        """Elements along the axes of `order`."""
        return tuple(self._along(letter) for letter in self.order)

    @property
    def dtype(self) -> np.dtype[Any]:
        """Of the voxels as a volume has them."""
        own: np.dtype[Any] = np.dtype(self.array.dtype).newbyteorder("=")
        return np.dtype(WIDENED.get(own.name, own.name))

    def swapaxes(self, first: int, second: int, /) -> "Chunked":
        """Return a view with times and channels swapped."""
        letters = list(self.order)
        letters[first], letters[second] = letters[second], letters[first]
        return replace(self, order="".join(letters))

    def only(self, number: int) -> "Chunked":
        """Return a view of one index of the second axis."""
        return replace(self, alone=(self.order[1], number))

    def __getitem__(self, chosen: int | tuple[int, int]) -> "NDArray[Any] | Bricks":
        if isinstance(chosen, tuple):
            return self._bricks(dict(zip(self.order, chosen, strict=False)))
        first, second = self.order[0], self.order[1]
        parts = [
            self._bricks({first: chosen, second: n}).whole() for n in range(self._along(second))
        ]
        return np.stack(parts)

    def stacked_along_z(self) -> Bricks:
        """Stack all volumes of the first axis along z, if the second has length 1.

        Its bricks are those of the volumes.
        """
        first, second = self.order[0], self.order[1]
        every = [self._bricks({first: n, second: 0}) for n in range(self._along(first))]
        (depth, *across), reads = every[0].shape, tuple(one.read for one in every)
        rest = () if self.alone is None else (self.alone,)
        statistics_cache = None
        if self.store is not None:
            statistics_cache = StoredStatistics(self.store, Portion(self.array, self.axes, rest))
        shape = (depth * len(every), across[0], across[1])
        return Bricks(
            StackedBoxes(reads, depth),
            shape,
            self.dtype,
            every[0].side,
            statistics_cache=statistics_cache,
            period=depth,
        )

    def _along(self, letter: str) -> int:
        if self.alone is not None and letter == self.alone[0]:
            return 1
        return int(self.array.shape[self.axes.index(letter)]) if letter in self.axes else 1

    def _bricks(self, at: dict[str, int]) -> Bricks:
        """Return the volume of one time and channel."""
        shape = (self._along("z"), self._along("y"), self._along("x"))
        at |= {} if self.alone is None else dict([self.alone])
        boxes = Boxes(self.array, self.axes, tuple(at.items()), self.dtype, self.holes)
        part = Portion(self.array, self.axes, boxes.at)
        statistics_cache = None if self.store is None else StoredStatistics(self.store, part)
        side = self.brick or self._side(shape)
        return Bricks(boxes, shape, self.dtype, side, statistics_cache=statistics_cache)

    def _side(self, shape: Step) -> Step:
        """Return a brick size of whole chunks along z, y and x, about `SIDE` voxels."""
        own = dict(zip(self.axes, self.array.chunks, strict=True))
        sides = [max(1, SIDE // own[letter]) * own[letter] for letter in "zyx"]
        z, y, x = (min(side, size) for side, size in zip(sides, shape, strict=True))
        return z, y, x
