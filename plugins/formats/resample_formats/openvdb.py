"""OpenVDB: grids of floats."""

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from resample.messages import one_line
from resample.reading.limits import check_items, check_unpacked
from resample.reading.native import plain
from resample_volume.data.values import require_memory
from resample_volume.files.headers import (
    check_shape,
    existing_file,
    header,
    stem,
    volume,
)
from resample_volume.types import Volume

FLOATS = "Tree_float"  # prefix of supported types
USUAL = "density"  # default grid if there are several
LEVEL_SET = "level set"
DENSE = "write it as .npy or .nrrd from OpenVDB's Python (grid.copyToArray) or from Houdini"


@dataclass(frozen=True)
class Vdb:
    """A float grid of an OpenVDB file, dense over the box of its active voxels.

    Inactive voxels have the background; those of a level set are missing.
    """

    part: str = ""  # name of the grid; empty: the only one of floats, or density

    suffixes: ClassVar[tuple[str, ...]] = (".vdb",)

    def __call__(self, path: Path) -> Volume:
        name = stem(existing_file(path), self.suffixes)
        try:
            library: Any = import_module("tinyvdb")
        except ImportError:
            raise ValueError(
                f"{path.name}: .vdb is read by tinyvdb; pip install 'hybrid-resample[vdb]', or "
                f"{DENSE}"
            ) from None
        try:
            with library.open(plain(path)) as file:
                check_items(path.name, file.grid_count, "grids")
                file.read_grids()
                # Find the grid by its name.
                grids = [file.grid(n) for n in range(file.grid_count)]
                floats = [grid for grid in grids if grid.type_name.startswith(FLOATS)]
                found = [grid for grid in floats if grid.name == (self.part or USUAL)]
                if not self.part and len(floats) == 1:
                    found = floats
                if not found:
                    known = ", ".join(
                        f"{grid.name} ({grid.type_name.split('_')[1:2][0]})" for grid in grids
                    )
                    raise ValueError(
                        f"{path.name}: choose a grid of floats, --reader vdb:part=NAME "
                        f"({self.part or 'none'} given): {known or 'there is none'}"
                    )
                return _volume(found[0], path, name)
        except (library.VDBError, MemoryError, SystemError, UnicodeDecodeError) as error:
            raise ValueError(
                f"{path.name} is damaged or no OpenVDB file: {one_line(error) or 'cut off'}"
            ) from None


def _volume(grid: Any, path: Path, name: str) -> Volume:
    """Make a dense volume of a grid."""
    told = grid.metadata
    sparse = grid.to_sparse()
    place = np.frombuffer(sparse["coords"], np.int32).reshape(-1, 3).astype(np.int64)
    value = np.frombuffer(sparse["values"], np.float32)
    active = told.get("file_voxel_count", len(value))
    if isinstance(active, int) and active > len(value):
        raise ValueError(
            f"{path.name}: {grid.name} has {active} active voxels, of which "
            f"{active - len(value)} lie in tiles, which tinyvdb does not read; {DENSE}"
        )
    if not len(value):
        raise ValueError(f"{path.name} is empty: {grid.name} has no active voxels")
    low, high = place.min(axis=0), place.max(axis=0)
    shape = tuple((high - low + 1).tolist())
    check_shape(shape, name)
    check_unpacked(path.name, path.stat().st_size, 4 * int(np.prod(shape, dtype=object)))
    # The header by a grid's transform from indices to world space
    kind = grid.transform["type"]
    if kind == "affine":  # row vectors
        matrix = np.array(grid.transform["matrix"], np.float64)
        steps, start = matrix[:3, :3].T, matrix[3, :3]
    elif kind in ("uniform_scale", "uniform_scale_translate", "scale", "scale_translate"):
        steps = np.diag(np.array(grid.transform["scale"], np.float64))
        start = np.array(grid.transform["translation"], np.float64)
    elif kind == "translation":
        steps, start = np.eye(3), np.array(grid.transform["translation"], np.float64)
    else:
        raise ValueError(
            f"{path.name} has a map {kind!r:.40} of space, which is not known; {DENSE}"
        )
    with np.errstate(all="ignore"):  # absurd numbers are rejected, without warnings
        origin = steps @ low + start
    known = header(shape, np.float32, path.name, origin=origin, direction=steps)
    require_memory(known.size, name)
    is_level_set = told.get("class", "") == LEVEL_SET
    beside = np.nan if is_level_set else grid.float_background()
    values = np.full(shape[::-1], beside, np.float32)
    x, y, z = (place - low).T
    values[z, y, x] = value
    share = 100 * len(value) / values.size
    rest = "have no value" if is_level_set else f"are its background, {beside:.4g}"
    note = f"{grid.name}: {share:.3g} % of the voxels are active, others {rest}"
    return volume(values, known._replace(name=name))._replace(note=note)
