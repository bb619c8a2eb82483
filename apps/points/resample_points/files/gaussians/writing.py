"""Write 3D Gaussians in the format of a file's suffix."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from resample.files.writing import replacing
from resample_points.data.curves import curve_through
from resample_points.data.gaussians import Gaussians, checked_gaussians, some_gaussians
from resample_points.data.joining import DOWN, with_up
from resample_points.files.gaussians.compressed import compressed_bytes
from resample_points.files.gaussians.sog import sog_bytes
from resample_points.files.gaussians.splat import splat_bytes
from resample_points.files.gaussians.spz import spz_bytes
from resample_points.files.gaussians.trained import trained_bytes

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
        `.sog` of version 2, whose harmonics are a palette of at most 65,536; or `.splat`, without
        harmonics. The last four round numbers, and order Gaussians anew.
    gaussians
        A scene. Where its axis up is not that of the format, the scene is turned: SPZ has y up,
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
    """Return which of `SUFFIXES` a name ends in."""
    name = path.name.lower()
    known = [suffix for suffix in SUFFIXES if name.endswith(suffix)]
    if not known:
        raise ValueError(f"{path.name}: Gaussians are written as {', '.join(SUFFIXES)}")
    return max(known, key=len)
