"""Read and write `.splat` files: 32 bytes per Gaussian, without a header."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from resample_points.data.gaussians import Gaussians
from resample_points.data.harmonics import CONSTANT
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
