"""Read and write pictures as zarr arrays and OME-Zarr images."""

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import zarr
from numpy.typing import NDArray

from resample.files.stores import Part, Place
from resample.files.writing import beside, unwritten
from resample.memory.mapped import array_where_it_fits
from resample_zarr.guarding import guard
from resample_zarr.metadata import Holes, holes_of, layout_of, values_of, warned
from resample_zarr.opening import open_node, reading, reading_metadata

SIDE = 256  # px, of written chunks
NAMES = {1: ("Y",), 3: ("R", "G", "B"), 4: ("R", "G", "B", "A")}  # channels, by their count
LETTERS = {2: "yx", 3: "yxc"}  # default axes by number of dimensions
DEPTHS = {"uint8": 8, "uint16": 16, "float16": 32, "float32": 32, "float64": 32}  # bits


class StoredPicture(NamedTuple):
    """A picture in chunks."""

    array: Any  # of zarr
    axes: str  # letters y, x and optional c, z and t, in the order of the array
    name: str
    holes: Holes | None = None  # missing chunks

    @property
    def shape(self) -> tuple[int, int, int]:
        """Height, width and number of channels."""
        size = dict(zip(self.axes, map(int, self.array.shape), strict=True))
        return size["y"], size["x"], size.get("c", 1)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels."""
        return NAMES[self.shape[2]]

    @property
    def bits(self) -> int:
        """Bits of a value: 8, 16, or 32 for floats."""
        return DEPTHS[self.array.dtype.name]

    def rows(self, first: int, last: int, across: slice = slice(None)) -> NDArray[Any]:
        """Read rows (N, W, C), or some of their columns, as stored; floats have at most 32 bits."""
        _, width, channels = self.shape
        part = {"y": slice(first, last), "x": slice(*across.indices(width)[:2])}
        part["c"] = slice(0, channels)
        with reading(self.name):
            found = values_of(self.array, self.holes, [part.get(axis, 0) for axis in self.axes])
        left = [letter for letter in self.axes if letter in "yxc"]
        found = found.reshape(*found.shape, 1) if "c" not in left else found
        order = [[*left, *("c" * ("c" not in left))].index(letter) for letter in "yxc"]
        turned = np.ascontiguousarray(found.transpose(order))
        return turned.astype(np.float32) if turned.dtype.itemsize == 8 else turned

    def strips(self, seen: Part | None = None) -> Iterator[NDArray[Any]]:
        """Read all rows, or those of a part, one row of chunks at a time; errors as in `rows`."""
        down, across = seen or (slice(0, self.shape[0]), slice(None))
        step = max(1, self.array.chunks[self.axes.index("y")])
        ends = [*range(down.start // step * step + step, down.stop, step), down.stop]
        return (self.rows(*pair, across) for pair in pairwise([down.start, *ends]))

    def levels(self, seen: Part | None = None) -> NDArray[Any]:
        """Read all rows (H, W, C) to memory or to a file, see `array_where_it_fits`.

        With `seen`, only that part is defined.
        """
        stored = self.array.dtype
        kind = np.dtype(np.float32) if stored.itemsize == 8 else stored.newbyteorder("=")
        levels = array_where_it_fits(self.shape, kind, self.name)
        wanted, done = levels if seen is None else levels[seen], 0
        for rows in self.strips(seen):
            wanted[done : done + len(rows)] = rows
            done += len(rows)
        return levels


def open_picture(path: Place) -> StoredPicture:
    """Open a picture in a zarr store; for OME-Zarr the finest level."""
    node, name = open_node(path), path.name
    if isinstance(node, zarr.Array):
        named = getattr(node.metadata, "dimension_names", None) or ()
        letters = "".join(str(axis).lower()[:1] for axis in named)
        axes = letters if set(letters) >= set("yx") else LETTERS.get(node.ndim, "")
        array = node
    else:
        layout = layout_of(dict(node.attrs), name, "yx")
        if layout is None:
            raise ValueError(f"{name} is a group without multiscales; name one of its arrays")
        axes, held = layout.axes, layout.levels[0].path
        with reading_metadata(f"{name}/{held}"):
            array = node.get(held)
        if not isinstance(array, zarr.Array):
            raise ValueError(f"{name} names a level {held!r}, which is not there; is it whole?")
    # Check that an array can be a picture.
    found = StoredPicture(array, axes, name)
    array, axes, name, _ = found
    sizes = " x ".join(map(str, array.shape))
    if len(axes) != array.ndim or len(set(axes)) < len(axes) or not set(axes) <= set("yxczt"):
        raise ValueError(f"{name} is an array {sizes}; a picture is (y, x), or (y, x, channels)")
    others = [letter for letter in axes if letter not in "yxc"]
    if any(array.shape[axes.index(letter)] != 1 for letter in others):
        raise ValueError(
            f"{name} is an array {sizes} ({', '.join(axes)}), not a single picture; volumes are "
            "for resample-volume"
        )
    if min(array.shape) < 1 or min(array.chunks, default=0) < 1:
        raise ValueError(f"{name} is an array {sizes} in chunks of {array.chunks}; get it again")
    if found.shape[2] not in NAMES:
        raise ValueError(
            f"{name} has {found.shape[2]} channels; 1, 3 (RGB) or 4 (RGBA) are supported"
        )
    if array.dtype.name not in DEPTHS:
        raise ValueError(f"{name} is of {array.dtype}; supported are {', '.join(DEPTHS)}")
    guard(array, name)
    holes = holes_of(array, name)
    if line := holes.message(array.fill_value):
        warned(f"{name}: {line}")
    return found._replace(holes=holes)


def check_store(path: Path) -> None:
    """Reject a store that could not be written, before any work is done."""
    if path.exists():
        raise ValueError(f"{path} already exists; remove it or give another name")


@contextmanager
def writing_store(path: Path, height: int) -> "Iterator[StoreRows]":
    """Write a picture of `height` rows; the store appears when the block succeeds.

    Yields: the object that takes the rows from the top.
    """
    check_store(path)
    try:
        with beside(path) as temporary:
            rows = StoreRows(temporary, height)
            yield rows
            rows.close()
            temporary.rename(path)
    except OSError as error:
        raise unwritten(path, error) from None


class StoreRows:
    """A store that is written chunk by chunk."""

    def __init__(self, temporary: Path, height: int) -> None:
        self.temporary, self.height = temporary, height
        self.done = 0  # rows written
        self.waiting: list[NDArray[Any]] = []
        self.array: Any = None

    def put(self, data: NDArray[Any]) -> None:
        """Write the next rows (N, W, C)."""
        if self.array is None:
            _, width, count = data.shape
            shape = (self.height, width, count)[: 2 + (count > 1)]
            self.array = zarr.create_array(
                self.temporary,
                shape=shape,
                chunks=tuple(map(min, (SIDE, SIDE, count), shape)),
                dtype=data.dtype,
                dimension_names=["y", "x", "c"][: len(shape)],
                zarr_format=3,
            )
        self.waiting.append(data)
        held = np.concatenate(self.waiting) if len(self.waiting) > 1 else data
        whole = len(held) // SIDE * SIDE
        self._write(held[:whole])
        self.waiting = [held[whole:]]

    def close(self) -> None:
        """Write remaining rows."""
        for rows in self.waiting:
            self._write(rows)
        if self.done != self.height:
            raise ValueError(f"only {self.done} of {self.height} rows were given")

    def _write(self, rows: NDArray[Any]) -> None:
        last = self.done + len(rows)
        if len(rows):
            self.array[self.done : last] = rows[..., 0] if self.array.ndim == 2 else rows
        self.done = last


class Stores:
    """Pictures of zarr, as `resample.files.stores.StoreFormat` has them."""

    open_picture = staticmethod(open_picture)
    check_store = staticmethod(check_store)
    writing_store = staticmethod(writing_store)
