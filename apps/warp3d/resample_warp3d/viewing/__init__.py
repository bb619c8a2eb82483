"""Depth images and point clouds for `resample-warp3d view`."""

from collections.abc import Sequence
from pathlib import Path

from resample_warp3d.clouds.files import READERS
from resample_warp3d.viewing.clouds import CloudView, cloud_picture
from resample_warp3d.viewing.depths import DepthView, picture

__all__ = ["CloudView", "DepthView", "cloud_picture", "picture", "suits"]
DEPTHS = (".png", ".tif", ".tiff", ".exr", ".pfm", ".npy", ".npz")


def suits(names: Sequence[str]) -> bool:
    """Whether the names are a picture and its depth, or a cloud."""
    if not all(Path(name.partition(":")[0]).is_file() for name in names):
        return False
    if len(names) == 1:
        return Path(names[0]).suffix.lower() in READERS
    return len(names) == 2 and Path(names[1].partition(":")[0]).suffix.lower() in DEPTHS
