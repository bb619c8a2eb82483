"""Every reader of the library by the kind of its files; what is lazy is read to its end."""

from collections.abc import Callable
from pathlib import Path
from unittest.mock import patch

import numpy as np

from resample.cameras.calibrations import read_intrinsics, read_lens
from resample.cameras.files import read_entries, viewpoint
from resample.cameras.keyframes import read_keyframes
from resample.command.flags import marks_of
from resample.command.settings import options_of, read_settings
from resample.engine.compiled import entries
from resample.files.pictures import read_picture
from resample.files.sequences import frames_of
from resample_meshes.files import load_mesh
from resample_particles.files import read_particles
from resample_points.files.gaussians.formats import read_gaussians
from resample_points.files.readers import read_cloud
from resample_texture.geometry.mappings import read_map
from resample_texture.geometry.matrices import parse_matrix
from resample_volume.classification.files import read_transfer
from resample_volume.cli import app
from resample_volume.files.source import open_recording
from resample_volume.meshes import read_mesh
from resample_warp3d.depth.files import read_depth


def _volume(path: Path) -> None:
    np.asarray(open_recording(path).values).sum()


def _series(path: Path) -> None:
    _volume(path.parent)


def _store(path: Path) -> None:
    """Read a store whose first file this is: in its folder, or below it."""
    _volume(next(folder for folder in path.parents if folder.name.endswith(".zarr")))


def _kernel(path: Path) -> None:
    with patch.object(entries.LOG, "disabled", True):
        if entries.read(path) is None:
            raise ValueError("the entry is damaged")


def _film(path: Path) -> None:
    frames = frames_of(path)
    if frames is None:
        read_picture(path)
    else:
        for picture in frames.read():
            picture.data.sum()


def _lens(path: Path) -> None:
    try:
        read_lens(str(path))
    except ValueError:
        read_intrinsics(str(path))


READERS: dict[str, Callable[[Path], object]] = {
    "volume": _volume,
    "series": _series,
    "store": _store,
    "kernel": _kernel,
    "picture": read_picture,
    "film": _film,
    "depth": read_depth,
    "map": read_map,
    "matrix": lambda path: parse_matrix(str(path)),
    "cloud": read_cloud,
    "gaussians": read_gaussians,
    "particles": read_particles,
    "coarse-cloud": lambda path: read_cloud(path, level=1),
    "mesh": load_mesh,
    "scene-mesh": lambda path: read_mesh(str(path)),
    "poses": read_entries,
    "viewpoint": lambda path: viewpoint(str(path)),
    "lens": _lens,
    "transfer": read_transfer,
    "keyframes": read_keyframes,
    "settings": lambda path: read_settings(
        path,
        "resample-volume render",
        options_of(app["render"]),
        marks_of(app["render"].default_command),
    ),
}
