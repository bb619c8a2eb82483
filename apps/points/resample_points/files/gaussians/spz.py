"""Read SPZ files of versions 1 to 4, and write version 3.

Versions 1 to 3 are one gzip stream of a header of 16 bytes and one array after the other; version
4 has a header of 32 bytes and a Zstandard stream per array, which wants the extra `zstd`. Arrays
are in the file's own axes, by default right, up, back.
"""

import math
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from resample.messages import one_line
from resample.reading.limits import ANY, check_size, check_unpacked, deflated
from resample.types import Floats
from resample_points.data.gaussians import Gaussians
from resample_points.data.harmonics import COUNTS
from resample_points.files.gaussians.decoding import (
    ROOT,
    check_count,
    exponentials,
    quaternions_of,
    three_of,
)

MAGIC = b"NGSP"
GZIP = b"\x1f\x8b"
OLD, NEW = struct.Struct("<4sIIBBBB"), struct.Struct("<4sIIBBBBI12x")
FLOAT16, FIRST_THREE, STREAMS = 1, 2, 4  # versions: of positions, rotations, and packing
ANTIALIASED, EXTENDED = 1, 2  # flags
DEGREE_4 = 24  # coefficients of degrees 1 to 4, of which 15 are kept
MOST_BITS = 30  # of a position's fraction
AXES = 0xADBE0003  # extension that names the axes
UPS = (*("-y", "-y", "y", "y") * 2, *("-z", "-z", "z", "z") * 2)  # of the axes 1 to 16
LONGEST = 1 << 20  # bytes of extensions
FINE = 20  # most bits of a fraction that are written


@dataclass(frozen=True)
class _SpzHeader:
    """The header of an SPZ file."""

    version: int
    count: int
    degree: int
    bits: int  # of a position's fraction
    flags: int

    @property
    def width(self) -> int:
        """Number of stored coefficients of harmonics per channel."""
        return (*COUNTS, DEGREE_4)[self.degree]

    @property
    def sizes(self) -> tuple[int, ...]:
        """Bytes of positions, opacities, colors, scales, rotations and harmonics."""
        position = 6 if self.version == FLOAT16 else 9
        rotation = 3 if self.version <= FIRST_THREE else 4
        per_gaussian = (position, 1, 3, 3, rotation, 3 * self.width)
        return tuple(self.count * size for size in per_gaussian)


def read_spz(path: Path) -> Gaussians:
    """Read Gaussians of an SPZ file. Harmonics of degree 4 are left out."""
    data = path.read_bytes()
    if data.startswith(GZIP):
        head, streams, extensions = _gzipped(path, data)
    elif len(data) >= 8 and struct.unpack_from("<I", data, 4)[0] < STREAMS:
        head, streams, extensions = _arrays(path, data)
    else:
        head, streams, extensions = _unpacked_streams(path, data)
    position, opacity, color, scale, rotation, rest = streams
    level = color.reshape(-1, 3).astype(np.float32) / np.float32(255)
    kept = rest.reshape(head.count, head.width, 3)[:, : COUNTS[-1]]
    return Gaussians(
        position=_positions(head, position),
        scale=exponentials(scale.reshape(-1, 3).astype(np.float32) / 16 - 10),
        rotation=_rotations(head, rotation),
        opacity=opacity.astype(np.float32) / np.float32(255),
        color=(level - np.float32(0.5)) / np.float32(0.15),
        harmonics=kept.astype(np.int16) - np.int16(128),
        harmonic_step=1 / 128,
        is_antialiased=bool(head.flags & ANTIALIASED),
        up=_up(extensions) if head.flags & EXTENDED else "y",
    )


def is_spz(path: Path) -> bool:
    """Whether a file begins as SPZ, also within a gzip stream."""
    with path.open("rb") as file:
        start = file.read(1 << 10)
    if start.startswith(GZIP):
        try:
            start = zlib.decompressobj(wbits=ANY).decompress(start, len(MAGIC))
        except zlib.error:
            return False
    return start.startswith(MAGIC)


_Arrays = tuple[_SpzHeader, list[NDArray[np.uint8]], bytes]  # and the extensions


def _gzipped(path: Path, data: bytes) -> _Arrays:
    """Return the arrays of versions 1 to 3."""
    try:
        start = zlib.decompressobj(wbits=ANY).decompress(data, OLD.size)
    except zlib.error as error:
        raise OSError(f"{path} is damaged: {one_line(error)}") from None
    head = _head(path, start)
    size = OLD.size + sum(head.sizes)
    check_unpacked(path.name, len(data), size)
    return _arrays(path, deflated(data, size + (LONGEST if head.flags & EXTENDED else 0)))


def _arrays(path: Path, data: bytes) -> _Arrays:
    """Return the arrays that follow a header."""
    head = _head(path, data)
    sizes = (OLD.size, *head.sizes)
    if sum(sizes) > len(data):
        raise OSError(f"{path} is cut off: {len(data)} of {sum(sizes)} bytes are there")
    ends = np.cumsum(sizes).tolist()
    whole = np.frombuffer(data, np.uint8)
    arrays = [whole[ends[n] : ends[n + 1]] for n in range(len(ends) - 1)]
    return head, arrays, data[ends[-1] :]


def _head(path: Path, data: bytes, form: struct.Struct = OLD) -> _SpzHeader:
    """Return a checked header."""
    if len(data) < form.size or not data.startswith(MAGIC):
        raise OSError(f"{path} is cut off or no SPZ file")
    version, count, degree, bits, flags = form.unpack_from(data)[1:6]
    newest = STREAMS if form is NEW else STREAMS - 1
    if not newest >= version >= (STREAMS if form is NEW else FLOAT16):
        raise ValueError(f"has the SPZ version {version}; known are 1 to 4")
    if degree > 4 or bits > MOST_BITS:
        raise ValueError(
            f"has harmonics of degree {degree} and {bits} bits of a fraction; at most 4 and "
            f"{MOST_BITS} are possible"
        )
    return _SpzHeader(version, check_count(path.name, count), degree, bits, flags)


def _unpacked_streams(path: Path, data: bytes) -> _Arrays:
    """Return the arrays of version 4."""
    head = _head(path, data, NEW)
    count, place = NEW.unpack_from(data)[6:8]
    wanted = [size for size in head.sizes if size]
    if count != len(wanted) or place < NEW.size:
        raise ValueError(f"has {count} streams at byte {place}; {len(wanted)} are needed")
    if place + 16 * count > len(data):
        raise OSError(f"{path} is cut off: its table of streams is not there")
    check_unpacked(path.name, len(data), sum(wanted))
    unpack = _unpacker(path)
    sizes = struct.unpack_from(f"<{2 * count}Q", data, place)
    at, arrays = place + 16 * count, []
    for n, size in enumerate(wanted):
        packed, unpacked = sizes[2 * n : 2 * n + 2]
        if unpacked != size:
            raise ValueError(f"has a stream of {unpacked} bytes, where {size} are needed")
        if at + packed > len(data):
            raise OSError(f"{path} is cut off: stream {n + 1} of {count} is not there")
        arrays.append(np.frombuffer(unpack(data[at : at + packed], size), np.uint8))
        at += packed
    arrays += [np.zeros(0, np.uint8)] * (6 - count)
    return head, arrays, data[NEW.size : place]


def _unpacker(path: Path) -> Callable[[bytes, int], bytes]:
    """Return a function that unpacks Zstandard data to a number of bytes."""
    from resample.reading.limits import unzstd

    try:
        import numcodecs  # noqa: F401
    except ImportError:
        raise ValueError(
            "is SPZ of version 4, and numcodecs is not installed: "
            "pip install 'hybrid-resample[zstd]'"
        ) from None

    def unpack(data: bytes, size: int) -> bytes:
        try:
            made = bytes(unzstd(data, size, size))
        except (ValueError, RuntimeError) as error:
            raise OSError(f"{path} is damaged: {one_line(error)}") from None
        if len(made) != size:
            raise OSError(f"{path} is damaged: a stream has {len(made)} of {size} bytes")
        return made

    return unpack


def _positions(head: _SpzHeader, data: NDArray[np.uint8]) -> Floats:
    """Return positions from 16-bit floats, or from signed whole numbers of 24 bits."""
    if head.version == FLOAT16:
        return data.view("<f2").astype(np.float32).reshape(-1, 3)
    whole = np.zeros((3 * head.count, 4), np.uint8)
    whole[:, 1:] = data.reshape(-1, 3)  # the upper bytes of 32 bits: the sign is right
    numbers = whole.view("<i4").reshape(-1, 3).astype(np.float32)  # 24 bits are exact
    return numbers * np.float32(math.ldexp(1, -8 - head.bits))


def _rotations(head: _SpzHeader, data: NDArray[np.uint8]) -> Floats:
    """Return quaternions w, x, y, z."""
    if head.version <= FIRST_THREE:
        three = data.reshape(-1, 3).astype(np.float32) / np.float32(127.5) - 1
        return quaternions_of(three, np.zeros(head.count, np.uint8))
    packed = data.view("<u4").astype(np.uint32)
    three = np.empty((head.count, 3), np.float32)
    for n, first in enumerate((20, 10, 0)):
        bits = packed >> np.uint32(first)
        size = (bits & np.uint32(511)).astype(np.float32) * (ROOT / np.float32(511))
        three[:, n] = np.where(bits & np.uint32(512), -size, size)
    return np.roll(quaternions_of(three, packed >> np.uint32(30)), 1, axis=1)  # from x, y, z, w


def _up(extensions: bytes) -> str | None:
    """Return the vertical axis by the extension that names the axes; "y" without it."""
    check_size("its extensions", len(extensions), "tree")
    place = 0
    while place + 8 <= len(extensions):
        kind, length = struct.unpack_from("<II", extensions, place)
        if kind == AXES and length >= 4 and place + 12 <= len(extensions):
            axes = struct.unpack_from("<I", extensions, place + 8)[0]
            return UPS[axes - 1] if 1 <= axes <= len(UPS) else None
        place += 8 + length
    return "y"


def spz_bytes(gaussians: Gaussians) -> Iterator[bytes]:
    """Yield the bytes of a file of version 3, whose scene has y up."""
    farthest = float(np.abs(gaussians.position).max(initial=1e-9))
    bits = min(FINE, 22 - math.ceil(math.log2(farthest)))
    if bits < 0:
        raise ValueError(f"a coordinate of {farthest:g}; SPZ holds up to {1 << 22:,}")
    width = gaussians.harmonics.shape[1]
    flags = ANTIALIASED * gaussians.is_antialiased
    count = len(gaussians.opacity)
    whole = np.rint(gaussians.position.astype(np.float64) * (1 << bits)).astype("<i4")
    three, largest = three_of(np.roll(gaussians.rotation, -1, axis=1))  # x, y, z, w
    packed = largest.astype("<u4") << np.uint32(30)
    for n, first in enumerate((20, 10, 0)):
        size = np.rint(np.minimum(np.abs(three[:, n]) / ROOT, 1) * 511).astype("<u4")
        packed |= (size | np.where(three[:, n] < 0, 512, 0).astype("<u4")) << np.uint32(first)
    rest = gaussians.harmonics * np.float32(gaussians.harmonic_step)
    packing = zlib.compressobj(wbits=zlib.MAX_WBITS | 16)
    for data in (
        np.frombuffer(
            OLD.pack(MAGIC, STREAMS - 1, count, COUNTS.index(width), bits, flags, 0), "u1"
        ),
        whole.view(np.uint8).reshape(-1, 4)[:, :3],
        _bytes(gaussians.opacity * 255),
        _bytes((gaussians.color * np.float32(0.15) + np.float32(0.5)) * 255),
        _bytes((np.log(gaussians.scale) + 10) * 16),
        packed.view(np.uint8),
        _bytes(rest * 128 + 128),
    ):
        yield packing.compress(np.ascontiguousarray(data).tobytes())
    yield packing.flush()


def _bytes(numbers: Floats) -> NDArray[np.uint8]:
    """Return numbers rounded to bytes."""
    return np.rint(np.clip(numbers, 0, 255)).astype(np.uint8)
