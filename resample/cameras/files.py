"""The door to files of poses and cameras, whichever program wrote them.

Whatever a file's convention, what comes out maps world to camera, with x to the right, y down and
the view along +z; where intrinsics come along, their pixel centers are at + 0.5.
"""

import errno
from collections.abc import Callable, Mapping
from pathlib import Path

from resample.cameras.calibrations import read_colmap, read_nerf
from resample.cameras.models import Camera
from resample.cameras.tables import read_toml, read_viewpoint
from resample.cameras.trajectories import (
    Shot,
    lines_of,
    read_icl,
    read_log,
    read_matrices,
    read_tum,
)
from resample.cameras.viewpoints import Calibrated, Orbit, Spot, Viewpoint
from resample.types import Doubles

KINDS: Mapping[str, Callable[[Path], list[Shot]]] = {
    "matrix": read_matrices,
    "tum": read_tum,
    "icl": read_icl,
    "log": read_log,
    "nerf": read_nerf,
    "colmap": read_colmap,
    "toml": read_toml,
}
SUFFIXES = {".npy": "matrix", ".json": "nerf", ".log": "log", ".toml": "toml"}


def read_shots(path: str | Path, kind: str | None = None) -> list[Shot]:
    """All poses of a file.

    Parameters
    ----------
    path
        File, or the folder of a COLMAP model.
    kind
        One of `KINDS`; None recognises it by name and content.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        It holds something else, or what it is cannot be told.
    """
    file = Path(path)
    if not file.exists():
        raise FileNotFoundError(errno.ENOENT, "there is no such file", str(path))
    if kind is not None and kind not in KINDS:
        raise ValueError(f"unknown kind of poses {kind!r}; known: {', '.join(KINDS)}")
    shots = KINDS[kind or _recognised(file)](file)
    if not shots:
        raise ValueError(f"{path} holds no poses")
    return shots


def read_poses(path: str | Path, kind: str | None = None) -> list[Doubles]:
    """Poses (4, 4) of a file, world to camera; as `read_shots` takes and refuses it."""
    return [shot.pose for shot in read_shots(path, kind)]


def read_pose(text: str, kind: str | None = None) -> Doubles:
    """Pose (4, 4), world to camera, of `file` or `file:frame`; see `read_shot`."""
    return read_shot(text, kind).pose


def read_camera(text: str, kind: str | None = None) -> Camera:
    """Camera of `file` or `file:frame`; see `read_shot`.

    Raises
    ------
    ValueError
        The file has a pose but no intrinsics, or not enough of them.
    """
    camera = read_shot(text, kind).camera
    if camera is None:
        raise ValueError(
            f"{text} has no intrinsics, or no size of the picture; give them beside it"
        )
    return camera


def read_shot(text: str, kind: str | None = None) -> Shot:
    """One pose of a file.

    Parameters
    ----------
    text
        `file` if it holds one pose; `file:3` for the fourth; `file:name` for the picture or time of
        that name, of which folders and the suffix may be left out.
    kind
        As `read_shots` takes it.

    Raises
    ------
    OSError, ValueError
        The file is none that can be read.
    LookupError
        It has no such frame, or several.
    """
    path, frame = file_and_frame(text)
    shots = read_shots(path, kind)
    if frame:
        return shots[_index(path, shots, frame)]
    if len(shots) > 1:
        raise LookupError(f"{path} holds {len(shots)} poses; pick one as {path}:{_choice(shots)}")
    return shots[0]


def file_and_frame(text: str) -> tuple[str, str]:
    """File and frame of `file:frame`; the frame is empty where there is none."""
    path, frame = (text, "") if Path(text).exists() else text.rpartition(":")[::2]
    return (path, frame) if path and Path(path).exists() else (text, "")


def viewpoint(text: str, fov: float = Orbit.fov, up: str = Orbit.up) -> Viewpoint:
    """Where something is seen from, as command lines give it.

    Parameters
    ----------
    text
        `azimuth/elevation/zoom`, of which the last may be left out; a .toml file as
        `resample.cameras.tables.read_viewpoint` takes it; or `file` or `file:frame` as `read_shot`
        takes it.
    fov
        Degrees along the picture's shorter side, where no file says it; 0 is parallel projection,
        of angles only.
    up
        Axis that points upwards, of angles only.

    Raises
    ------
    ValueError, LookupError
        The text is none of these, or the file's content is no camera.
    OSError
        The file cannot be read.
    """
    if text.lower().endswith(".toml"):
        return read_viewpoint(Path(text))
    if text and Path(file_and_frame(text)[0]).exists():
        shot = read_shot(text)
        if shot.camera is None:
            return Spot.of(shot.pose, fov)
        return shot.camera if shot.shape is None else Calibrated(shot.camera, shot.shape)
    try:
        azimuth, elevation, *others = [float(part) for part in text.split("/")]
        (zoom,) = others or [Orbit.zoom]
    except ValueError:
        raise ValueError(
            f"camera {text!r}; give azimuth/elevation/zoom, such as 30/20/1.5, of which the zoom "
            "may be left out, or a file of cameras: .toml, or poses of NeRF, COLMAP, TUM, Open3D"
        ) from None
    return Orbit(azimuth, elevation, zoom, fov, up)


def _recognised(path: Path) -> str:
    """Kind of a file, by its name or else by how many numbers its lines have."""
    if path.is_dir() or path.name.lower() == "images.txt":
        return "colmap"
    known = SUFFIXES.get(path.suffix.lower())
    if known is not None:
        return known
    counts = [len(line.words) for line in lines_of(path)]
    if counts and (counts == [4] * 3 or (set(counts) == {4} and len(counts) % 4 == 0)):
        return "matrix"
    if counts and counts == [3, 4, 4, 4, 4] * (len(counts) // 5):
        return "log"
    of_all = {8: "tum", 7: "icl"}.get(counts[0]) if len(set(counts)) == 1 else None
    if of_all is None:
        raise ValueError(
            f"{path} is not recognised as a file of poses; say which it is: {', '.join(KINDS)}"
        )
    return of_all


def _index(path: str, shots: list[Shot], frame: str) -> int:
    """Which pose a number or a name means."""
    if frame.isdecimal() and str(int(frame)) == frame:
        if int(frame) < len(shots):
            return int(frame)
        raise LookupError(f"{path} has no frame {frame}; it has the frames 0 to {len(shots) - 1}")
    for shorten in (str, lambda name: Path(name).name, lambda name: Path(name).stem):
        found = [n for n, shot in enumerate(shots) if shot.name and shorten(shot.name) == frame]
        if len(found) == 1:
            return found[0]
        if found:
            names = ", ".join(shots[n].name for n in found[:4])
            raise LookupError(f"{path} has several frames {frame!r}: {names}; give the full name")
    raise LookupError(f"{path} has no frame {frame!r}; pick one as {path}:{_choice(shots)}")


def _choice(shots: list[Shot]) -> str:
    """Words about what picks a frame."""
    numbers = f"N, N from 0 to {len(shots) - 1}"
    return f"{numbers}, or by name, such as {shots[0].name}" if shots[0].name else numbers
