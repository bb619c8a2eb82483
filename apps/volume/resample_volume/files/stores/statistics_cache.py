"""Cache on disk of a store's statistics, for later commands.

It is a hidden file beside the store or, if that is not writable, in the user's cache. The state of
the store's files on the disk or server tells whether it is still valid (`states`).

A state is a fingerprint that changes with every change of a chunk. If that cannot be guaranteed,
there is none.
"""

import json
import logging
import os
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from itertools import islice, product
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from resample.files.stores.opening import Address, Place
from resample.files.writing import load_arrays, store_arrays
from resample.memory.mapped import folder
from resample.progress import report
from resample_volume.data.bricks import Bricks
from resample_volume.data.scanning import BrickStats, are_few, step_of

if TYPE_CHECKING:
    import zarr

RECENT = 2.0  # seconds within which a file may change without a new timestamp
SETTLED = 3600.0  # the same for web servers, whose clocks may differ, seconds
BATCH_SIZE = 32  # chunks that a web server is asked about at a time
PAGE = 1000  # that are listed, or asked about, before work looks up
LEAST = 1 << 23  # voxels; a pass over fewer takes less than a second
FORM = 2  # of the cache files
LOG = logging.getLogger("resample")


class Portion(NamedTuple):
    """Times and channels of an array."""

    array: "zarr.Array[Any]"
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


def state_of_server(portion: Portion) -> State | None:
    """Return the state of a part of a remote array; None if its server does not tell enough.

    Object stores list chunks with tags, which change with each write. A web server gets a HEAD
    request for every chunk of the part: it must return a strong tag or a time for each; with times,
    the state is settled an hour after the last.
    """
    import obstore

    place = portion.array.store.within.store  # of a `GuardedStore`
    if isinstance(place, obstore.store.HTTPStore):
        return _state(portion, _request_metadata(place, portion), is_web=True)
    listed = _state(portion, _listed(place, portion), is_web=False)
    return listed or _state(portion, _request_metadata(place, portion), is_web=False)


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
        if bricks.size < LEAST:
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
        if state is None or bricks.size < LEAST:
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
            return state_of_server(self.portion)
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
