"""Read and write 3D Gaussians as PLY, as trainers write them or compressed by SuperSplat.

Trainers write logarithms of scales and logits of opacities. Compressed files have 16 bytes per
Gaussian, and ranges per 256 of them.
"""

import logging
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from resample.progress import report
from resample.types import Floats
from resample_points.data.gaussians import Gaussians
from resample_points.data.harmonics import CONSTANT, COUNTS, parts_of, rounded_to, step_of
from resample_points.files.gaussians.decoding import (
    ROOT,
    check_count,
    exponentials,
    quaternions_of,
    sigmoids,
    three_of,
)
from resample_points.files.ply import PlyFile, largest_of, stacked

LOG = logging.getLogger("resample")
POSITION, COLOR = ["x", "y", "z"], ["f_dc_0", "f_dc_1", "f_dc_2"]
SCALE, ROTATION = ["scale_0", "scale_1", "scale_2"], ["rot_0", "rot_1", "rot_2", "rot_3"]
NORMAL = ["nx", "ny", "nz"]  # zeros that some programs want
NEEDED = {*POSITION, *COLOR, "opacity", *SCALE[:2], *ROTATION}
FLAT = 1e-3  # third scale of flat Gaussians relative to the smaller of the others
FOURTH = 24  # coefficients per channel of degrees 1 to 4; 15 are kept
SAMPLED, FEWEST = 10_000, 16  # Gaussians to examine, and at least needed
OPAQUE = 1e-7  # distance of a written opacity from 0 and 1, which have infinite logits


def read_trained(file: PlyFile) -> Gaussians:
    """Read Gaussians of a PLY file; other properties and elements are ignored.

    Files without `scale_2` hold flat Gaussians.
    """
    stored = TrainedFile(file)
    stored.tell()
    made = stored.empty(stored.count)
    for rows in parts_of(stored.count):
        stored.decode(made, rows, rows)
        report(rows.stop, stored.count)
    return made


class TrainedFile:
    """Gaussians of a PLY file that are decoded on demand."""

    def __init__(self, file: PlyFile) -> None:
        missing = sorted(NEEDED - file.names())
        if missing:
            raise ValueError(f"has no property {missing[0]} of Gaussians")
        self.path, self._file, self._records = file.path, file, file.records("vertex")
        self.count = check_count(file.path.name, len(self._records))
        # Find the names of harmonics, channel by channel, and the step of the largest number.
        count = sum(name.startswith("f_rest_") for name in file.names())
        each = count // 3
        if count % 3 or each not in {*COUNTS, FOURTH}:
            raise ValueError(f"has {count} harmonics f_rest_*; degrees 1 to 3 have 9, 24 or 45")
        kept = range(min(each, COUNTS[-1]))
        self._rest = [f"f_rest_{channel * each + n}" for channel in range(3) for n in kept]
        if not file.names().issuperset(self._rest):
            raise ValueError(f"has {count} harmonics f_rest_*, which are not numbered from 0")
        largest = 0.0
        for rows in parts_of(self.count if count else 0):
            part = np.asarray(self._records[rows])
            largest = max(largest, *(largest_of(part[name]) for name in self._rest))
        self._step = step_of(largest)

    def tell(self) -> None:
        """Warn of ambiguous parts of the file, once it is shown."""
        self._file.tell_scales()
        some = self._records[:: max(1, self.count // SAMPLED)]
        opacity = some["opacity"]
        is_share = opacity.min() >= 0 and opacity.max() <= 1
        if self.count >= FEWEST and is_share and stacked(some, SCALE[:2]).min() > 0:
            LOG.warning(
                "%s: no scale is below 0 and opacities are 0 to 1, as if activations had been"
                " applied before it was written; they are read as logarithms and logits",
                self.path.name,
            )

    def empty(self, count: int) -> Gaussians:
        """Allocate arrays for some Gaussians of the file."""
        return Gaussians(
            position=np.empty((count, 3), np.float32),
            scale=np.empty((count, 3), np.float32),
            rotation=np.empty((count, 4), np.float32),
            opacity=np.empty(count, np.float32),
            color=np.empty((count, 3), np.float32),
            harmonics=np.empty((count, len(self._rest) // 3, 3), np.int16),
            harmonic_step=self._step,
            is_antialiased=self._file.is_antialiased,
            up=self._file.up,
        )

    def decode(self, made: Gaussians, into: slice, rows: slice) -> None:
        """Decode some rows of the file into rows of arrays."""
        records = np.asarray(self._records[rows])
        made.position[into] = stacked(records, POSITION)
        is_flat = SCALE[2] not in (records.dtype.names or ())
        scale = exponentials(stacked(records, SCALE[: 2 if is_flat else 3]))
        if is_flat:  # the third one is small
            third = FLAT * scale.min(axis=1, keepdims=True)
            scale = np.concatenate([scale, third], axis=1)
        made.scale[into], made.rotation[into] = scale, stacked(records, ROTATION)
        made.opacity[into] = sigmoids(records["opacity"])
        made.color[into] = stacked(records, COLOR)
        if self._rest:
            values = stacked(records, self._rest)
            if not np.isfinite(values).all():  # a Gaussian without a color is left out
                made.color[into][~np.isfinite(values).all(axis=1)] = np.nan
                np.nan_to_num(values, copy=False)
            by_channel = rounded_to(values, made.harmonic_step).reshape(len(values), 3, -1)
            made.harmonics[into] = by_channel.transpose(0, 2, 1)

    def part(self, rows: slice) -> Gaussians:
        """Return some Gaussians of the file, unchecked."""
        first, last, _ = rows.indices(self.count)
        made = self.empty(last - first)
        for some in parts_of(last - first):
            self.decode(made, some, slice(first + some.start, first + some.stop))
        return made

    def shape_of(self, rows: slice) -> tuple[Floats, Floats]:
        """Return only positions (N, 3) and opacities (N,)."""
        records = self._records[rows]
        return stacked(records, POSITION), sigmoids(records["opacity"])


def trained_bytes(gaussians: Gaussians, comments: list[str]) -> Iterator[bytes]:
    """Yield a file's bytes; opacities of 0 and 1 become 1e-7 and 1 - 1e-7: logits are finite."""
    width = 3 * gaussians.harmonics.shape[1]
    rest = [f"f_rest_{n}" for n in range(width)]
    names = [*POSITION, *NORMAL, *COLOR, *rest, "opacity", *SCALE, *ROTATION]
    count = f"element vertex {len(gaussians.position)}"
    properties = [f"property float {name}" for name in names]
    lines = ["ply", "format binary_little_endian 1.0", *comments, count, *properties, "end_header"]
    yield ("\n".join(lines) + "\n").encode()
    for rows in parts_of(len(gaussians.position)):
        opacity = np.clip(gaussians.opacity[rows].astype(np.float64), OPAQUE, 1 - OPAQUE)
        by_channel = gaussians.harmonics[rows].transpose(0, 2, 1)
        harmonics = by_channel.reshape(len(opacity), width)
        columns = [
            gaussians.position[rows],
            np.zeros_like(gaussians.position[rows]),
            gaussians.color[rows],
            harmonics * np.float32(gaussians.harmonic_step),
            np.log(opacity / (1 - opacity))[:, None],
            np.log(gaussians.scale[rows]),
            gaussians.rotation[rows],
        ]
        table = np.concatenate(columns, axis=1, dtype="<f4", casting="same_kind")
        yield table.tobytes()


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
    names = file.names("chunk")
    ranged = ("x", "y", "z", "scale_x", "scale_y", "scale_z")
    missing = [f"{end}_{name}" for end in ("min", "max") for name in ranged]
    missing = [name for name in missing if name not in names]
    ends = [f"{end}_{name}" for end in ("min", "max") for name in "rgb"]
    if missing or names.intersection(ends) not in (set(), {*ends}):
        lacking = missing or [name for name in ends if name not in names]
        raise ValueError(f"has packed Gaussians, but no {lacking[0]} of their chunks")
    chunks, vertices = file.records("chunk"), file.records("vertex")
    wrong = [name for name in PACKED if vertices.dtype[name].newbyteorder("=") != np.uint32]
    if wrong:
        raise ValueError(f"has {wrong[0]} of type {vertices.dtype[wrong[0]]}; it must be uint")
    count = check_count(file.path.name, len(vertices))
    if len(chunks) != -(-count // CHUNK):
        raise ValueError(f"has {len(chunks)} chunks for {count} Gaussians; each has up to {CHUNK}")
    levels = _levels(vertices["packed_color"], ((24, 8), (16, 8), (8, 8), (0, 8)))
    colors = levels[:, :3]
    if "min_r" in names:
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
