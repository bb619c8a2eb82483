"""Poses by file and frame, and a check that they lead where the depth says."""

import math
from pathlib import Path

import numpy as np

from resample.types import Doubles
from resample_warp3d.cameras.files import Shot, read_shots
from resample_warp3d.cameras.models import Camera, camera_to_world, distorted_places
from resample_warp3d.depth.equation import between, places, warp_places
from resample_warp3d.types import DepthImage, Equation

COMPARED = 20_000  # points, about
NOTICED = 2e-3  # relative error of nearness below which poses are as good as depth is
OVERLAP = 0.05  # share of the points that must meet depth for their agreement to count
CLOSE = 0.05  # relative error of nearness up to which another pose is believed
BETTER = 0.5  # times the error of the given pose that another's must stay below
ADVICE = {
    "inverted": "if they are camera-to-world, invert them",
    "exchanged": "if each belongs to the other picture, exchange them",
}


def read_poses(path: str | Path, kind: str | None = None) -> list[Doubles]:
    """Poses (4, 4) of a file, world to camera; as `pose_files.read_shots` takes and refuses it."""
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
        As `pose_files.read_shots` takes it.

    Raises
    ------
    OSError, ValueError
        The file is none that can be read.
    LookupError
        It has no such frame, or several.
    """
    path, frame = (text, "") if Path(text).exists() else text.rpartition(":")[::2]
    if not path or not Path(path).exists():
        path, frame = text, ""
    shots = read_shots(path, kind)
    if frame:
        return shots[_index(path, shots, frame)]
    if len(shots) > 1:
        raise LookupError(f"{path} holds {len(shots)} poses; pick one as {path}:{_choice(shots)}")
    return shots[0]


def looks_inverted(
    first: DepthImage, second: DepthImage, first_camera: Camera, second_camera: Camera
) -> str | None:
    """Sentence that says so if other poses fit two depth images clearly better.

    The points of the first are warped into the second with the poses as they are, inverted, and
    exchanged; that pose fits whose points meet the second's depth.

    Returns
    -------
    None if nothing speaks against the poses, or the two pictures have too little in common.
    """
    poses = first_camera.world_to_camera, second_camera.world_to_camera
    turned = [camera_to_world(pose) for pose in poses]
    others = {
        "inverted": between(first_camera.moved(turned[0]), second_camera.moved(turned[1])),
        "exchanged": between(first_camera.moved(poses[1]), second_camera.moved(poses[0])),
    }
    given = _error(first, second, between(first_camera, second_camera), second_camera)
    errors = {
        name: _error(first, second, equation, second_camera) for name, equation in others.items()
    }
    # With one pose at the identity both are the same but for rounding.
    best = "exchanged" if errors["exchanged"] < 0.9 * errors["inverted"] else "inverted"
    if given <= NOTICED or errors[best] > CLOSE or errors[best] >= BETTER * given:
        return None
    found = f"are off by {given:.1%}" if math.isfinite(given) else "never meet"
    return (
        f"the poses look {best}: depths {found} as given but agree within {errors[best]:.1%}; "
        f"{ADVICE[best]}"
    )


def _error(first: DepthImage, second: DepthImage, equation: Equation, camera: Camera) -> float:
    """Median relative error of nearness where points of the first meet the second's depth.

    Infinite where too few meet it. `camera` is the second's, whose lens bends the points' places.
    """
    sparse = max(1, math.isqrt(first.nearness.size // COMPARED))
    chosen = slice(sparse // 2, None, sparse)
    nearness = first.nearness[chosen, chosen].astype(np.float64)
    is_known = np.isfinite(nearness) & (nearness > 0)
    start = places(first)[chosen, chosen][is_known]
    place, expected = warp_places(equation, start, nearness[is_known])
    place = distorted_places(camera, place)
    height, width = second.nearness.shape
    is_inside = ((place >= 0) & (place < (width, height))).all(axis=1)
    column, row = place[is_inside].astype(np.intp).T
    seen, expected = second.nearness[row, column].astype(np.float64), expected[is_inside]
    meets = np.isfinite(seen) & (seen > 0)
    if meets.sum() <= OVERLAP * is_known.sum():
        return math.inf
    error = np.abs(seen[meets] - expected[meets]) / np.maximum(seen[meets], expected[meets])
    return float(np.median(error))


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
