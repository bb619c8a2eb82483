"""Read SPZ files of versions 1 to 4, and write version 3.

Versions 1 to 3 are one gzip stream of a header of 16 bytes and one array after the other; version
4 has a header of 32 bytes and a Zstandard stream per array, which wants the extra `zstd`. Arrays
are in the file's own axes, by default right, up, back.
"""

import math
import struct
import zlib
from collections.abc import Iterator
from importlib.util import find_spec
from itertools import pairwise
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
DEGREE_4 = 24  # coefficients of degrees 1 to 4; 15 are kept
MOST_BITS = 30  # of a position's fraction
AXES = 0xADBE0003  # extension that names the axes
UPS = (*("-y", "-y", "y", "y") * 2, *("-z", "-z", "z", "z") * 2)  # of the axes 1 to 16
LONGEST = 1 << 20  # bytes of extensions
FINE = 20  # most bits of a fraction that are written


def read_spz(path: Path) -> Gaussians:
    """Read Gaussians of an SPZ file. Harmonics of degree 4 are left out."""
    (version, count, degree, bits, flags), streams, extensions = _arrays(path, path.read_bytes())
    place, opacity, color, scale, rotation, rest = streams
    level = color.reshape(-1, 3).astype(np.float32) / np.float32(255)
    kept = rest.reshape(count, (*COUNTS, DEGREE_4)[degree], 3)[:, : COUNTS[-1]]
    # Places are floats of 16 bits, or signed whole numbers of 24 bits.
    if version == FLOAT16:
        position = place.view("<f2").astype(np.float32).reshape(-1, 3)
    else:
        upper = np.zeros((3 * count, 4), np.uint8)
        upper[:, 1:] = place.reshape(-1, 3)  # the upper bytes of 32 bits: the sign is right
        numbers = upper.view("<i4").reshape(-1, 3).astype(np.float32)  # 24 bits are exact
        position = numbers * np.float32(math.ldexp(1, -8 - bits))
    if version <= FIRST_THREE:
        three = rotation.reshape(-1, 3).astype(np.float32) / np.float32(127.5) - 1
        quaternions = quaternions_of(three, np.zeros(count, np.uint8))
    else:
        packed, three = rotation.view("<u4").astype(np.uint32), np.empty((count, 3), np.float32)
        for n, first in enumerate((20, 10, 0)):
            part = packed >> np.uint32(first)
            size = (part & np.uint32(511)).astype(np.float32) * (ROOT / np.float32(511))
            three[:, n] = np.where(part & np.uint32(512), -size, size)
        last = quaternions_of(three, packed >> np.uint32(30))
        quaternions = np.roll(last, 1, axis=1)  # from x, y, z, w
    return Gaussians(
        position=position,
        scale=exponentials(scale.reshape(-1, 3).astype(np.float32) / 16 - 10),
        rotation=quaternions,
        opacity=opacity.astype(np.float32) / np.float32(255),
        color=(level - np.float32(0.5)) / np.float32(0.15),
        harmonics=kept.astype(np.int16) - np.int16(128),
        harmonic_step=1 / 128,
        is_antialiased=bool(flags & ANTIALIASED),
        up=_up(extensions) if flags & EXTENDED else "y",
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


def _arrays(path: Path, data: bytes) -> tuple[list[int], list[NDArray[np.uint8]], bytes]:
    """Return version, count, degree, bits and flags; the arrays; and the extensions."""
    is_packed, start = data.startswith(GZIP), data
    if is_packed:
        try:
            start = zlib.decompressobj(wbits=ANY).decompress(data, OLD.size)
        except zlib.error as error:
            raise OSError(f"{path} is damaged: {one_line(error)}") from None
    is_old = is_packed or (len(data) >= 8 and struct.unpack_from("<I", data, 4)[0] < STREAMS)
    form = OLD if is_old else NEW
    if len(start) < form.size or not start.startswith(MAGIC):
        raise OSError(f"{path} is cut off or no SPZ file")
    head = version, count, degree, bits, flags = list(form.unpack_from(start)[1:6])
    if not (FLOAT16 <= version < STREAMS if is_old else version == STREAMS):
        raise ValueError(f"has the SPZ version {version}; known are 1 to 4")
    if degree > 4 or bits > MOST_BITS:
        raise ValueError(
            f"has harmonics of degree {degree} and {bits} bits of a fraction; at most 4 and "
            f"{MOST_BITS} are possible"
        )
    check_count(path.name, count)
    # Bytes of positions, opacities, colors, scales, rotations and harmonics.
    position, rotation = 6 if version == FLOAT16 else 9, 3 if version <= FIRST_THREE else 4
    each = position, 1, 3, 3, rotation, 3 * (*COUNTS, DEGREE_4)[degree]
    sizes = [count * size for size in each]
    if not is_old:
        return head, *_unpacked_streams(path, data, sizes)
    ends = np.cumsum([OLD.size, *sizes]).tolist()
    if is_packed:
        check_unpacked(path.name, len(data), ends[-1])
        data = deflated(data, ends[-1] + (LONGEST if flags & EXTENDED else 0))
    if ends[-1] > len(data):
        raise OSError(f"{path} is cut off: {len(data)} of {ends[-1]} bytes are there")
    whole = np.frombuffer(data, np.uint8)
    return head, [whole[first:last] for first, last in pairwise(ends)], data[ends[-1] :]


def _unpacked_streams(
    path: Path, data: bytes, sizes: list[int]
) -> tuple[list[NDArray[np.uint8]], bytes]:
    """Return the arrays of version 4, and the extensions."""
    from resample.reading.limits import unzstd

    count, place = NEW.unpack_from(data)[6:8]
    wanted = [size for size in sizes if size]
    if count != len(wanted) or place < NEW.size:
        raise ValueError(f"has {count} streams at byte {place}; {len(wanted)} are needed")
    if place + 16 * count > len(data):
        raise OSError(f"{path} is cut off: its table of streams is not there")
    check_unpacked(path.name, len(data), sum(wanted))
    if not find_spec("numcodecs"):
        raise ValueError(
            "is SPZ of version 4, and numcodecs is not installed: "
            "pip install 'hybrid-resample[zstd]'"
        )
    table = struct.unpack_from(f"<{2 * count}Q", data, place)
    at, arrays = place + 16 * count, []
    for n, size in enumerate(wanted):
        packed, unpacked = table[2 * n : 2 * n + 2]
        if unpacked != size:
            raise ValueError(f"has a stream of {unpacked} bytes, where {size} are needed")
        if at + packed > len(data):
            raise OSError(f"{path} is cut off: stream {n + 1} of {count} is not there")
        try:
            made = bytes(unzstd(data[at : at + packed], size, size))
        except (ValueError, RuntimeError) as error:
            raise OSError(f"{path} is damaged: {one_line(error)}") from None
        if len(made) != size:
            raise OSError(f"{path} is damaged: a stream has {len(made)} of {size} bytes")
        arrays.append(np.frombuffer(made, np.uint8))
        at += packed
    arrays += [np.zeros(0, np.uint8)] * (6 - count)
    return arrays, data[NEW.size : place]


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
    """Yield the bytes of a file of version 3, with the scene's y up."""
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
