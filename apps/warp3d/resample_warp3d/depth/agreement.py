"""Check whether the poses of two depth images fit their depths."""

import math

import numpy as np

from resample.cameras.models import Camera
from resample.cameras.pixels import distorted_places
from resample.cameras.poses import camera_to_world
from resample_warp3d.depth.equation import between, places, warp_places
from resample_warp3d.types import DepthImage, Equation

COMPARED = 20_000  # approximate number of points
NOTICED = 2e-3  # relative error of nearness below which poses are accepted
OVERLAP = 0.05  # share of the points that must meet depth for their agreement to count
CLOSE = 0.05  # relative error of nearness up to which another pose is suggested
BETTER = 0.5  # largest error of another pose, relative to the given one
ADVICE = {
    "inverted": "if they are camera-to-world, invert them",
    "exchanged": "if each belongs to the other picture, exchange them",
}


def pose_warning(
    first: DepthImage, second: DepthImage, first_camera: Camera, second_camera: Camera
) -> str | None:
    """Return a warning if other poses fit two depth images clearly better.

    The points of the first are warped into the second with the poses as given, inverted, and
    exchanged; the best pose is the one whose points meet the second's depth.

    Result: None if the poses seem right, or the two pictures share too little.
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
    # If one pose is the identity, both are equal up to rounding.
    best = "exchanged" if errors["exchanged"] < 0.9 * errors["inverted"] else "inverted"
    if given <= NOTICED or errors[best] > CLOSE or errors[best] >= BETTER * given:
        return None
    found = f"are off by {given:.1%}" if math.isfinite(given) else "never meet"
    return (
        f"the poses look {best}: depths {found} as given but agree within {errors[best]:.1%}; "
        f"{ADVICE[best]}"
    )


def _error(first: DepthImage, second: DepthImage, equation: Equation, camera: Camera) -> float:
    """Return the median relative error of nearness where points meet the second's depth.

    Infinite if too few do. `camera` is the second's, whose lens distorts the points' positions.
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
