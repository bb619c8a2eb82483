"""McMillan's warping equation of two views, and warps of points by it."""

import numpy as np

from resample.cameras.models import Camera
from resample.cameras.pixels import pixel_centers, undistorted_places
from resample.types import Doubles
from resample_warp3d.types import DepthImage, Equation, Rendered, Source

STILL = 1e-9  # relative to the picture's size: smaller moves are ignored


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
    """Return the equation of a rectified pair whose disparity is `gain` (δ − `zero`) px.

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
