"""Stereo pictures and films in one call, with the options of the commands by their names."""

from collections.abc import Iterator
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.messages import shortly

Named = str | PathLike[str]


def stereo(
    picture: Any, depth: Any = None, output: Named | None = None, **options: Any
) -> NDArray[np.uint8] | None:
    """Make the other eye's picture, or both, as `resample-warp3d stereo` does.

    Parameters
    ----------
    picture
        A picture or film by its path, or levels (H, W, 3 or 4) of 8 bits.
    depth
        A path, or numbers (H, W): disparity, depth or relative depth, which is recognised and said;
        None with `depth_model`.
    output
        File to write; None: return the picture.
    options
        Options of the command: `layout`, `eyes`, `divergence`, `convergence`, `depth_kind`, `fill`,
        `fraction`, ...

    Returns
    -------
    Levels (H, W, 3 or 4) if there is no output; with opacity, where there are holes.

    Raises
    ------
    ValueError, TypeError, OSError
        As for the command.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import stereo
    >>> left = np.zeros((24, 32, 3), np.uint8)
    >>> left[:, 20] = 255  # a line
    >>> both = stereo(left, np.full((24, 32), 6.0), layout="sbs", depth_kind="pair")
    >>> both.shape, np.flatnonzero(both[12, :, 0] > 128).tolist()
    ((24, 64, 3), [20, 46])
    """
    from PIL import Image

    from resample.command.applications import run

    with _files(picture, depth) as (names, folder):
        made = folder / "stereo.png" if output is None else Path(output)
        run("warp3d", "stereo", *names, output=made, **options)
        return np.asarray(Image.open(made)) if output is None else None


def animate(picture: Any, depth: Any, output: Named, **options: Any) -> None:
    """Film a picture with depth as `resample-warp3d animate` does: a camera moves in it.

    Parameters
    ----------
    picture, depth
        As for `stereo`; depth of the kind that `depth_kind` says.
    output
        Film to write: `.mp4`, `.webm`, `.gif`, `.webp`, `.apng`, or a folder of pictures.
    options
        Options of the command: `path`, `amount`, `frames`, `fov`, `fill`, ...

    Raises
    ------
    ValueError, TypeError, OSError
        As for the command.

    Examples
    --------
    >>> import numpy as np, tempfile, pathlib
    >>> from resample_warp3d import animate
    >>> film = pathlib.Path(tempfile.mkdtemp()) / "sway.webp"
    >>> animate(np.zeros((24, 32, 3), np.uint8), np.full((24, 32), 4.0), film, fov=60, frames=2)
    >>> film.stat().st_size > 0
    True
    """
    from resample.command.applications import run

    with _files(picture, depth) as (names, _):
        run("warp3d", "animate", *names, output=Path(output), **options)


@contextmanager
def _files(picture: Any, depth: Any) -> Iterator[tuple[list[str], Path]]:
    """Names of a picture and its depth, which are written to a folder unless they have some."""
    from PIL import Image

    with TemporaryDirectory() as folder:
        names = []
        if isinstance(picture, str | PathLike):
            names.append(str(picture))
        elif np.ndim(picture) in (2, 3) and np.asarray(picture).dtype == np.uint8:
            names.append(str(Path(folder) / "picture.png"))
            Image.fromarray(np.asarray(picture)).save(names[0])
        else:
            raise TypeError(f"a picture {shortly(picture)}; give a path or levels of 8 bits")
        if isinstance(depth, str | PathLike):
            names.append(str(depth))
        elif depth is not None:
            names.append(str(Path(folder) / "depth.npy"))
            np.save(names[1], np.asarray(depth))
        yield names, Path(folder)
