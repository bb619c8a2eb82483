"""Bend the discs of a cloud so that a pinhole sees them as another camera does.

A place p that a camera shows at a pixel and a depth is moved to where a pinhole shows it at that
pixel and depth. Discs stay flat: their half axes are moved by differences over the disc.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from resample.cameras.models import Camera, Orthographic
from resample.cameras.pixels import (
    Equirectangular,
    check_panorama,
    directions,
    distorted_places,
    places_of,
    rays_at,
    undistorted_places,
)
from resample.cameras.poses import rigid
from resample.registry import plugin_of
from resample.scene import lines_of
from resample.types import Doubles, Floats
from resample_points.data.parts import rows_of
from resample_points.geometry.spacing import Surfels

SMALL = 1e-3  # rad, from the direction ahead, to measure a projection's px per rad
UNEVEN = 3.0  # ratio of a disc's halves beyond which one of them crosses a seam
BESIDE = 1.5  # picture sizes from its middle within which discs are kept
SMOOTH = 0.8  # of half a turn to each side of a panorama's half, within which discs are kept
NEAREST, MIDDLE = 2.0, 3.0  # depths that a parallel view begins at and has in its middle, in radii

Bend = Callable[[Doubles], Doubles]  # camera coordinates (N, 3) to a pinhole's
Shape = tuple[int, int]  # height and width, px


@dataclass(frozen=True, eq=False)
class ProjectedCamera:
    """Camera with a projection of the group `resample.projections`.

    Parameters
    ----------
    projection
        By name, such as `fisheye:fov=220`, or as an object.
    world_to_camera
        (4, 4) or (3, 4) rigid pose.

    Raises
    ------
    LookupError, ValueError
        There is no such projection, or the pose is not rigid.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_points import Cloud, ProjectedCamera, render_cloud
    >>> place = np.random.default_rng(1).normal(size=(2000, 3))
    >>> place /= np.linalg.norm(place, axis=1)[:, None]  # of a ball around the camera
    >>> cloud = Cloud(place, np.empty((0, 3)), np.empty((0, 3)), np.empty(0))
    >>> camera = ProjectedCamera("fisheye:fov=200")
    >>> render_cloud(cloud, camera, size=(32, 32))
    Frame(32 × 32 px, 85.4 % covered, depth from 0.9862)
    """

    projection: Any
    world_to_camera: Doubles = field(default_factory=lambda: np.eye(4))

    def __post_init__(self) -> None:
        object.__setattr__(self, "projection", plugin_of("projections", self.projection))
        object.__setattr__(self, "world_to_camera", rigid(self.world_to_camera))

    def moved(self, world_to_camera: ArrayLike) -> "ProjectedCamera":
        """Camera with another pose."""
        return replace(self, world_to_camera=np.asarray(world_to_camera, np.float64))


CloudView = Camera | Orthographic | Equirectangular | ProjectedCamera


class PinholePart(NamedTuple):
    """Part of a picture that a pinhole shows of bent discs: some columns."""

    camera: Camera  # pinhole; with an identity pose where discs are bent
    left: int  # px
    width: int  # px
    bend: Bend | None = None  # None: discs stay as they are
    pose: Doubles = np.eye(4)  # of the camera that the discs are bent for
    shift: float = 0.0  # of the pinhole's depths beyond the camera's
    is_parallel: bool = False


def pinhole_parts(camera: CloudView, shape: Shape, surfels: Surfels) -> list[PinholePart]:
    """Return the pinholes for the parts of a picture (height, width), from left to right."""
    if isinstance(camera, Camera):
        return [_lens(camera, shape)]
    if isinstance(camera, Orthographic):
        return [_parallel(camera, shape, surfels)]
    if isinstance(camera, Equirectangular):
        return _halves(camera, shape)
    if isinstance(camera, ProjectedCamera):
        return _tiles(camera, shape)
    raise ValueError(
        f"clouds are rendered by Camera, Orthographic, Equirectangular or ProjectedCamera, not by "
        f"{type(camera).__name__}; give a camera"
    )


def bent(
    position: Floats, axes: Floats, origin: Doubles, part: PinholePart
) -> tuple[Floats, Floats, Floats]:
    """Return bent discs (N, 3) and (N, 2, 3), and how much they face the camera (N,), from −1 to 1.

    Places that the camera does not show are not numbers.
    """
    bend = part.bend
    if bend is None:
        raise ValueError("these discs stay as they are")
    rotation, step = part.pose[:3, :3], part.pose[:3, 3]
    place = position.astype(np.float64) @ rotation.T + (rotation @ origin + step)
    half = axes.astype(np.float64) @ rotation.T
    middle = bend(place)
    turned = np.empty_like(half)
    for k in range(2):
        ahead, behind = bend(place + half[:, k]) - middle, middle - bend(place - half[:, k])
        # Take the mean of both halves of an axis, or the shorter one at a seam.
        one, two = (np.linalg.norm(each, axis=1) for each in (ahead, behind))
        one, two = (np.where(np.isfinite(each), each, np.inf) for each in (one, two))
        mean = np.where((one > UNEVEN * two)[:, None], behind, 0.5 * (ahead + behind))
        turned[:, k] = np.where((two > UNEVEN * one)[:, None], ahead, mean)
    normal = np.cross(half[:, 0], half[:, 1])
    toward = np.array([[0.0, 0.0, -1.0]]) if part.is_parallel else -place
    size = np.linalg.norm(normal, axis=1) * np.linalg.norm(toward, axis=1)
    facing = (normal * toward).sum(axis=1) / np.maximum(size, 1e-300)
    return middle.astype(np.float32), turned.astype(np.float32), facing.astype(np.float32)


def _lens(camera: Camera, shape: Shape) -> PinholePart:
    """Return the pinhole of a camera, for discs bent by its lens if it has one."""
    if camera.distortion is None:
        return PinholePart(camera, 0, shape[1])
    pinhole = replace(camera, distortion=None, world_to_camera=np.eye(4))
    back = np.linalg.inv(camera.matrix)

    def bend(place: Doubles) -> Doubles:
        with np.errstate(divide="ignore", invalid="ignore"):
            flat = (place / place[:, 2:]) @ camera.matrix.T
            flat[~(place[:, 2] > 0)] = np.nan
        pixel = _near(distorted_places(camera, flat[:, :2]), shape)
        ray = np.column_stack([pixel, np.ones(len(pixel))]) @ back.T
        return np.asarray(ray * place[:, 2:], np.float64)

    return PinholePart(pinhole, 0, shape[1], bend, camera.world_to_camera)


def _parallel(camera: Orthographic, shape: Shape, surfels: Surfels) -> PinholePart:
    """Return a pinhole for discs bent as a parallel camera sees them."""
    farthest = 0.0
    for rows in rows_of(surfels.position):
        square = (surfels.position[rows].astype(np.float64) ** 2).sum(axis=1)
        farthest = max(farthest, float(square.max(initial=0.0)))
    radius = math.sqrt(farthest) or 1.0
    away = float(camera.world_to_camera[2, :3] @ surfels.origin + camera.world_to_camera[2, 3])
    shift, focal = MIDDLE * radius - away, camera.sx * MIDDLE * radius
    near = max(0.0, camera.near + shift)
    pinhole = Camera.from_intrinsics(focal, focal, camera.cx, camera.cy)
    pinhole = replace(pinhole, near=near)
    scale = np.array([camera.sx, camera.sy]) / focal

    def bend(place: Doubles) -> Doubles:
        depth = place[:, 2:] + shift
        return np.column_stack([place[:, :2] * scale * depth, depth])

    return PinholePart(pinhole, 0, shape[1], bend, camera.world_to_camera, shift, True)


def _halves(camera: Equirectangular, shape: Shape) -> list[PinholePart]:
    """Return pinholes for the left and the right half of a panorama, which have no seam."""
    check_panorama(shape)
    height, width = shape
    focal, half = width / (2 * math.pi), width // 2

    def bend_around(column: float) -> Bend:
        def bend(place: Doubles) -> Doubles:
            pixel = places_of(place, shape)
            beside = (pixel[:, 0] - column + half) % width - half
            beside[np.abs(beside) > SMOOTH * half] = np.nan
            return _spread(beside / focal, (pixel[:, 1] - height / 2) / focal, place)

        return bend

    pinhole = Camera.from_intrinsics(focal, focal, half / 2, height / 2)
    lefts = (0, half)
    return [
        PinholePart(pinhole, left, half, bend_around(left + half / 2), camera.world_to_camera)
        for left in lefts
    ]


def _tiles(camera: ProjectedCamera, shape: Shape) -> list[PinholePart]:
    """Return pinholes for the parts of a projection's picture."""
    projection = camera.projection
    projection.check(shape)
    tiles = projection.tiles(shape)
    if len(tiles) > 1:
        raise ValueError(
            f"clouds are rendered in projections of one part, not {type(projection).__name__}"
        )
    ahead = projection.places(np.array([[0.0, 0.0, 1.0], [SMALL, 0.0, 1.0]]), shape, 0)
    focal = float(ahead[1, 0] - ahead[0, 0]) / SMALL
    height, width = shape

    def bend(place: Doubles) -> Doubles:
        pixel = _near(projection.places(place, shape, 0), shape)
        return _spread((pixel[:, 0] - width / 2) / focal, (pixel[:, 1] - height / 2) / focal, place)

    pinhole = Camera.from_intrinsics(focal, focal, width / 2, height / 2)
    return [PinholePart(pinhole, 0, width, bend, camera.world_to_camera)]


def _near(pixel: Doubles, shape: Shape) -> Doubles:
    """Return places (N, 2) px without those far beside a picture, where discs are not flat."""
    size = np.array([shape[1], shape[0]], np.float64)
    with np.errstate(invalid="ignore"):
        is_near = (np.abs(pixel - size / 2) <= BESIDE * size).all(axis=1, keepdims=True)
    return np.where(is_near, pixel, np.nan)


def _spread(x: Doubles, y: Doubles, place: Doubles) -> Doubles:
    """Return the places (N, 3) that a pinhole shows at x and y, and at a place's distance."""
    away = np.sqrt((place * place).sum(axis=1))
    return np.column_stack([x * away, y * away, away])


def shrunken(camera: CloudView, per: int) -> CloudView:
    """Return the camera for a picture of `1 / per` the size."""
    if isinstance(camera, Camera):
        return replace(camera, matrix=np.diag([1 / per, 1 / per, 1.0]) @ camera.matrix)
    if isinstance(camera, Orthographic):
        numbers = {name: getattr(camera, name) / per for name in ("sx", "sy", "cx", "cy")}
        return replace(camera, **numbers)
    return camera


def places_at(camera: CloudView, shape: Shape, pixel: Doubles, depth: Doubles) -> Doubles:
    """Return the scene positions (N, 3) at depths (N,) behind places (N, 2) px."""
    pose = camera.world_to_camera
    if isinstance(camera, Orthographic):
        start, along = lines_of(camera.view(), pixel)
        return np.asarray(start + depth[:, None] * along, np.float64)
    if isinstance(camera, Equirectangular):
        ray = rays_at(pixel, shape)
    elif isinstance(camera, ProjectedCamera):
        ray = camera.projection.rays(pixel, shape, 0)
        ray = ray / np.linalg.norm(ray, axis=1, keepdims=True)
    else:
        flat = directions(camera, undistorted_places(camera, pixel))
        ray = np.column_stack([flat, np.ones(len(flat))])
    return np.asarray((depth[:, None] * ray - pose[:3, 3]) @ pose[:3, :3], np.float64)
