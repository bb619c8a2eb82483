"""OME-Zarr and plain zarr arrays as volumes: chunks on demand, and cached statistics of them."""

import json
import logging
import math
import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import sha256
from itertools import islice, product
from pathlib import Path, PurePath
from typing import Any, ClassVar, NamedTuple

import numpy as np
import zarr
from numpy.typing import NDArray

from resample.files.stores import Address, Place
from resample.files.writing import load_arrays, store_arrays
from resample.memory.mapped import folder
from resample.outofcore.bricks import Box, Step
from resample.progress import report
from resample.reading.limits import check_free
from resample_volume.data import scanning
from resample_volume.data.recordings import alone
from resample_volume.data.scanning import BrickStats, are_few, step_of
from resample_volume.data.values import Bricks, Stored, require_memory
from resample_volume.files.headers import (
    WIDENED,
    Check,
    VolumeHeader,
    accept_any,
    check_alone,
    check_not_empty,
    header,
    stem,
)
from resample_volume.files.texts import Numbers, spacing_of
from resample_volume.types import UNKNOWN, VOXEL, ChannelLook, Recording, Volume
from resample_zarr.guarding import guard
from resample_zarr.metadata import (
    SPACE,
    Holes,
    Layout,
    Level,
    holes_of,
    layout_of,
    moved,
    values_of,
)
from resample_zarr.opening import open_node, reading, reading_metadata

RECENT = 2.0  # seconds in which a file may change without a new timestamp
SETTLED = 3600.0  # the same for web servers, as their clocks may differ, seconds
BATCH_SIZE = 32  # chunks that a web server is asked about at a time
PAGE = 1000  # that are listed, or asked about, before work looks up
FORM = 2  # of the cache files
LOG = logging.getLogger("resample")


class Portion(NamedTuple):
    """Times and channels of an array."""

    array: zarr.Array[Any]
    axes: str  # its letters
    at: tuple[tuple[str, int], ...]  # chosen indices; all of an axis that is not named


class State(NamedTuple):
    """State of chunks."""

    mark: str  # which changes with every change, if it is settled
    is_settled: bool  # whether any further change would be noticed


class ChunkMetadata(NamedTuple):
    """A server's metadata of a chunk."""

    name: str
    size: int
    tag: str  # none: ""
    changed: float  # seconds since 1970; none: 0


def state_of_files(store: Path, array: str) -> State | None:
    """Return the state of an array on disk, from names, sizes and times of its files.

    It is settled if none of them was just written.
    """
    digest, newest = sha256(), 0.0
    before = time.time() - RECENT
    with suppress(OSError):
        for path in _files(store, array):
            known, name = os.stat(path), os.path.relpath(path, store)
            newest = max(newest, known.st_mtime)
            stamp = f"{name}\0{known.st_size}\0{known.st_mtime_ns}\0"
            digest.update(os.fsencode(stamp))
        return State(digest.hexdigest(), newest < before)
    return None


def _state(portion: Portion, chunks: Iterator[ChunkMetadata], *, is_web: bool) -> State | None:
    """Return the state from chunks' metadata, if sufficient; times suffice for web servers only."""
    metadata: Any = portion.array.metadata
    digest = sha256(json.dumps(metadata.to_dict(), sort_keys=True, default=str).encode())
    newest, before = 0.0, time.time() - SETTLED
    try:
        for chunk in chunks:
            is_tagged = bool(chunk.tag) and not chunk.tag.startswith("W/")
            if not (is_tagged or (is_web and chunk.changed > 0)):
                return None
            newest = max(newest, chunk.changed)
            digest.update(f"{chunk.name}\0{chunk.size}\0{chunk.tag}\0{chunk.changed}\0".encode())
    except Exception as error:
        if isinstance(error, OSError) or type(error).__module__.startswith("obstore"):
            return None  # the server does not tell
        raise
    return State(digest.hexdigest(), not is_web or newest < before)


def _listed(place: Any, portion: Portion) -> Iterator[ChunkMetadata]:
    """List all objects of an array, by name."""
    import obstore

    pages = obstore.list(place, portion.array.path or None, chunk_size=PAGE)
    found = sorted(_chunk_metadata(facts["path"], facts) for page in pages for facts in page)
    if not found:
        raise FileNotFoundError("not even metadata")
    yield from found


def _request_metadata(place: Any, portion: Portion) -> Iterator[ChunkMetadata]:
    """Return the existing chunks of a part, in order; one request each."""
    import obstore

    def head(name: str) -> ChunkMetadata | None:
        try:
            return _chunk_metadata(name, obstore.head(place, name))
        except FileNotFoundError:
            return None

    names = _names(portion)
    pool = ThreadPoolExecutor(BATCH_SIZE)
    try:
        while batch := list(islice(names, PAGE)):
            report(0, 1)
            yield from (chunk for chunk in pool.map(head, batch) if chunk is not None)
    finally:
        pool.shutdown(cancel_futures=True)


def _chunk_metadata(name: str, facts: Any) -> ChunkMetadata:
    changed = facts["last_modified"].timestamp()
    return ChunkMetadata(name, int(facts["size"]), facts["e_tag"] or "", changed)


def _names(portion: Portion) -> Iterator[str]:
    """Yield the names of chunks, or shards, of a part of an array."""
    array, at = portion.array, dict(portion.at)
    metadata: Any = array.metadata
    ranges = []
    for letter, size, side in zip(
        portion.axes, array.shape, array.shards or array.chunks, strict=True
    ):
        every = range(-(-size // side))
        ranges.append([at[letter] // side] if letter in at else every)
    for index in product(*ranges):
        yield f"{array.path}/{metadata.encode_chunk_key(index)}".lstrip("/")


def _files(store: Path, array: str) -> list[str]:
    """Return the files of an array, in order; a zip file is one."""
    if store.is_file():
        return [str(store)]
    found = []
    for inside, folders, names in os.walk(store / array):
        folders.sort()
        found += [os.path.join(inside, name) for name in sorted(names)]
    return found


@dataclass(frozen=True, eq=False)
class StoredStatistics:
    """Cached statistics of a part of an array, such as one time and channel."""

    store: Place  # folder, zip file or address
    portion: Portion

    def load(self, bricks: Bricks) -> BrickStats | None:
        """Load the statistics of an earlier command; None if missing, or the store has changed."""
        if bricks.size < scanning.LEAST:
            return None
        *beside, own = self._paths(bricks)
        for path in (*beside, own):
            names = (*BrickStats._fields, "state")
            held = load_arrays(path, *names, is_beside=path is not own)
            found = None if held is None else _statistics(held, bricks)
            if held is not None and found is not None and str(held["state"]) == self._mark:
                LOG.debug("%s: statistics loaded from %s", self.store.name, path)
                return found
        return None

    def keep(self, bricks: Bricks, found: BrickStats, state: str | None) -> None:
        """Write statistics of a store in a state, if wanted and possible."""
        if state is None or bricks.size < scanning.LEAST:
            return
        codes = np.zeros(0, np.int64) if found.codes is None else found.codes
        parts: dict[str, Any] = found._replace(codes=codes)._asdict() | {"state": state}
        any(store_arrays(path, parts) for path in self._paths(bricks))

    def state(self) -> str | None:
        """Return the state of the store; None if just written, as changes may go unnoticed."""
        return self._mark if self._state is not None and self._state.is_settled else None

    @cached_property
    def _state(self) -> State | None:
        """State at the first call."""
        if isinstance(self.store, Address):
            # Object stores list chunks with tags, which change with each write. A web server gets a
            # HEAD request for every chunk: it must return a strong tag or a time for each; with
            # times, the state is settled an hour after the last.
            import obstore

            place = self.portion.array.store.within.store  # of a `GuardedStore`
            if isinstance(place, obstore.store.HTTPStore):
                return _state(self.portion, _request_metadata(place, self.portion), is_web=True)
            listed = _state(self.portion, _listed(place, self.portion), is_web=False)
            asked = _request_metadata(place, self.portion)  # one request for each chunk
            return listed or _state(self.portion, asked, is_web=False)
        return state_of_files(self.store, self.portion.array.path)

    @property
    def _mark(self) -> str | None:
        return None if self._state is None else self._state.mark

    def _paths(self, bricks: Bricks) -> list[Path]:
        """Return the possible cache files, the best first."""
        replaced = [np.asarray(part).tolist() for part in bricks.replaced or ()]
        which = (self.portion.array.path, self.portion.at)
        what = (FORM, *which, bricks.shape, str(bricks.dtype), bricks.side, replaced)
        beside = sha256(repr(what).encode()).hexdigest()[:10]
        place = self.store.identity if isinstance(self.store, Address) else str(self.store)
        whole = sha256(repr((place, what)).encode()).hexdigest()[:20]
        own = folder() / "surveys" / f"{whole}.npz"
        if isinstance(self.store, Address):
            return [own]
        return [self.store.with_name(f".{self.store.name}.survey-{beside}.npz"), own]


def _statistics(held: dict[str, Any], bricks: Bricks) -> BrickStats | None:
    """Return the statistics of a file, if they are of this kind of volume."""
    step = step_of(bricks.size)
    z, y, x = bricks.shape
    shapes = {
        "least": bricks.count,
        "greatest": bricks.count,
        "some": tuple(-(-size // step) for size in bricks.shape),
        "border": (2 * (y * x + z * x + z * y),),
    }
    types = {"some": bricks.dtype, "border": bricks.dtype}
    if held["beyond"].ndim != 1 or held["beyond"].dtype != bricks.dtype:
        return None
    for name, shape in shapes.items():
        if held[name].shape != shape or held[name].dtype != types.get(name, np.float64):
            return None
    codes = held["codes"] if held["codes"].size else None
    if int(held["codes"].sum()) != (bricks.size if are_few(bricks.dtype) else 0):
        return None
    ends, counts = (held["least"], held["greatest"]), (int(held["infinite"]), int(held["missing"]))
    return BrickStats(*ends, *counts, held["some"], held["border"], held["beyond"], codes)


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

    array: zarr.Array[Any]  # array of a store opened by its path
    axes: str  # its letters
    at: tuple[tuple[str, int], ...]  # time and channel
    dtype: np.dtype[Any]  # that voxels get
    holes: Holes | None = None  # missing chunks of the array

    def __setstate__(self, state: dict[str, Any]) -> None:
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

    array: zarr.Array[Any]
    axes: str  # its letters, see `metadata.Layout`
    order: str = ORDER  # of the first two; swapped they are "ct"
    brick: Step | None = None  # voxels read together; None: by chunks
    store: Place | None = None  # folder, zip file or address, to cache statistics by
    alone: tuple[str, int] | None = None  # the only time or channel
    holes: Holes | None = None  # missing chunks of the array

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


LOSS = {1: "27 to 44", 2: "21 to 39"}  # measured dB of pictures from coarser levels
SERIES = "bioformats2raw.layout"  # attribute of a group of images 0, 1 and so on
LETTERS = {3: "zyx", 4: "tzyx", 5: "tczyx"}  # of plain arrays, by their dimensions


@dataclass(frozen=True)
class Zarr:
    """OME-Zarr 0.4 and 0.5, or a plain array of zarr 2 or 3; a folder, zipped, or at an address.

    Plain arrays are (Z, Y, X), (T, Z, Y, X) or (T, C, Z, Y, X), unless they name their axes.
    """

    level: int = 0  # of an image at several sizes; 0 is the finest
    spacing: Numbers = ""  # of a plain array, which has none: "1x1x1.4" (x, y, z)

    suffixes: ClassVar[tuple[str, ...]] = (
        *(".ome.zarr", ".zarr", ".ome.zarr.zip", ".zarr.zip", ".ozx", ".zip"),
    )

    def __post_init__(self) -> None:
        spacing_of(self.spacing)

    def __call__(self, path: Place) -> Volume:
        return alone(self.recorded(path, check_alone))

    def recorded(self, path: Place, check: Check = accept_any) -> Recording:
        found = self.streamed(path, check)
        times, size = found.values, math.prod(found.values.shape) * found.values.dtype.itemsize
        require_memory(size, found.name)
        check_free(found.name, size)
        return found._replace(values=np.stack([times[n] for n in range(times.shape[0])]))

    def streamed(
        self, path: Place, check: Check = accept_any, brick: Step | None = None
    ) -> Recording:
        """Open all times and channels; values stay in the file, see `Chunked`."""
        name = stem(PurePath(path.resolve().name), self.suffixes)
        layout, node = _image(path, name)
        number, count = self.level, len(layout.levels)
        if not 0 <= number < count:
            raise ValueError(
                f"{name} has {count} levels, 0 (the finest) to {count - 1}; there is no level "
                f"{number}"
            )
        level = moved(layout, number)
        array = _array(node, level, name)
        if min(array.chunks, default=0) < 1:
            raise ValueError(f"{name}/{level.path} has chunks of {array.chunks}; get it again")
        if array.ndim != len(layout.axes):
            raise ValueError(
                f"{name}/{level.path} has {array.ndim} dimensions, its metadata {layout.axes}"
            )
        known = self._header(layout, level, array, name)
        check_not_empty(known)
        check(known)
        guard(array, name)
        holes = holes_of(array, name)
        values = Chunked(array, layout.axes, brick=brick, store=path.resolve(), holes=holes)
        place = (known.spacing, known.origin, known.direction)
        told = Recording(values, *place, name, layout.units, layout.is_color, space=layout.space)
        told = told._replace(length=known.length, looks=_looks(layout))
        missing = holes.message(array.fill_value)
        if not number:
            return told._replace(note=missing)
        finest = _lengths(layout.levels[0], layout.axes)[0]
        size = " x ".join(map(str, known.shape))
        where = ", whose place the file does not tell"
        where = "" if layout.levels[number].is_placed else where
        note = (
            f"level {number} of 0 to {count - 1} ({level.path}{where}) has {size} voxels: its "
            f"pictures are {LOSS.get(number, 'less than 39')} dB from those of level 0"
        )
        notes = [note, missing]
        return told._replace(
            note="; ".join(filter(None, notes)), thickness=float(np.cbrt(abs(finest.prod())))
        )

    def levels(self, path: Place) -> list[dict[str, Any]]:
        """Return levels with `path`, `shape` and `spacing` (x, y, z); errors as in `streamed`."""
        name = stem(PurePath(path.resolve().name), self.suffixes)
        layout, node = _image(path, name)
        listed = []
        for level in layout.levels:
            size = dict(zip(layout.axes, _array(node, level, name).shape, strict=True))
            spacing = _lengths(level, layout.axes)[0]
            shape = tuple(size[letter] for letter in SPACE[::-1])
            listed.append({"path": level.path, "shape": shape, "spacing": spacing.tolist()})
        return listed

    def _header(
        self, layout: Layout, level: Level, array: zarr.Array[Any], name: str
    ) -> VolumeHeader:
        size = dict(zip(layout.axes, map(int, array.shape), strict=True))
        spacing, origin = _lengths(level, layout.axes)
        direction = np.diag(np.where(spacing < 0, -1.0, 1.0))
        if layout.direction is not None:
            direction = layout.direction @ direction
        if self.spacing:
            spacing = np.array(spacing_of(self.spacing)[0])
        known = header(
            tuple(size[letter] for letter in SPACE[::-1]),
            array.dtype,
            name,
            spacing=np.abs(spacing),
            origin=origin,
            direction=direction,
        )
        times, parts = size.get("t", 1), size.get("c", 1)
        length = spacing_of(self.spacing)[1] if self.spacing else layout.unit or UNKNOWN
        known = known._replace(times=times, parts=parts, length=length)
        return known._replace(is_color=layout.is_color)


def _image(path: Place, name: str) -> tuple[Layout, zarr.Array[Any] | zarr.Group]:
    """Return the metadata of an image, and its location."""
    node = open_node(path)
    if isinstance(node, zarr.Array):
        # A plain array is not part of an image.
        own = getattr(node.metadata, "dimension_names", None)
        named = own or node.attrs.get("_ARRAY_DIMENSIONS")
        letters = "".join(str(axis).lower()[:1] for axis in named or ())
        if not (set(letters) >= set(SPACE) and set(letters) <= set("tczyx")):
            letters = LETTERS.get(node.ndim, "")
        if len(letters) != node.ndim or len(set(letters)) < len(letters):
            raise ValueError(
                f"{name} has {node.ndim} dimensions; a volume has 3 (z, y, x), or 4 or 5 with "
                "times and channels before them"
            )
        level = Level("", np.ones(node.ndim), np.zeros(node.ndim), is_placed=True)
        return Layout(letters, (level,), VOXEL), node
    attributes = dict(node.attrs)
    told = attributes.get("ome", attributes)
    if isinstance(told, dict) and SERIES in told and "multiscales" not in told:
        with reading_metadata(name):
            keys = sorted(key for key, _ in node.groups() if key.isdigit())
            node = node[keys[0]] if len(keys) == 1 else node
        if len(keys) != 1:
            raise ValueError(
                f"{name} holds {len(keys)} images; name one of them, such as "
                f"{path / (keys[0] if keys else '0')}"
            )
        attributes = dict(node.attrs)
    layout = layout_of(attributes, name)
    if layout is None:
        with reading_metadata(name):
            held = ", ".join(sorted(node.keys()))
        raise ValueError(
            f"{name} is a group without multiscales, so no image of OME-Zarr; name one of what it "
            f"holds ({held or 'nothing'}) if that is a volume"
        )
    return layout, node


def _array(node: zarr.Array[Any] | zarr.Group, level: Level, name: str) -> zarr.Array[Any]:
    """Return the array of a level."""
    if isinstance(node, zarr.Array):
        return node
    with reading_metadata(f"{name}/{level.path}"):
        found = node.get(level.path)
    if found is None:
        raise ValueError(f"{name} names a level {level.path!r}, which is not there; is it whole?")
    if not isinstance(found, zarr.Array):
        raise ValueError(f"{name}/{level.path} is a group; a level is an array")
    return found


def _looks(layout: Layout) -> tuple[ChannelLook, ...]:
    """Return the looks of channels; their colors are empty where the file says none."""
    found = []
    for one in layout.looks:
        window = None if one.window is None else (one.window.start, one.window.end)
        color = f"#{one.color.strip('#')[:6].lower()}" if one.color else ""
        found.append(ChannelLook(one.label, color, window, one.active))
    return tuple(found)


def _lengths(level: Level, axes: str) -> "tuple[Any, Any]":
    """Return spacing and origin (3,) along x, y and z."""
    order = [axes.index(letter) for letter in SPACE[::-1]]
    return level.scale[order], level.start[order]
