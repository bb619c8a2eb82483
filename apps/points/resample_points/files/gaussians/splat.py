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
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles
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


class _Section(NamedTuple):
    """A section's header, and where its parts begin, bytes."""

    held: int  # Gaussians
    capacity: int  # Gaussians that it has room for
    in_bucket: int  # Gaussians of a full bucket
    buckets: int
    block: float  # side of a bucket, scene units
    stored: int  # bytes per bucket
    steps: int
    full: int  # buckets
    partial: int  # buckets, whose sizes are listed
    degree: int


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
    if not (low or high):
        low, high = -1.5, 1.5  # of old writers
    place, found = HEAD + sections * SECTION, list[tuple[NDArray[Any], ...]]()
    for n in range(sections):
        head = _Section(*PART.unpack_from(data, HEAD + n * SECTION))
        if head.degree >= len(COUNTS):
            raise ValueError(f"has harmonics of degree {head.degree}; 0 to 3 are known")
        record = _record(precision, head.degree)
        begin = place + 4 * head.partial + head.stored * head.buckets
        place_of_next = begin + head.capacity * record.itemsize
        if begin > len(data) or place_of_next > len(data) or head.held > head.capacity:
            raise OSError(f"{path} is cut off: section {n + 1} of {sections} is not there")
        records = np.frombuffer(data, record, head.held, begin)
        middle = _middles(data, head, place) if precision else np.zeros((head.held, 3))
        found.append(_decoded(records, head, middle, (low, high)))
        place = place_of_next
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


def _record(precision: int, degree: int) -> np.dtype[Any]:
    """Return the type of stored Gaussians."""
    place, number = ("<u2", "<f2") if precision else ("<f4", "<f4")
    harmonic = ("<f4", "<f2", "u1")[precision]
    return np.dtype(
        [
            ("position", place, 3),
            ("scale", number, 3),
            ("rotation", number, 4),
            ("color", "u1", 4),
            ("harmonics", harmonic, 3 * COUNTS[degree]),
        ]
    )


def _middles(data: bytes, head: _Section, place: int) -> Doubles:
    """Return the middle (N, 3) of each Gaussian's bucket; full buckets are first."""
    sizes = np.frombuffer(data, "<u4", head.partial, place).astype(np.int64)
    if head.stored < 12 or head.full + head.partial > head.buckets:
        raise ValueError(f"has buckets of {head.stored} bytes, or more of them than it says")
    whole = np.concatenate([np.full(head.full, head.in_bucket, np.int64), sizes])
    if whole.sum() < head.held or whole.max(initial=0) > head.capacity:
        raise ValueError(f"has buckets of {whole.sum()} Gaussians for {head.held}")
    raw = np.frombuffer(data, np.uint8, head.buckets * head.stored, place + 4 * head.partial)
    middle = np.ascontiguousarray(raw.reshape(-1, head.stored)[:, :12]).view("<f4")
    which = np.repeat(np.arange(len(whole)), whole)[: head.held]
    return middle.astype(np.float64)[which]


def _decoded(
    records: NDArray[Any], head: _Section, middle: Doubles, ends: tuple[float, float]
) -> tuple[NDArray[Any], ...]:
    """Return positions, scales, rotations, levels of colors, and harmonics (N, K, 3)."""
    position = records["position"].astype(np.float64)
    if records.dtype["position"].base.kind == "u":
        steps = head.steps or STEPS
        position = (position - steps) * (head.block / 2 / steps) + middle
    stored = records["harmonics"].astype(np.float32)
    if records.dtype["harmonics"].base.kind == "u":
        stored = np.float32(ends[0]) + stored * np.float32((ends[1] - ends[0]) / 255)
    bands = [stored[:, 3 * low : 3 * high] for low, high in pairwise(COUNTS[: head.degree + 1])]
    by_channel = [band.reshape(len(band), 3, -1).transpose(0, 2, 1) for band in bands]
    none = np.zeros((len(stored), 0, 3), np.float32)
    harmonics = np.concatenate([none, *by_channel], axis=1)
    return position, records["scale"], records["rotation"], records["color"], harmonics
