"""Read a point cloud of any format; the formats have files of their own."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from resample import registry
from resample.memory.mapped import is_in_file
from resample.messages import reader_of
from resample.reading.limits import check_file
from resample_points.data.cloud import Cloud, kept_columns, linear, some_of

SNAPSHOTS = (".hdf5", ".h5", ".he5")  # of particles, which another package maps
LASER = (".las", ".laz")  # large files are read in parts
PARTS = {"position": (3,), "normal": (3,), "color": (3,), "radius": ()}  # shapes per point


def read_cloud(path: str | Path, *, level: int = 0, columns: Sequence[str] | None = None) -> Cloud:
    """Read a point cloud.

    A cloud that does not fit into memory, or into what `resample.memory.allowing` permits, is read
    part by part into memory-mapped arrays: LAS, LAZ, COPC, and binary PLY and PCD. They are used
    like any other arrays.

    Parameters
    ----------
    path
        The suffix decides. `.ply` and `.pcd`: ASCII and all binary kinds. `.xyz`, `.pts`, `.txt`,
        `.asc` or `.csv`: text of numbers in columns (x y z, then r g b, then a normal; x y z and a
        value; x y z intensity r g b; or as named by the first line), before which their number may
        stand. `.xyzn`: x y z and a normal. `.bin`: KITTI's x y z intensity, `.pcd.bin` nuScenes'.
        `.npz`: the arrays position and, if known, normal, color (floats: linear light) and radius.
        Other colors are taken for sRGB: whole numbers of 8 bits, or of 16 if one is above 255;
        floats from 0 to 1, or as whole numbers if one is above 2. Further values per point are
        kept as columns. `.las` and `.laz`, including COPC, need the extra `las`, `.e57` the extra
        `e57`. If these, `.pts` and `.bin` have no colors, points are gray by their intensity, or
        else colored by class.
    level
        Number of the finest levels of a COPC file to skip.
    columns
        Names of columns to keep. Default: all.

    Returns
    -------
    The points with finite positions. A mesh's triangles are ignored: its vertices are points.

    Raises
    ------
    ValueError
        The format is unknown, the file does not have it, it has no points or lacks a column, or
        neither memory nor disk has room for it.
    OSError
        The file is missing, cut off or damaged.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> import numpy as np
    >>> from resample_points import read_cloud
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder) / "scan.xyz"
    ...     np.savetxt(path, [[0, 0, 1, 255, 0, 0], [0, 1, 1, 0, 255, 0]])
    ...     cloud = read_cloud(path)
    >>> cloud.position.shape, cloud.color[0].tolist()
    ((2, 3), [1.0, 0.0, 0.0])
    """
    source = Path(path)
    check_file(path)
    known = suffixes()
    if source.suffix.lower() in SNAPSHOTS:
        mapped = f"{source.name} holds particles, which `resample-points density` maps and films"
        raise ValueError(registry.missing("commands", "points.density") or mapped)
    if source.suffix.lower() not in known:
        other = f"{reader_of(path)}; " if reader_of(path) else ""
        if source.suffix.lower() == ".npy":
            other = "numpy.savetxt('points.xyz', array) writes an array of points; "
        raise ValueError(f"{path}: {other}clouds are read from {', '.join(known)}")
    if level and source.suffix.lower() not in LASER:
        raise ValueError(f"{source.name} has no levels, which COPC files have")
    reader = registry.load("clouds", source.suffix.lower()[1:])
    try:
        if source.suffix.lower() in LASER:
            laser: Cloud = reader(source, level, columns)
            return laser
        cloud = kept_columns(reader(source), columns)
    except ValueError as error:
        raise ValueError(f"{source.name}: {error}") from None
    if is_in_file(cloud.position):
        return cloud
    finite = np.asarray(np.isfinite(cloud.position).all(axis=1))
    if not finite.any():
        raise ValueError(f"{source.name}: has no points")
    return cloud if finite.all() else some_of(cloud, finite)


def suffixes() -> list[str]:
    """Suffixes of the files that `read_cloud` reads."""
    return [f".{name}" for name in registry.names("clouds")]


def is_cloud(path: Path) -> bool:
    """Whether a file is a cloud by its suffix, or for `.npz` by the names of its arrays."""
    if path.suffix.lower() != ".npz":
        return path.suffix.lower() in suffixes()
    from resample.reading.arrays import npz_names

    try:
        return "position" in npz_names(path)
    except OSError:
        return False


def read_arrays(path: Path) -> Cloud:
    """Read `.npz`: arrays by the names of a cloud's parts."""
    from resample.reading.arrays import read_npz

    known: dict[str, Any] = read_npz(path)
    if "position" not in known:
        raise ValueError(f"has no array position; a cloud has {', '.join(PARTS)}")
    count = len(known["position"]) if known["position"].ndim else 0
    parts = {name: known.pop(name, np.zeros((0, *rest))) for name, rest in PARTS.items()}
    for name, part in parts.items():
        if part.shape[1:] != PARTS[name] or len(part) not in {count, 0}:
            raise ValueError(f"{name} has the shape {part.shape}; give {(count, *PARTS[name])}")
    position = parts.pop("position")
    if parts["color"].dtype.kind in "iu":  # levels of a file, not light
        parts["color"] = linear(parts["color"])
    kind = np.float32 if position.dtype == np.float32 else np.float64
    single = {name: part.astype(np.float32) for name, part in parts.items()}
    columns = {
        name: part
        for name, part in known.items()
        if part.shape == (count,) and part.dtype.kind in "iufb"
    }
    return Cloud(position.astype(kind), **single, columns=columns)
