"""Read scans of KITTI and nuScenes: float32 numbers without a header."""

from pathlib import Path

import numpy as np

from resample_points.data.cloud import Cloud
from resample_points.data.coloring import colored_as_scanned
from resample_points.data.parts import STEP
from resample_points.files.parsing import binary_cloud

KITTI = ("x", "y", "z", "intensity")
NUSCENES = (*KITTI, "ring")
FARTHEST = 1e6  # greatest plausible number of a scan


def read_bin(path: Path) -> Cloud:
    """Read a `.bin` scan of KITTI, or a `.pcd.bin` scan of nuScenes; gray by intensity."""
    names = NUSCENES if path.name.lower().endswith(".pcd.bin") else KITTI
    kind, size = np.dtype([(name, "<f4") for name in names]), path.stat().st_size
    told = f"is no scan of KITTI: {len(names)} numbers ({' '.join(names)}) of float32 per point"
    if size % kind.itemsize or not size:
        raise ValueError(f"{told}, but its {size} bytes are no multiple of {kind.itemsize}")
    with path.open("rb") as file:
        some = np.frombuffer(file.read(STEP * kind.itemsize), "<f4")
        if not bool(np.all(np.abs(some) <= FARTHEST)):  # nor NaN
            raise ValueError(f"{told}, but it holds numbers beyond {FARTHEST:g}, or NaN")
        file.seek(0)
        return colored_as_scanned(binary_cloud(path, file, size // kind.itemsize, kind))
