"""Depth images for `resample-warp3d view`."""

from collections.abc import Sequence
from pathlib import Path

from resample_warp3d.viewing.depths import depth_view, picture, view

__all__ = ["depth_view", "picture", "suits", "view"]
DEPTHS = (".png", ".tif", ".tiff", ".exr", ".pfm", ".npy", ".npz")


def suits(names: Sequence[str]) -> bool:
    """Whether the names are a picture and its depth."""
    if not all(Path(name.partition(":")[0]).is_file() for name in names):
        return False
    return len(names) == 2 and Path(names[1].partition(":")[0]).suffix.lower() in DEPTHS
