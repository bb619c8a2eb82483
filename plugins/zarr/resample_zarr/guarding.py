"""Guarded stores: check location and size of files before they are read."""

import asyncio
import bz2
import lzma
import os
import struct
import zipfile
from collections.abc import AsyncIterator, Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from math import prod
from pathlib import Path
from stat import S_ISDIR, S_ISLNK, S_ISREG
from typing import Any, Protocol

from zarr.abc.codec import BytesBytesCodec
from zarr.codecs import ShardingCodec
from zarr.codecs._v2 import V2Codec
from zarr.core.buffer.cpu import as_numpy_array_wrapper
from zarr.storage import WrapperStore

from resample.memory import amount
from resample.reading.limits import (
    LimitError,
    allows_outside,
    check_becomes,
    check_free,
    check_member,
    check_size,
    deflated,
    neighbour,
    unpacked,
    unzstd,
)

PER_VALUE, BESIDE = 2, 4096  # largest packed size, relative to the values, plus a constant in bytes
LEAST = 1 << 20  # bytes that a codec may produce, however small the chunk
METADATA = ("zarr.json", ".zarray", ".zattrs", ".zgroup", ".zmetadata")
OF_OBJECTS = ("pickle", "json2", "msgpack2", "vlen-utf8", "vlen-bytes", "vlen-array")

Decode = Callable[..., Any]  # takes packed data and `most`, the largest output in bytes


class Listing(Protocol):
    """Information on files before they are read."""

    def size(self, key: str) -> int | None:
        """Size of a file in bytes; None if it does not exist."""
        ...

    def names(self, path: str, depth: int) -> Iterator[str] | None:
        """Names below a path, at most `depth` parts long; None if they cannot be listed."""
        ...


class Folder:
    """Regular files in a folder and its subfolders."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._within: set[str] = set()  # folders known to lie inside

    def size(self, key: str) -> int | None:
        """Size of a file in bytes, see `Listing`."""
        path = os.path.join(self.root, key)
        try:
            told = os.lstat(path)
        except (FileNotFoundError, NotADirectoryError):
            return None
        parent = os.path.dirname(path)
        if S_ISLNK(told.st_mode) or parent not in self._within:
            file = neighbour(self.root / self.root.name, key)
            self._within.add(parent)
            try:
                told = os.stat(file)
            except FileNotFoundError:
                return None
        if S_ISDIR(told.st_mode):
            return None
        if not S_ISREG(told.st_mode):
            raise ValueError(f"{self.root.name} names {key!r:.100}, a device or a pipe, not a file")
        return told.st_size

    def names(self, path: str, depth: int) -> Iterator[str]:
        """Names of files below a path, see `Listing`; links to folders are followed if allowed."""
        return _below(os.path.join(self.root, path), "", depth)


def _below(folder: str, before: str, depth: int) -> Iterator[str]:
    with os.scandir(folder) as entries:
        for entry in entries:
            if depth > 1 and entry.is_dir(follow_symlinks=allows_outside()):
                yield from _below(entry.path, f"{before}{entry.name}/", depth - 1)
            else:
                yield before + entry.name


class Zip:
    """Members of a zip file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._members: dict[str, zipfile.ZipInfo] | None = None

    def __getstate__(self) -> dict[str, Any]:
        return {"path": self.path, "_members": None}

    @property
    def members(self) -> dict[str, zipfile.ZipInfo]:
        """Members by name."""
        if self._members is None:
            with zipfile.ZipFile(self.path) as packed:
                self._members = {info.filename: info for info in packed.infolist()}
        return self._members

    def size(self, key: str) -> int | None:
        """Unpacked size of a member in bytes, see `Listing`."""
        found = self.members.get(key)
        if found is None:
            return None
        check_member(self.path.name, found)
        return found.file_size

    def names(self, path: str, depth: int) -> Iterator[str]:
        """Names of members below a path, see `Listing`."""
        before = f"{path}/" if path else ""
        return (
            name.removeprefix(before)
            for name in self.members
            if name.startswith(before) and name.count("/") - before.count("/") < depth
        )


class GuardedStore(WrapperStore[Any]):  # type: ignore[misc]
    """A store that rejects files outside of it, and files much larger than expected.

    Compressed values are rarely larger than raw ones; so a chunk that unpacks to gigabytes is too
    large to be accepted.
    """

    most: int | None = None  # limit on the stored size of a chunk in bytes; None: not known yet

    def __init__(self, store: Any, listing: Listing | None = None) -> None:
        super().__init__(store)
        self.listing = listing

    def _with_store(self, store: Any) -> "GuardedStore":
        made = type(self)(store, self.listing)
        made.most = self.most
        return made

    @property
    def within(self) -> Any:
        """The wrapped store."""
        return self._store

    def size(self, key: str) -> int | None:
        """Size of a key's value in bytes; None if it does not exist or is unknown."""
        return None if self.listing is None else self.listing.size(key)

    def names(self, path: str, depth: int) -> Iterator[str] | None:
        """Names below a path, at most `depth` parts long; None if they cannot be listed."""
        return None if self.listing is None else self.listing.names(path, depth)

    async def get(self, key: str, prototype: Any, byte_range: Any = None) -> Any:
        """Read a chunk or metadata, see zarr."""
        if self.listing is not None:
            try:
                size = self.listing.size(key)
            except ValueError as error:
                raise LimitError(str(error)) from None
            if size is None:
                return None
            self._check(key, size)
        found = await self._got(key, prototype, byte_range)
        if found is not None:
            self._check(key, len(found))
        return found

    async def _got(self, key: str, prototype: Any, byte_range: Any) -> Any:
        if self.listing is not None or byte_range is not None:
            self._check(key, getattr(byte_range, "end", 0) - getattr(byte_range, "start", 0))
            return await self._store.get(key, prototype, byte_range)
        import obstore

        try:
            answer = await obstore.get_async(self._store.store, key)
        except FileNotFoundError:
            return None
        self._check(key, int(answer.meta["size"]))
        return prototype.buffer.from_bytes(await answer.bytes_async())

    async def get_partial_values(
        self, prototype: Any, key_ranges: Iterable[tuple[str, Any]]
    ) -> list[Any]:
        """Read parts of chunks, see zarr."""
        return [await self.get(key, prototype, part) for key, part in key_ranges]

    async def _get_many(
        self, requests: Iterable[tuple[str, Any, Any]]
    ) -> AsyncIterator[tuple[str, Any]]:
        for key, prototype, part in requests:
            yield key, await self.get(key, prototype, part)

    def _check(self, key: str, size: int) -> None:
        """Reject a file that is too large, before it is read."""
        if key.rpartition("/")[2] in METADATA:
            check_size(key, size, "tree")
        elif self.most is not None and size > self.most:
            raise LimitError(
                f"its chunk {key} takes {amount(size)}, but its values take "
                f"{amount((self.most - BESIDE) // PER_VALUE)}"
            )


def guard(array: Any, name: str) -> None:
    """Bound the stored and unpacked sizes of an array's chunks."""
    alone = prod(array.chunks) * array.dtype.itemsize
    size = prod(getattr(array, "shards", None) or array.chunks) * array.dtype.itemsize
    check_free(f"a chunk of {name}", alone)
    bound(array, alone, max(LEAST, PER_VALUE * alone + BESIDE))
    store = array.store
    if isinstance(store, GuardedStore):
        store.most = max(store.most or 0, PER_VALUE * size + BESIDE)


def bound(array: Any, size: int, most: int) -> None:
    """Bound the output of an array's codecs."""
    inner = array.async_array
    pipeline = inner.codec_pipeline
    codecs = [_bound(codec, size, most) for codec in pipeline]
    object.__setattr__(inner, "codec_pipeline", type(pipeline).from_codecs(codecs))


def _bound(codec: Any, size: int, most: int) -> Any:
    """Bound a codec of zarr 2 or 3."""
    if isinstance(codec, ShardingCodec):
        return replace(codec, codecs=tuple(_bound(each, size, most) for each in codec.codecs))
    if isinstance(codec, V2Codec):
        filters = tuple(_of_numcodecs(each, size, most) for each in codec.filters or ())
        packing = codec.compressor and _of_numcodecs(codec.compressor, size, most)
        return V2Codec(filters=filters or None, compressor=packing)
    if not isinstance(codec, BytesBytesCodec) or isinstance(codec, BoundCodec):
        return codec
    return BoundCodec(codec, size, most) if _decoder(*_name_and_config(codec), size) else codec


@dataclass(frozen=True)
class BoundCodec(BytesBytesCodec):  # type: ignore[misc]
    """A codec of zarr 3 with bounded output."""

    codec: BytesBytesCodec
    size: int  # bytes of a chunk's values
    most: int  # bound on the output

    @property
    def is_fixed_size(self) -> bool:
        """Whether the output has a fixed size."""
        return bool(self.codec.is_fixed_size)

    def to_dict(self) -> Any:
        """Metadata of the codec."""
        return self.codec.to_dict()

    def evolve_from_array_spec(self, array_spec: Any) -> "BoundCodec":
        """Codec for an array, see zarr."""
        return replace(self, codec=self.codec.evolve_from_array_spec(array_spec))

    def compute_encoded_size(self, input_byte_length: int, chunk_spec: Any) -> int:
        """Bytes of a packed chunk, see zarr."""
        return int(self.codec.compute_encoded_size(input_byte_length, chunk_spec))

    def _decode_sync(self, chunk: Any, spec: Any) -> Any:
        decode = _decoder(*_name_and_config(self.codec), self.size)
        assert decode is not None
        with _chunk(self.size):
            return as_numpy_array_wrapper(partial(decode, most=self.most), chunk, spec.prototype)

    async def _decode_single(self, chunk: Any, spec: Any) -> Any:
        return await asyncio.to_thread(self._decode_sync, chunk, spec)


@dataclass(frozen=True)
class BoundPacking:
    """A codec of zarr 2 with bounded output."""

    codec: Any
    size: int  # bytes of a chunk's values
    most: int  # bound on the output

    def decode(self, data: Any) -> Any:
        """Unpack data."""
        decode = _decoder(*_name_and_config(self.codec), self.size)
        assert decode is not None
        with _chunk(self.size):
            return decode(data, most=self.most)


@contextmanager
def _chunk(size: int) -> Iterator[None]:
    """Prefix errors with a chunk and its size."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"a chunk, whose values take {amount(size)}: {error}") from None


def _of_numcodecs(codec: Any, size: int, most: int) -> Any:
    if isinstance(codec, BoundPacking):
        return codec
    name, told = _name_and_config(codec)
    if name in OF_OBJECTS:
        raise ValueError(f"its codec {name} creates objects, which are not supported")
    return BoundPacking(codec, size, most) if _decoder(name, told, size) else codec


def _name_and_config(codec: Any) -> tuple[str, dict[str, Any]]:
    """Name and metadata of a codec of zarr 2 or 3."""
    if not isinstance(codec, BytesBytesCodec):
        told = codec.get_config()
        return str(told["id"]), told
    described: Any = codec.to_dict()
    name = str(described["name"]).removeprefix("numcodecs.")
    return name, described.get("configuration") or {}


def _decoder(name: str, told: dict[str, Any], size: int) -> Decode | None:
    """Bounded decoder of a codec; None for codecs that do not enlarge, or unknown ones."""
    if name in ("zlib", "gzip"):
        return deflated
    if name == "bz2":
        return partial(unpacked, new=bz2.BZ2Decompressor)
    if name == "lzma":
        form = int(told.get("format") or lzma.FORMAT_XZ)
        is_raw = form == lzma.FORMAT_RAW
        filters = told.get("filters") if is_raw else None
        return partial(unpacked, new=lambda: lzma.LZMADecompressor(form, None, filters))
    if name == "zstd":
        return partial(unzstd, size=size)
    return partial(_unpack_sized, name=name) if name in ("blosc", "lz4") else None


def _unpack_sized(data: Any, most: int, name: str) -> Any:
    """Unpack data that begin with their unpacked size."""
    import numcodecs

    data, place = bytes(data), 4 if name == "blosc" else 0
    if len(data) < place + 4:
        raise ValueError("it is cut off")
    check_becomes(struct.unpack_from("<I", data, place)[0], most)
    return numcodecs.get_codec({"id": name}).decode(data)
