"""McMillan's warping equation of two views, and warps of points by it."""

import math

import numpy as np

from resample.cameras.models import Camera
from resample.cameras.pixels import distorted_places, pixel_centers, undistorted_places
from resample.cameras.poses import camera_to_world
from resample.types import Doubles
from resample_warp3d.types import DepthImage, Equation, Rendered, Source

STILL = 1e-9  # relative to the picture's size: smaller moves are ignored
COMPARED = 20_000  # approximate number of points
NOTICED = 2e-3  # relative error of nearness below which poses are accepted
OVERLAP = 0.05  # share of the points that must meet depth for their agreement to count
CLOSE = 0.05  # relative error of nearness up to which another pose is suggested
BETTER = 0.5  # largest error of another pose, relative to the given one
ADVICE = {
    "inverted": "if they are camera-to-world, invert them",
    "exchanged": "if each belongs to the other picture, exchange them",
}


def between(source: Camera, target: Camera) -> Equation:
    """Return the equation of two cameras; δ is 1 / z in the source (McMillan 1997).

    Raises
    ------
    ValueError
        One is not a `Camera`; a parallel camera has no center of projection.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import Camera, between
    >>> camera = Camera.from_intrinsics(100, 100, 32, 24)
    >>> equation = between(camera, camera.moved(np.c_[np.eye(3), [-0.1, 0, 0]]))
    >>> (equation.matrix @ (40, 24, 1) + equation.epipole / 2.0).round(3).tolist()  # at z = 2
    [35.0, 24.0, 1.0]
    """
    for camera in (source, target):
        if not isinstance(camera, Camera):
            raise ValueError(f"the warping equation needs a Camera; got {type(camera).__name__}")
    relative = target.world_to_camera @ np.linalg.inv(source.world_to_camera)
    turned: Doubles = target.matrix @ relative[:3, :3] @ np.linalg.inv(source.matrix)
    shift = np.asarray(target.matrix @ relative[:3, 3], np.float64)
    return Equation(np.asarray(turned, np.float64), shift)


def of_rectified(fraction: float, gain: float = 1.0, zero: float = 0.0) -> Equation:
    """Return the equation of a rectified pair with the disparity `gain` (δ − `zero`) px.

    `fraction` 1 leads from the left view to the right one, where things are further left, −1 from
    the right view to the left one, 0.5 to the view between. Points with the nearness `zero` do not
    move.

    Examples
    --------
    >>> from resample_warp3d import of_rectified
    >>> half_way = of_rectified(0.5)
    >>> (half_way.matrix @ (40, 24, 1) + 8 * half_way.epipole).tolist()  # a disparity of 8 px
    [36.0, 24.0, 1.0]
    """
    matrix = np.eye(3)
    matrix[0, 2] = fraction * gain * zero
    return Equation(matrix, np.array([-fraction * gain, 0.0, 0.0]))


def inverse(equation: Equation) -> Equation:
    """Return the equation from the target, with its nearness, to the source."""
    back = np.linalg.inv(equation.matrix)
    return Equation(np.asarray(back, np.float64), -back @ equation.epipole)


def places(image: DepthImage) -> Doubles:
    """Return the undistorted position of each sample, (H, W, 2) px."""
    if image.place.size:
        return image.place
    height, width = image.nearness.shape
    return pixel_centers((height, width))


def lens_places(camera: Camera, shape: tuple[int, int]) -> Doubles:
    """Return undistorted positions of samples, (H, W, 2) px; (0, 0, 2) without a lens."""
    if camera.distortion is None:
        return np.empty((0, 0, 2))
    return undistorted_places(camera, pixel_centers(shape))


def warp_places(equation: Equation, place: Doubles, nearness: Doubles) -> tuple[Doubles, Doubles]:
    """Warp points; return positions, px (..., 2), and nearness; nan behind the camera.

    `place`: (..., 2) px of the source. `nearness`: (...) δ of the points; 0 means infinitely far.
    """
    seen = place @ equation.matrix[:, :2].T + equation.matrix[:, 2]
    seen = seen + np.asarray(nearness)[..., None] * equation.epipole
    scale = np.where(seen[..., 2] > 0.0, seen[..., 2], np.nan)
    return seen[..., :2] / scale[..., None], nearness / scale


def is_identity(source: Source, equation: Equation, shape: tuple[int, int]) -> bool:
    """Whether no sample moves: the target equals the source."""
    if equation.matrix[2, 2] == 0.0:
        return False
    matrix = equation.matrix / equation.matrix[2, 2]
    extent = np.array([source.nearness.shape[1], source.nearness.shape[0], 1.0])
    moved = np.abs(matrix - np.eye(3)) @ extent  # px, at most
    shift = np.abs(equation.epipole / equation.matrix[2, 2]).max() * source.nearness.max()
    return (
        source.place.size == 0
        and tuple(shape) == source.nearness.shape
        and float(max(moved.max(), shift)) < STILL * max(shape)
    )


def unmoved(source: Source) -> Rendered:
    """Return the source unchanged, bit by bit; samples without depth are empty."""
    known = source.nearness > 0
    coverage = known.astype(np.float32)
    image = np.where(known[..., None], source.color, np.float32(0))
    return Rendered(image, coverage, source.nearness.copy(), coverage.copy(), np.zeros_like(known))


def pose_warning(
    first: DepthImage, second: DepthImage, first_camera: Camera, second_camera: Camera
) -> str | None:
    """Return a warning if other poses fit two depth images clearly better.

    The points of the first are warped into the second with the poses as given, inverted, and
    exchanged; the best pose is the one with points that meet the second's depth.

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

    Infinite if too few do. `camera` is the second's; its lens distorts the points' positions.
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
