"""Rendering of point clouds: points where they shrink, splats where they grow.

cloud = prepare_cloud(read_cloud("scan.ply"))
frame = render_cloud(cloud, framed(cloud, size=(480, 640), azimuth=30), size=(480, 640))
"""

from dataclasses import dataclass
from enum import StrEnum
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from resample.cameras.models import Camera
from resample.cameras.poses import orbit
from resample.resampler import LARGEST_PICTURE
from resample.scene import dealt_to_tiles
from resample.types import Doubles, Frame, Screen, Statistics
from resample_warp3d.clouds.files import Cloud
from resample_warp3d.clouds.spacing import Surfels, prepare_cloud

if TYPE_CHECKING:
    from resample_warp3d.clouds.kernels.discs import Eye

TILE = 16  # px
MOST_SUBPIXELS = 16
TOLERANCE = 1.5  # radii; discs that differ by more in depth are of two surfaces
FIELD = 40.0  # degrees that `framed` sees along the frame's shorter side
GRAY = 0.8  # albedo of clouds without colors


class Light(StrEnum):
    """What shades a cloud."""

    NONE = "none"  # nothing: colors are shown as they were scanned
    HEADLIGHT = "headlight"  # a lamp at the eye, by the angle that the surface is seen under


@dataclass(frozen=True)
class CloudStyle:
    """How a cloud is drawn.

    Parameters
    ----------
    point_size
        Factor of all discs' radii.
    light
        Left out, a headlight for clouds without colors and none for others.
    cull
        Leave out what is seen from behind. Needs normals that are known to point outward.
    subpixels
        Per side of a pixel; their squares are the levels of coverage at edges.
    near
        Scene units along the view axis; what is nearer is left out.

    Raises
    ------
    ValueError
        A number is out of range.
    """

    point_size: float = 1.0
    light: Light | None = None
    cull: bool = False
    subpixels: int = 4
    near: float = 0.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.point_size) and self.point_size > 0):
            raise ValueError(f"a point size of {self.point_size}; give a factor above 0")
        if not 1 <= self.subpixels <= MOST_SUBPIXELS:
            raise ValueError(f"{self.subpixels} sub-pixels; give 1 to {MOST_SUBPIXELS}")
        if not (np.isfinite(self.near) and self.near >= 0):
            raise ValueError(f"the near plane at {self.near} must not lie behind the eye")


def render_cloud(
    cloud: Cloud | Surfels,
    camera: Camera,
    *,
    size: tuple[int, int],
    style: CloudStyle | None = None,
) -> Frame:
    """Render a point cloud.

    Parameters
    ----------
    cloud
        Points, or what `prepare_cloud` made of them, which saves time from the second picture on.
    camera
        Without distortion.
    size
        (height, width) px.
    style
        How it is drawn.

    Returns
    -------
    The picture, the same bits for any number of threads and any order of the points. Points are
    discs that were smaller than a sub-pixel along both axes; splats are all others.

    Raises
    ------
    ValueError
        The size is none, the camera has distortion, or backs are to be left out though normals do
        not tell them.
    """
    from resample_warp3d.clouds.kernels.discs import SURFEL, see
    from resample_warp3d.clouds.kernels.painting import Picture, paint

    chosen = CloudStyle() if style is None else style
    _check_size(*size)
    if camera.distortion is not None:
        raise ValueError("clouds are seen without distortion; give a camera that has none")
    times = [perf_counter()]
    surfels = cloud if isinstance(cloud, Surfels) else prepare_cloud(cloud)
    if chosen.cull and len(surfels.position) and not surfels.is_oriented:
        raise ValueError("backs cannot be left out: the cloud's file gives no normals")
    times.append(perf_counter())
    color = surfels.color if len(surfels.color) else np.full_like(surfels.position, GRAY)
    records = np.zeros(len(surfels.position), SURFEL)
    see(surfels.position, surfels.axes, color, eye_of(surfels, camera, size, chosen), records)
    times.append(perf_counter())
    screen = Screen(size[1], size[0], 0.0, np.zeros((4, 4)))
    tiles = dealt_to_tiles(records, screen, TILE)
    times.append(perf_counter())
    picture = Picture(
        np.zeros((*size, 4), np.float32),
        np.full(size, np.inf, np.float32),
        np.full(size, np.inf, np.float32),
        np.zeros(len(records), np.uint8),
    )
    paint(records, tiles, chosen.subpixels, picture)
    times.append(perf_counter())
    drawn = records["left"] <= records["right"]
    is_point = drawn & (records["weight"] < 1)
    seconds = dict(
        zip(("prepare", "project", "sort", "paint"), np.diff(times).tolist(), strict=True)
    )
    statistics = Statistics(
        len(records),
        int(is_point.sum()),
        int((drawn & ~is_point).sum()),
        int((drawn & (picture.shows == 0)).sum()),
        chosen.subpixels,
        seconds,
    )
    coverage = picture.rgba[..., 3].copy()
    return Frame(picture.rgba, picture.depth, picture.first_depth, coverage, statistics)


def eye_of(surfels: Surfels, camera: Camera, size: tuple[int, int], style: CloudStyle) -> "Eye":
    """Camera as the kernels see it, in the discs' own coordinates."""
    from resample_warp3d.clouds.kernels.discs import Eye

    pose = np.asarray(camera.world_to_camera, np.float64)
    matrix = np.asarray(camera.matrix, np.float64)
    shift = pose[:3, :3] @ surfels.origin + pose[:3, 3]
    light = style.light
    if light is None:
        light = Light.NONE if len(surfels.color) else Light.HEADLIGHT
    return Eye(
        np.ascontiguousarray(matrix @ np.column_stack([pose[:3, :3], shift])),
        -pose[:3, :3].T @ shift,
        *size,
        float(np.sqrt(abs(matrix[0, 0] * matrix[1, 1]))),
        float(style.near),
        style.subpixels,
        float(style.point_size),
        light is Light.HEADLIGHT,
        style.cull,
        TOLERANCE,
    )


def framed(
    cloud: Cloud | Surfels,
    *,
    size: tuple[int, int],
    azimuth: float = 0.0,
    elevation: float = 0.0,
    distance: float | None = None,
    up: str = "z",
) -> Camera:
    """Camera that looks at the middle of a cloud.

    Parameters
    ----------
    cloud
        What is looked at.
    size
        (height, width) px.
    azimuth, elevation, up
        Where the camera stands, degrees, and which axis points upward, as
        `resample.cameras.poses.orbit` takes them.
    distance
        From the middle, scene units. Left out, all of the cloud is within the frame.

    Raises
    ------
    ValueError
        The cloud has no points, or a number is none.
    """
    low, high = _box(cloud)
    radius = max(0.5 * float(np.linalg.norm(high - low)), 1e-12)
    height, width = size
    fov = np.radians(FIELD)
    away = radius / np.sin(0.5 * fov) if distance is None else distance
    if not (np.isfinite(away) and away > 0):
        raise ValueError(f"a distance of {distance}; give a length above 0")
    focal = min(height, width) / (2.0 * np.tan(0.5 * fov))
    matrix = np.array([[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]])
    return Camera(matrix, orbit(0.5 * (low + high), away, azimuth, elevation, up))


def _box(cloud: Cloud | Surfels) -> tuple[Doubles, Doubles]:
    """Least and greatest coordinates of all points."""
    position = cloud.position[np.isfinite(cloud.position).all(axis=1)]
    if not len(position):
        raise ValueError("a cloud without points cannot be looked at")
    origin = cloud.origin if isinstance(cloud, Surfels) else np.zeros(3)
    low, high = position.min(axis=0).astype(np.float64), position.max(axis=0).astype(np.float64)
    return low + origin, high + origin


def _check_size(height: int, width: int) -> None:
    if height < 1 or width < 1 or height * width > LARGEST_PICTURE:
        raise ValueError(
            f"a picture of {width} x {height} pixels; both sides must be at least 1 and there can "
            f"be at most {LARGEST_PICTURE} pixels"
        )
