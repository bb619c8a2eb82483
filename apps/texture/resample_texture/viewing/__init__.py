"""Pictures and textured meshes for `resample-texture view`."""

from collections.abc import Sequence
from pathlib import Path

from resample_texture.viewing import pictures
from resample_texture.viewing.meshes import MESHES, mesh_picture, model_view
from resample_texture.viewing.pictures import picture, picture_view, view

__all__ = ["MESHES", "mesh_picture", "model_view", "picture", "picture_view", "suits", "view"]


def suits(names: Sequence[str]) -> bool:
    """Whether the names are one file with one picture or one mesh."""
    if len(names) == 1 and Path(names[0]).suffix.lower() in MESHES:
        return Path(names[0]).is_file()
    return pictures.suits(names)
