"""Disk cache of the normals and discs of clouds.

Neighbours are searched once per cloud, not once per picture. Files are in the user's cache, or in
the folder that HYBRID_RESAMPLE_CACHE names; the least recently used are deleted when all together
exceed `MOST_BYTES`. A file that is damaged or cannot be written only costs the time to measure
again.
"""

import hashlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from resample.files.cached import load_arrays, source_fingerprint, store_arrays
from resample.memory import mapped
from resample.types import Floats

MOST_BYTES = 1 << 30
LEAST_POINTS = 20_000  # fewer are measured about as fast as loaded
WIDTH = 9  # numbers per point: a normal and two half axes
# Modules that measure discs.
CODE = ("resample_points.geometry.spacing", "resample_points.geometry.kernels")


def folder() -> Path:
    """Return the cache's folder."""
    return mapped.folder() / "clouds"


def measured_once(
    position: Floats, normal: Floats, axes: Floats, largest: float, measure: Callable[[], None]
) -> None:
    """Fill in normals and discs from the cache, or measure and cache them.

    Parameters
    ----------
    position
        (N, 3), sorted.
    normal
        (N, 3) 0 where unknown; filled in.
    axes
        (N, 2, 3) filled in.
    """
    if len(position) < LEAST_POINTS:
        measure()
        return
    path = folder() / f"{_name(position, normal, largest)}.npz"
    found = _read(path, len(position))
    if found is not None:
        normal[:], axes[:] = found[:, :3], found[:, 3:].reshape(-1, 2, 3)
        return
    measure()
    numbers = np.concatenate([normal, axes.reshape(-1, 6)], axis=1, dtype=np.float32)
    store_arrays(path, {"measured": numbers}, MOST_BYTES)


def _name(position: Floats, normal: Floats, largest: float) -> str:
    """Return the cache key of a cloud: a hash of its points and of the code."""
    digest = hashlib.sha256(f"{source_fingerprint(*CODE)} {largest!r} {position.shape}".encode())
    for array in (position, normal):
        digest.update(np.ascontiguousarray(array, np.float32).data)
    return digest.hexdigest()[:40]


def _read(path: Path, count: int) -> Floats | None:
    """Read a cache file; None if it is missing or damaged."""
    held = load_arrays(path, "measured")
    found = None if held is None else held["measured"]
    if found is None or found.shape != (count, WIDTH) or found.dtype != np.float32:
        return None
    return found
