"""Read and write compressed PLY of SuperSplat: 16 bytes per Gaussian, ranges per 256 of them."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from resample.types import Floats
from resample_points.data.gaussians import Gaussians
from resample_points.data.harmonics import CONSTANT, COUNTS, parts_of
from resample_points.files.gaussians.decoding import (
    ROOT,
    check_count,
    exponentials,
    quaternions_of,
    three_of,
)
from resample_points.files.ply import PlyFile, stacked

PACKED = ("packed_position", "packed_rotation", "packed_scale", "packed_color")
CHUNK = 256  # Gaussians that share ranges
STEP = 1 / 64  # of harmonics: 8 / 256 of a byte's range, halved as bytes stand for middles
WIDEST = 20.0  # logarithms of scales that are written lie within
BITS = ((21, 11), (11, 10), (0, 11))  # first bit and number of bits of x, y and z


def is_compressed(file: PlyFile) -> bool:
    """Whether a PLY file has packed Gaussians."""
    return file.names().issuperset(PACKED)


def read_compressed(file: PlyFile) -> Gaussians:
    """Read Gaussians of a compressed PLY file."""
    chunks, vertices = _checked(file)
    count = check_count(file.path.name, len(vertices))
    if len(chunks) != -(-count // CHUNK):
        raise ValueError(f"has {len(chunks)} chunks for {count} Gaussians; each has up to {CHUNK}")
    levels = _levels(vertices["packed_color"], ((24, 8), (16, 8), (8, 8), (0, 8)))
    colors = levels[:, :3]
    if "min_r" in file.names("chunk"):
        colors = _between(chunks, colors, "", "rgb")
    packed = vertices["packed_rotation"]
    three = _levels(packed, ((20, 10), (10, 10), (0, 10)))
    position = _between(chunks, _levels(vertices["packed_position"], BITS), "", "xyz")
    scale = _between(chunks, _levels(vertices["packed_scale"], BITS), "scale_", "xyz")
    return Gaussians(
        position=position,
        scale=exponentials(scale),
        rotation=quaternions_of((three - np.float32(0.5)) / ROOT, packed >> np.uint32(30)),
        opacity=np.ascontiguousarray(levels[:, 3]),
        color=(colors - np.float32(0.5)) / np.float32(CONSTANT),
        harmonics=_harmonics(file, count),
        harmonic_step=STEP,
        is_antialiased=file.is_antialiased,
        up=file.up,
    )


def _checked(file: PlyFile) -> tuple[NDArray[np.void], NDArray[np.void]]:
    """Return the records of chunks and Gaussians, whose types are right."""
    ranged = ("x", "y", "z", "scale_x", "scale_y", "scale_z")
    names = [f"{end}_{name}" for end in ("min", "max") for name in ranged]
    missing = [name for name in names if name not in file.names("chunk")]
    colors = [f"{end}_{name}" for end in ("min", "max") for name in "rgb"]
    given = [name for name in colors if name in file.names("chunk")]
    if missing or len(given) not in {0, 6}:
        lacking = missing or [name for name in colors if name not in given]
        raise ValueError(f"has packed Gaussians, but no {lacking[0]} of their chunks")
    vertices = file.records("vertex")
    wrong = [name for name in PACKED if vertices.dtype[name].newbyteorder("=") != np.uint32]
    if wrong:
        raise ValueError(f"has {wrong[0]} of type {vertices.dtype[wrong[0]]}; it must be uint")
    return file.records("chunk"), vertices


def _levels(packed: NDArray[np.uint32], bits: tuple[tuple[int, int], ...]) -> Floats:
    """Return whole numbers of some bits as 0 to 1, (N, K)."""
    packed = packed.astype(np.uint32)  # contiguous, in the machine's byte order
    levels = np.empty((len(packed), len(bits)), np.float32)
    for n, (first, width) in enumerate(bits):
        most = (1 << width) - 1
        levels[:, n] = packed >> np.uint32(first) & np.uint32(most)
        levels[:, n] *= np.float32(1 / most)
    return levels


def _between(chunks: NDArray[np.void], levels: Floats, prefix: str, axes: str) -> Floats:
    """Return numbers between the ends of each chunk's ranges."""
    low = stacked(chunks, [f"min_{prefix}{axis}" for axis in axes])
    high = stacked(chunks, [f"max_{prefix}{axis}" for axis in axes])
    place = np.arange(len(levels)) // CHUNK
    with np.errstate(invalid="ignore", over="ignore"):
        made: Floats = low[place] * (1 - levels) + high[place] * levels
    return made


def _harmonics(file: PlyFile, count: int) -> NDArray[np.int16]:
    """Return coefficients (N, K, 3), in steps of 1 / 64."""
    if not file.names("sh"):
        return np.zeros((count, 0, 3), np.int16)
    names, records = file.names("sh"), file.records("sh")
    each = len(names) // 3
    wanted = [f"f_rest_{n}" for n in range(3 * each)]
    if each not in COUNTS or len(names) % 3 or names != set(wanted):
        raise ValueError(f"has {len(names)} harmonics; degrees 1 to 3 have 9, 24 or 45, from 0 on")
    if len(records) != count or any(records.dtype[name] != np.uint8 for name in wanted):
        raise ValueError(f"has {len(records)} harmonics for {count} Gaussians, or not of bytes")
    table = np.arange(256, dtype=np.int16) * 2 - 255
    table[0], table[255] = -256, 256  # the ends stand for themselves
    harmonics = np.empty((count, each, 3), np.int16)
    for rows in parts_of(count):
        part = np.asarray(records[rows])
        levels = np.stack([part[name] for name in wanted], axis=1)
        harmonics[rows] = table[levels].reshape(-1, 3, each).transpose(0, 2, 1)
    return harmonics


def compressed_bytes(gaussians: Gaussians, comments: list[str]) -> Iterator[bytes]:
    """Yield a file's bytes; neighbours should follow each other, as they share ranges."""
    count, width = len(gaussians.opacity), gaussians.harmonics.shape[1]
    light = gaussians.color * np.float32(CONSTANT) + np.float32(0.5)
    scale = np.clip(np.log(gaussians.scale), -WIDEST, WIDEST)
    ranges, levels = [], []
    for values in (gaussians.position, scale, light):
        first = np.arange(0, count, CHUNK)
        low, high = np.minimum.reduceat(values, first), np.maximum.reduceat(values, first)
        place = np.arange(count) // CHUNK
        levels.append((values - low[place]) / np.maximum(high - low, np.float32(1e-30))[place])
        ranges += [low, high]
    three, largest = three_of(gaussians.rotation)
    packed = [
        _packed(levels[0], BITS),
        _packed(three * ROOT + np.float32(0.5), ((20, 10), (10, 10), (0, 10)))
        | largest.astype("<u4") << np.uint32(30),
        _packed(levels[1], BITS),
        _packed(
            np.column_stack([levels[2], gaussians.opacity]), ((24, 8), (16, 8), (8, 8), (0, 8))
        ),
    ]
    ends = [
        f"property float {end}_{prefix}{axis}"
        for prefix, axes in (("", "xyz"), ("scale_", "xyz"), ("", "rgb"))
        for end in ("min", "max")
        for axis in axes
    ]
    lines = ["ply", "format binary_little_endian 1.0", *comments]
    lines += [f"element chunk {-(-count // CHUNK)}", *ends, f"element vertex {count}"]
    lines += [f"property uint {name}" for name in PACKED]
    if width:
        lines.append(f"element sh {count}")
        lines += [f"property uchar f_rest_{n}" for n in range(3 * width)]
    yield ("\n".join([*lines, "end_header"]) + "\n").encode()
    yield np.concatenate(ranges, axis=1, dtype="<f4").tobytes()
    yield np.stack(packed, axis=1).tobytes()
    for rows in parts_of(count if width else 0):
        value = gaussians.harmonics[rows].transpose(0, 2, 1) * np.float32(gaussians.harmonic_step)
        yield np.clip(np.floor((value / 8 + 0.5) * 256), 0, 255).astype(np.uint8).tobytes()


def _packed(levels: Floats, bits: tuple[tuple[int, int], ...]) -> NDArray[np.uint32]:
    """Return numbers 0 to 1 (N, K) as whole numbers of some bits: `_levels`' inverse."""
    packed = np.zeros(len(levels), "<u4")
    for n, (first, width) in enumerate(bits):
        whole = np.rint(np.clip(levels[:, n], 0, 1) * ((1 << width) - 1)).astype("<u4")
        packed |= whole << np.uint32(first)
    return packed
