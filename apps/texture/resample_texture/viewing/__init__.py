"""Pictures and textured meshes for `resample-texture view`."""

from collections.abc import Sequence
from pathlib import Path

from resample_texture.viewing import pictures
from resample_texture.viewing.meshes import MESHES, ModelView, mesh_picture
from resample_texture.viewing.pictures import COMMAND, PLACES, PictureView, picture

__all__ = ["COMMAND", "PLACES", "ModelView", "PictureView", "mesh_picture", "picture", "suits"]


def suits(names: Sequence[str]) -> bool:
    """Whether the names are one file with one picture or one mesh."""
    if len(names) == 1 and Path(names[0]).suffix.lower() in MESHES:
        return Path(names[0]).is_file()
    return pictures.suits(names)
