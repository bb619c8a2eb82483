"""Zarr codecs with an upper bound on the size of their output."""

import asyncio
import lzma
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from zarr.abc.codec import BytesBytesCodec
from zarr.codecs import ShardingCodec
from zarr.codecs._v2 import V2Codec
from zarr.core.buffer.cpu import as_numpy_array_wrapper

from resample.memory import amount
from resample.reading.limits import bunzipped, check_becomes, deflated, unlzma
from resample.reading.zstd import unzstd

OF_OBJECTS = ("pickle", "json2", "msgpack2", "vlen-utf8", "vlen-bytes", "vlen-array")

Decode = Callable[..., Any]  # takes packed data and `most`, the largest output in bytes


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
        return bunzipped
    if name == "lzma":
        form = int(told.get("format") or lzma.FORMAT_XZ)
        is_raw = form == lzma.FORMAT_RAW
        return partial(unlzma, form=form, filters=told.get("filters") if is_raw else None)
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
