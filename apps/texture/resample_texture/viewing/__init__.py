"""Pictures and textured meshes for `resample-texture view`."""

from collections.abc import Sequence
from pathlib import Path

from resample_texture.viewing import pictures
from resample_texture.viewing.meshes import MESHES, mesh_picture, model_view
from resample_texture.viewing.pictures import COMMAND, PLACES, PictureView, picture

__all__ = ["COMMAND", "PLACES", "PictureView", "mesh_picture", "model_view", "picture", "suits"]


def suits(names: Sequence[str]) -> bool:
    """Whether the names are one file with one picture or one mesh."""
    if len(names) == 1 and Path(names[0]).suffix.lower() in MESHES:
        return Path(names[0]).is_file()
    return pictures.suits(names)
