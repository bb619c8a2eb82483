"""Read poses and cameras from files of many programs.

The result follows one convention: poses map world to camera, with x to the right, y down and the
view along +z; pixel centers are at + 0.5.
"""

import errno
import re
from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from importlib import import_module
from pathlib import Path

from resample.cameras.poses import UpAxis
from resample.cameras.trajectories import (
    Entry,
    PosedPicture,
    Refused,
    facts_of,
    is_trained,
    lines_of,
    read_log,
    read_matrices,
    read_open3d,
    read_toml,
    read_trained,
    read_tum,
    read_viewpoint,
)
from resample.cameras.viewpoints import NAMED, Calibrated, Orbit, Spot, Viewpoint, orbit_of
from resample.types import Doubles

Read = Callable[[Path], list[Entry]]


def _from(module: str, name: str) -> Read:
    """Reader of a kind of file; its module is imported on first use."""

    def read(path: Path) -> list[Entry]:
        entries: list[Entry] = getattr(import_module(f"resample.cameras.{module}"), name)(path)
        return entries

    return read


KINDS: Mapping[str, Read] = {
    "matrix": read_matrices,
    "tum": read_tum,
    "icl": partial(read_tum, before=0),
    "log": read_log,
    "nerf": _from("reconstructions", "read_nerf"),
    "open3d": read_open3d,
    "trained": read_trained,
    "colmap": _from("reconstructions", "read_colmap"),
    "record3d": _from("record3d", "read_record3d"),
    "toml": read_toml,
}
SUFFIXES = {".npy": "matrix", ".json": "nerf", ".log": "log", ".r3d": "record3d", ".toml": "toml"}


def read_entries(path: str | Path) -> list[Entry]:
    """Read all pictures of a file, including those that are invalid."""
    file = Path(path)
    if not file.exists():
        raise FileNotFoundError(errno.ENOENT, "there is no such file", str(path))
    entries = KINDS[_recognised(file)](file)
    if not entries:
        raise ValueError(f"{path} holds no poses")
    return entries


def read_shots(path: str | Path) -> list[PosedPicture]:
    """Read the valid pictures of a file; `left_out` reports the others.

    Parameters and errors as in `read_entries`; a file with only invalid pictures
    is rejected with the error of the first.
    """
    entries = read_entries(path)
    shots = [entry for entry in entries if isinstance(entry, PosedPicture)]
    if not shots:
        raise ValueError(next(entry.complaint for entry in entries if isinstance(entry, Refused)))
    return shots


def read_poses(path: str | Path) -> list[Doubles]:
    """Read poses (4, 4), world to camera; like `read_shots`, but cameras may be unknown."""
    entries = read_entries(path)
    poses = [entry.pose for entry in entries if entry.pose is not None]
    if not poses:
        raise ValueError(next(entry.complaint for entry in entries if isinstance(entry, Refused)))
    return poses


def left_out(path: str | Path, *, poses: bool = False) -> str | None:
    """Message about invalid cameras or poses; None if all are valid."""
    entries = read_entries(path)
    refused = [entry for entry in entries if isinstance(entry, Refused)]
    if poses:
        refused = [entry for entry in refused if entry.pose is None]
    if not refused:
        return None
    count = f"{len(refused)} of {len(entries)} cameras are left out"
    return f"{count}: {refused[0].complaint}"


def read_pose(text: str) -> Doubles:
    """Read a pose (4, 4), world to camera, of `file` or `file:frame`; errors as in `read_shot`.

    Works for cameras of unknown models too.
    """
    entry = _read_entry(text)
    if entry.pose is None:
        raise ValueError(entry.complaint if isinstance(entry, Refused) else "")
    return entry.pose


def read_shot(text: str) -> PosedPicture:
    """Read one pose of a file.

    `text`: `file` if it holds one pose; `file:3` for the fourth; `file:name` for the picture or
    time of that name; folders and suffix are optional.
    """
    entry = _read_entry(text)
    if isinstance(entry, Refused):
        raise ValueError(entry.complaint)
    return entry


def _read_entry(text: str) -> Entry:
    path, frame = file_and_frame(text)
    entries = read_entries(path)
    if frame:
        return entries[_index(path, entries, frame)]
    if len(entries) > 1:
        raise LookupError(
            f"{path} holds {len(entries)} poses; pick one as {path}:{_choice(entries)}"
        )
    return entries[0]


def file_and_frame(text: str) -> tuple[str, str]:
    """Split `file:frame`; the frame is empty if not given."""
    path, frame = (text, "") if Path(text).exists() else text.rpartition(":")[::2]
    return (path, frame) if path and Path(path).exists() else (text, "")


def viewpoint(text: str, fov: float = Orbit.fov, up: UpAxis = Orbit.up) -> Viewpoint:
    """Parse a viewpoint of the command line; parameters as in `orbit_of`."""
    # Angles first, so that no file of such a name is opened.
    if (angles := orbit_of(text, fov, up)) is not None:
        return angles
    if text.lower().endswith(".toml"):
        return read_viewpoint(Path(text))
    file = Path(file_and_frame(text)[0] if text else "")
    named = Path(re.sub(r":\w+$", "", text))  # without a frame
    if named.suffix[1:].isalpha() and not file.exists():
        raise FileNotFoundError(f"{named}: there is no such file")
    if not text or not file.exists():
        raise ValueError(
            f"camera {text!r}; give azimuth,elevation,zoom, such as 30,20,1.5, of which the zoom "
            f"may be left out, or with ,right,up of a pan; one of {', '.join(NAMED)}; or a file of "
            "cameras: .toml, or poses of NeRF, COLMAP, TUM, Open3D"
        )
    shot = read_shot(text)
    if shot.camera is None:
        return Spot.of(shot.pose, fov)
    return shot.camera if shot.shape is None else Calibrated(shot.camera, shot.shape)


def _recognised(path: Path) -> str:
    """Kind of a file, from its name or else from the count of numbers per line."""
    if path.is_dir() or path.name.lower() in ("images.txt", "images.bin"):
        return "colmap"
    known = SUFFIXES.get(path.suffix.lower())
    if known == "nerf":
        facts = facts_of(path)
        is_open3d = isinstance(facts, dict) and {"parameters", "extrinsic"} & set(facts)
        return "trained" if is_trained(facts) else "open3d" if is_open3d else known
    if known is not None:
        return known
    counts = [len(words) for _, words in lines_of(path)]
    if counts and (counts == [4] * 3 or (set(counts) == {4} and len(counts) % 4 == 0)):
        return "matrix"
    if counts and counts == [3, 4, 4, 4, 4] * (len(counts) // 5):
        return "log"
    usual, lines = Counter(counts).most_common(1)[0] if counts else (0, 0)
    of_most = {8: "tum", 7: "icl"}.get(usual)
    if counts == [3, 3, 3]:
        raise ValueError(f"{path} has 3 x 3 numbers; a pose has 3 x 4 or 4 x 4, world to camera")
    if of_most is None or 2 * lines <= len(counts):
        raise ValueError(
            f"{path} is not recognised as a file of poses; say which it is: {', '.join(KINDS)}"
        )
    return of_most


def _index(path: str, entries: list[Entry], frame: str) -> int:
    """Index of the pose for a number or name."""
    if frame.isdecimal() and str(int(frame)) == frame:
        if int(frame) < len(entries):
            return int(frame)
        raise LookupError(f"{path} has no frame {frame}; it has the frames 0 to {len(entries) - 1}")
    for shorten in (str, lambda name: Path(name).name, lambda name: Path(name).stem):
        found = [
            n for n, entry in enumerate(entries) if entry.name and shorten(entry.name) == frame
        ]
        if len(found) == 1:
            return found[0]
        if found:
            names = ", ".join(entries[n].name for n in found[:4])
            raise LookupError(f"{path} has several frames {frame!r}: {names}; give the full name")
    raise LookupError(f"{path} has no frame {frame!r}; pick one as {path}:{_choice(entries)}")


def _choice(entries: list[Entry]) -> str:
    """Describe how to pick a frame."""
    numbers = f"N, N from 0 to {len(entries) - 1}"
    return f"{numbers}, or by name, such as {entries[0].name}" if entries[0].name else numbers
