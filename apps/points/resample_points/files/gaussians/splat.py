"""Read and write `.splat`, and read `.ksplat` of GaussianSplats3D.

A `.splat` file has 32 bytes per Gaussian, without a header. A `.ksplat` file has sections of
buckets of Gaussians, of three precisions. Places of lower precision are whole numbers relative to
the middle of a bucket. Scales, rotations and harmonics are floats of 32 bits, or of 16; the
coarsest precision has harmonics of 8 bits.
"""

import struct
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample_points.data.gaussians import Gaussians
from resample_points.data.harmonics import CONSTANT, COUNTS, rounded_to, step_of
from resample_points.files.gaussians.decoding import check_count

RECORD = np.dtype(
    [("position", "<f4", 3), ("scale", "<f4", 3), ("color", "u1", 4), ("rotation", "u1", 4)]
)


def read_splat(path: Path) -> Gaussians:
    """Read Gaussians of a `.splat` file; they have no harmonics."""
    size = path.stat().st_size
    if size % RECORD.itemsize:
        raise OSError(
            f"{path} is cut off or no .splat file: {size} bytes are not a multiple of "
            f"{RECORD.itemsize}"
        )
    check_count(path.name, size // RECORD.itemsize)
    records = np.fromfile(path, RECORD)
    level = records["color"].astype(np.float32) / np.float32(255)
    return Gaussians(
        position=records["position"].astype(np.float32),
        scale=records["scale"].astype(np.float32),
        rotation=(records["rotation"].astype(np.float32) - np.float32(128)) / np.float32(128),
        opacity=np.ascontiguousarray(level[:, 3]),
        color=(level[:, :3] - np.float32(0.5)) / np.float32(CONSTANT),
        harmonics=np.zeros((len(records), 0, 3), np.int16),
    )


def splat_bytes(gaussians: Gaussians) -> Iterator[bytes]:
    """Yield a file's bytes: the most visible first, as viewers that load in parts want them."""
    weight = gaussians.opacity * gaussians.scale.prod(axis=1, dtype=np.float64)
    order = np.argsort(-weight, kind="stable")
    records = np.zeros(len(order), RECORD)
    records["position"], records["scale"] = gaussians.position[order], gaussians.scale[order]
    light = gaussians.color[order] * np.float32(CONSTANT) + np.float32(0.5)
    level = np.column_stack([light, gaussians.opacity[order]])
    records["color"] = np.rint(np.clip(level, 0, 1) * 255)
    records["rotation"] = np.clip(np.rint(gaussians.rotation[order] * 128 + 128), 0, 255)
    yield records.tobytes()


HEAD, SECTION = 4096, 1024  # bytes of headers
FILE = struct.Struct("<2B2xIIIIH2x12xff")  # version, sections, Gaussians, precision, harmonics
PART = struct.Struct("<IIIIfH2xI4xIIH")  # counts, buckets, and their sizes
LEVELS = 2  # precisions above the exact one
STEPS = 32767  # of a place to either side of a bucket's middle, unless the file has others


def read_ksplat(path: Path) -> Gaussians:
    """Read Gaussians of a `.ksplat` file."""
    data = path.read_bytes()
    if len(data) < HEAD:
        raise OSError(f"{path} is cut off or no .ksplat file: {len(data)} bytes")
    major, minor, sections, _, _, count, precision, low, high = FILE.unpack_from(data)
    if (major, minor) != (0, 1) or precision > LEVELS:
        raise ValueError(
            f"has the version {major}.{minor} and precision {precision}; known are 0.1 and 0 to 2"
        )
    if sections * SECTION > len(data) - HEAD:
        raise OSError(f"{path} is cut off: it has {sections} sections")
    check_count(path.name, count)
    ends = (low, high) if low or high else (-1.5, 1.5)  # of old writers
    place, found = HEAD + sections * SECTION, list[tuple[NDArray[Any], ...]]()
    for n in range(sections):
        part, place = _section(data, n, place, precision, ends)
        if not part:
            raise OSError(f"{path} is cut off: section {n + 1} of {sections} is not there")
        found.append(part)
    if sum(len(part[0]) for part in found) == 0:
        raise ValueError("has no Gaussians")
    width = max(part[4].shape[1] for part in found)
    harmonics = np.concatenate(
        [np.pad(part[4], ((0, 0), (0, width - part[4].shape[1]), (0, 0))) for part in found]
    )
    position, scale, rotation, level = (
        np.concatenate([part[n] for part in found]) for n in range(4)
    )
    light = level.astype(np.float32) / np.float32(255)
    step = step_of(float(np.abs(harmonics).max(initial=0.0)))
    return Gaussians(
        position=position.astype(np.float32),
        scale=scale.astype(np.float32),
        rotation=rotation.astype(np.float32),
        opacity=np.ascontiguousarray(light[:, 3]),
        color=(light[:, :3] - np.float32(0.5)) / np.float32(CONSTANT),
        harmonics=rounded_to(harmonics, step),
        harmonic_step=step,
    )


def _section(
    data: bytes, n: int, place: int, precision: int, ends: tuple[float, float]
) -> tuple[tuple[NDArray[Any], ...], int]:
    """Return positions, scales, rotations, levels and harmonics (N, K, 3), and the section's end.

    Arrays are missing if the section is not there. `ends`: of harmonics of 8 bits.
    """
    held, capacity, in_bucket, buckets, block, stored, steps, full, partial, degree = (
        PART.unpack_from(data, HEAD + n * SECTION)
    )
    if degree >= len(COUNTS):
        raise ValueError(f"has harmonics of degree {degree}; 0 to 3 are known")
    whole, number = ("<u2", "<f2") if precision else ("<f4", "<f4")
    harmonic, count = ("<f4", "<f2", "u1")[precision], 3 * COUNTS[degree]
    fields = ("position", whole, 3), ("scale", number, 3), ("rotation", number, 4)
    record = np.dtype([*fields, ("color", "u1", 4), ("harmonics", harmonic, count)])
    begin = place + 4 * partial + stored * buckets
    end = begin + capacity * record.itemsize
    if begin > len(data) or end > len(data) or held > capacity:
        return (), end
    records = np.frombuffer(data, record, held, begin)
    position = records["position"].astype(np.float64)
    if precision:
        # Places are relative to the middles of buckets; full buckets come first.
        sizes = np.frombuffer(data, "<u4", partial, place).astype(np.int64)
        if stored < 12 or full + partial > buckets:
            raise ValueError(f"has buckets of {stored} bytes, or more of them than it says")
        sizes = np.concatenate([np.full(full, in_bucket, np.int64), sizes])
        if sizes.sum() < held or sizes.max(initial=0) > capacity:
            raise ValueError(f"has buckets of {sizes.sum()} Gaussians for {held}")
        raw = np.frombuffer(data, np.uint8, buckets * stored, place + 4 * partial)
        middle = np.ascontiguousarray(raw.reshape(-1, stored)[:, :12]).view("<f4")
        which = np.repeat(np.arange(len(sizes)), sizes)[:held]
        steps = steps or STEPS
        position = (position - steps) * (block / 2 / steps) + middle.astype(np.float64)[which]
    packed = records["harmonics"].astype(np.float32)
    if harmonic == "u1":
        packed = np.float32(ends[0]) + packed * np.float32((ends[1] - ends[0]) / 255)
    bands = [packed[:, 3 * low : 3 * high] for low, high in pairwise(COUNTS[: degree + 1])]
    by_channel = [band.reshape(len(band), 3, -1).transpose(0, 2, 1) for band in bands]
    none = np.zeros((len(packed), 0, 3), np.float32)
    harmonics = np.concatenate([none, *by_channel], axis=1)
    return (position, records["scale"], records["rotation"], records["color"], harmonics), end
