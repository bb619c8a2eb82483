"""Read 3D Gaussians of any known format, detected by content; write them by suffix."""

import errno
import logging
import zipfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from resample import registry
from resample.files.writing import replacing
from resample.messages import naming
from resample.reading.limits import check_size
from resample.reading.texts import json_of
from resample_points.data.curves import curve_through
from resample_points.data.gaussians import (
    DOWN,
    Gaussians,
    checked_gaussians,
    some_gaussians,
    training_of,
    with_up,
)
from resample_points.files.gaussians.ply import (
    NEEDED,
    TrainedFile,
    compressed_bytes,
    is_compressed,
    read_compressed,
    read_trained,
    trained_bytes,
)
from resample_points.files.gaussians.sog import META, is_description, read_sog, sog_bytes
from resample_points.files.gaussians.splat import splat_bytes
from resample_points.files.gaussians.spz import GZIP, MAGIC, is_spz, read_spz, spz_bytes
from resample_points.files.ply import ply_header

if TYPE_CHECKING:
    from resample.cameras.trajectories import PosedPicture

CAMERAS = ("cameras.json", "transforms.json", "sparse/0", "sparse")
KNOWN = "PLY and compressed PLY, .splat, .ksplat, SOG (a folder, its meta.json, or .sog) and SPZ"
LOG = logging.getLogger("resample")
ZIP = b"PK\3\4"


def read_gaussians(path: str | Path) -> Gaussians:
    """Read 3D Gaussians of a trained scene.

    Parameters
    ----------
    path
        A PLY file as trainers write them (ASCII or binary), a compressed PLY file of SuperSplat, a
        `.splat` or `.ksplat` file, SOG of version 1 or 2 (a folder, its meta.json, or a `.sog`
        file), or SPZ of version 1 to 4; version 4 needs the extra `zstd`. The content decides,
        except for `.splat` and `.ksplat`, which lack a magic number, and formats of other packages.

    Returns
    -------
    The Gaussians with activated values, in the file's own axes. Those that cannot be drawn are
    left out, see `checked_gaussians`. Coefficients of harmonics are stored in 16 bits; sizes
    beyond 32 are clipped, and degree 4 is left out.

    Raises
    ------
    ValueError
        The format is unknown, the file breaks its rules or a limit, or it has no Gaussians.
    OSError
        The file is missing, cut off or damaged.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> import numpy as np
    >>> from resample_points.files.gaussians.formats import read_gaussians
    >>> record = np.array([0, 0, 1, 0.1, 0.1, 0.2], "<f4").tobytes() + bytes([255] * 8)
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder) / "scene.splat"
    ...     _ = path.write_bytes(3 * record)
    ...     gaussians = read_gaussians(path)
    >>> gaussians.position.shape, gaussians.opacity.tolist()
    ((3, 3), [1.0, 1.0, 1.0])
    """
    source = Path(path)
    if not source.exists():
        raise FileNotFoundError(errno.ENOENT, "there is no such file", str(path))
    try:
        made = checked_gaussians(_reader(source)(source), source.name)
    except ValueError as error:
        raise ValueError(f"{source.name}: {error}") from None
    seen = training_of(made.position, made.scale, made.opacity, shots_beside(source))
    return made._replace(training=seen)


def shots_beside(path: Path) -> "list[PosedPicture]":
    """Read the training pictures with cameras beside a scene; empty if there are no cameras.

    They are `cameras.json`, `transforms.json` or the folder `sparse` of COLMAP, in the scene's
    folder or, of `point_cloud/iteration_30000/point_cloud.ply`, in the training's. Cameras
    that cannot be read are logged.
    """
    from resample.cameras.files import read_shots

    near = path.resolve().parent
    folders = [near, near.parents[1]] if near.parent.name == "point_cloud" else [near]
    for place in (folder / name for folder in folders for name in CAMERAS):
        if not place.exists():
            continue
        try:
            return read_shots(place)
        except (OSError, ValueError) as error:
            LOG.warning("%s is left out: %s", place.name, error)
    return []


def stored_gaussians(path: str | Path) -> TrainedFile | None:
    """Return a trainer's PLY file if its Gaussians can be mapped; None for other formats.

    Raises ValueError, OSError: as `read_gaussians`.
    """
    source = Path(path)
    if not source.is_file() or _reader(source) is not _read_ply:
        return None
    with naming(source.name):
        header = ply_header(source)
        return None if is_compressed(header) else TrainedFile(header)


def is_gaussians(path: str | Path) -> bool:
    """Whether a file or folder holds 3D Gaussians, by its content, or by its name for `.splat`.

    Nothing is raised for files that are missing or damaged.
    """
    source = Path(path)
    with suppress(OSError, ValueError, zipfile.BadZipFile):
        reader = _reader(source)
        if reader is _read_ply:
            header = ply_header(source)
            return is_compressed(header) or header.names() >= NEEDED
        if reader is read_spz:
            return is_spz(source)
        if reader not in (read_sog, _read_folder):
            return True
        if reader is read_sog and zipfile.is_zipfile(source):
            with zipfile.ZipFile(source) as packed:
                return META in packed.namelist()
        described = _description(source)
        check_size(str(described), described.stat().st_size, "tree")
        return is_description(json_of(described.read_text("utf-8-sig")))
    return False


def _reader(source: Path) -> Callable[[Path], Gaussians]:
    """Return the reader of a file."""
    if source.is_dir():
        return _read_folder
    if not source.is_file():
        raise ValueError("is a device or a pipe, not a file")
    with source.open("rb") as file:
        start = file.read(4)
    if start.startswith(b"ply"):
        return _read_ply
    if start.startswith((MAGIC, GZIP)):
        return read_spz
    if start == ZIP:
        return read_sog
    if source.suffix.lower() == ".json":
        return read_sog
    if (name := source.suffix.lower()[1:]) in registry.names("gaussians"):
        unmarked: Callable[[Path], Gaussians] = registry.load("gaussians", name)
        return unmarked
    raise ValueError(f"holds no 3D Gaussians that can be read; known are {KNOWN}")


def _read_ply(source: Path) -> Gaussians:
    header = ply_header(source)
    return read_compressed(header) if is_compressed(header) else read_trained(header)


def _description(source: Path) -> Path:
    """Return the meta.json of a folder, or the file itself."""
    return source / META if source.is_dir() else source


def _read_folder(source: Path) -> Gaussians:
    described = _description(source)
    if not described.is_file():
        raise ValueError(f"is a folder without {META}; known are {KNOWN}")
    return read_sog(described)


COMPRESSED = ".compressed.ply"
SUFFIXES = (".ply", COMPRESSED, ".spz", ".sog", ".splat")
NAMED = ("x", "y", "z")  # axes that PLY files name
UP = "y"  # of SPZ


def write_gaussians(path: str | Path, gaussians: Gaussians) -> None:
    """Write Gaussians in the format of the suffix.

    Parameters
    ----------
    path
        `.ply`, as trainers write it and most programs read it: all numbers are kept, opacities of
        0 and 1 become 1e-7 and 1 - 1e-7; `.compressed.ply` of SuperSplat; `.spz` of version 3;
        `.sog` of version 2, with a palette of at most 65,536 harmonics; or `.splat`, without
        harmonics. The last four round numbers, and order Gaussians anew.
    gaussians
        A scene. Where its axis up is not the format's, the scene is turned: SPZ has y up,
        `.sog` and `.splat` have y down; PLY names x, y or z, and else has y down.

    Raises
    ------
    ValueError
        The suffix is another, an array has another shape, or the format does not hold a number.
    OSError
        The file cannot be written.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> import numpy as np
    >>> from resample_points import Gaussians, read_gaussians, write_gaussians
    >>> parts = (np.ones((1, n), np.float32) for n in (3, 3, 4))
    >>> one = Gaussians(*parts, np.array([0.5]), np.zeros((1, 3)))
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder) / "scene.ply"
    ...     write_gaussians(path, one)
    ...     read_gaussians(path).opacity.tolist()
    [0.5]
    """
    target = Path(path)
    suffix = suffix_of(target)
    scene = checked_gaussians(gaussians, target.name)
    is_ply = suffix.endswith(".ply")
    if suffix == ".spz":
        scene = with_up(scene, UP)
    elif not (is_ply and scene.up in NAMED):
        scene = with_up(scene, DOWN)
    if suffix != ".ply":
        codes = curve_through(scene.position).codes(scene.position)
        scene = some_gaussians(scene, np.argsort(codes, kind="stable"))
    comments = ["comment SplatRenderMode: mip"] * scene.is_antialiased
    if scene.up in NAMED:
        comments.append(f"comment Vertical Axis: {scene.up}")
    writers: dict[str, Callable[[], Iterator[bytes]]] = {
        ".ply": lambda: trained_bytes(scene, comments),
        COMPRESSED: lambda: compressed_bytes(scene, comments),
        ".spz": lambda: spz_bytes(scene),
        ".sog": lambda: sog_bytes(scene),
        ".splat": lambda: splat_bytes(scene),
    }
    with replacing(target) as temporary, temporary.open("wb") as file:
        for part in writers[suffix]():
            file.write(part)


def suffix_of(path: Path) -> str:
    """Return the one of `SUFFIXES` that a name ends in."""
    name = path.name.lower()
    known = [suffix for suffix in SUFFIXES if name.endswith(suffix)]
    if not known:
        raise ValueError(f"{path.name}: Gaussians are written as {', '.join(SUFFIXES)}")
    return max(known, key=len)
