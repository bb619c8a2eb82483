"""Render point clouds: points where discs are small, splats where they are large.

cloud = prepare_cloud(read_cloud("scan.ply"))
frame = render_cloud(cloud, framed(cloud, size=(640, 480), azimuth=30), size=(640, 480))

Eye-dome lighting is after Boucheny, "Interactive scientific visualization of large datasets:
towards a perceptive-based approach" (2009). A pixel is compared with pairs of neighbours on
opposite sides, so that slopes stay as bright as they are.
"""

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from time import perf_counter
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import Orthographic
from resample.cameras.pixels import pixel_centers
from resample.memory.mapped import most_of
from resample.messages import check_kind, check_numbers, check_threads, shape_of
from resample.profiles.filters import PixelFilter
from resample.profiles.subpixels import Subpixels, subpixels_of
from resample.progress import told
from resample.registry import plugin_of
from resample.types import Floats, Frame, Records, Screen, Statistics
from resample_points.data.cloud import Cloud, check_cloud
from resample_points.data.parts import rows_of, zeros_beside
from resample_points.geometry.spacing import Surfels, prepare_cloud
from resample_points.painting.bending import CloudView, PinholePart, bent, pinhole_parts, places_at
from resample_points.painting.windows import (
    POINT,
    SHOWN,
    SPLAT,
    STAGES,
    VISIBILITY_KINDS,
    Visibility,
    WindowCanvas,
    kinds_of,
    paint_discs,
    paint_in_windows,
)

if TYPE_CHECKING:
    from resample_points.kernels.discs import CloudCamera

PAIRS = ((0, 1), (1, 1), (1, 0), (1, -1))  # rows and columns to one neighbour of each pair
SCALES = (1, 2)  # of the distance to neighbours
REACH = 1 / 500  # of the picture's height: distance to the nearest of them
GAIN = 300.0  # from the change of log₂ depth to the exponent of darkening


def eye_dome(depth: Floats, strength: float, *, extent: float | None = None) -> Floats:
    """Return the share of light (H, W) that stays at each pixel; a strength of 1 is usual.

    `depth`: (H, W) scene units; inf where nothing is. `extent`: height of a parallel camera's
    picture, scene units, to which differences of depth are compared; None: a perspective camera, of
    which ratios of depths count.
    """
    known = np.isfinite(depth)
    if not known.any():
        return np.ones_like(depth)
    # Linear on planes: minus the depth, or the nearness.
    if extent is not None:
        near = np.where(known, -depth / np.float32(extent), np.float32(np.nan))
    else:
        near = np.where(known, 1 / np.maximum(depth, np.float32(1e-30)), np.float32(np.nan))
    step, total = max(1, math.ceil(REACH * len(depth))), np.zeros_like(depth)
    for scale in SCALES:
        for row, column in PAIRS:
            shift = row * step * scale, column * step * scale
            pair = 0.5 * (_moved(near, shift) + _moved(near, (-shift[0], -shift[1])))
            with np.errstate(invalid="ignore", divide="ignore"):
                drop = pair - near if extent is not None else np.log2(pair / near)
            total += np.maximum(np.where(np.isfinite(drop), drop, np.float32(0)), np.float32(0))
    mean = total / (len(SCALES) * len(PAIRS))
    light: Floats = np.exp(-GAIN * strength * mean).astype(np.float32)
    return light


def _moved(near: Floats, shift: tuple[int, int]) -> Floats:
    """Return the picture moved by a shift; NaN beyond its edges."""
    height, width = near.shape
    row, column = shift
    moved = np.full_like(near, np.nan)
    to = [
        slice(max(0, -part), size - max(0, part)) for part, size in ((row, height), (column, width))
    ]
    of = [
        slice(max(0, part), size + min(0, part)) for part, size in ((row, height), (column, width))
    ]
    if all(part.start < part.stop for part in to):
        moved[to[0], to[1]] = near[of[0], of[1]]
    return moved


TILE = 16  # px
MOST_SUBPIXELS = 16
TOLERANCE = 1.5  # radii; discs that differ by more in depth belong to two surfaces
GRAY = 0.8  # albedo of clouds without colors


class Shading(StrEnum):
    """Light source that shades a cloud."""

    NONE = "none"  # no shading: colors as scanned
    HEADLIGHT = "headlight"  # a light at the camera, Lambert's law


@dataclass(frozen=True)
class CloudStyle:
    """Options of drawing a cloud.

    Parameters
    ----------
    point_size
        Scale of all discs' radii.
    light
        Default: a headlight for clouds without colors, else none.
    cull
        Cull discs that face away. Needs normals that point outward.
    subpixels
        Sub-pixels per side of a pixel; their square is the number of coverage levels.
    near
        Near plane, scene units along the view axis.
    edl
        Strength of eye-dome lighting, which darkens what lies behind edges; 0: none.

    Raises
    ------
    ValueError
        A number is out of range.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_points import Cloud, CloudStyle, framed, render_cloud
    >>> place = np.random.default_rng(1).normal(size=(500, 3))
    >>> cloud = Cloud(place, np.empty((0, 3)), np.empty((0, 3)), np.full(500, 0.1))
    >>> camera = framed(cloud, size=(32, 24))
    >>> for style in (CloudStyle(), CloudStyle(point_size=0.5)):
    ...     frame = render_cloud(cloud, camera, size=(32, 24), style=style)
    ...     print(round(float(frame.coverage.mean()), 2))
    0.1
    0.04
    """

    point_size: float = 1.0
    light: Shading | Literal["none", "headlight"] | None = None
    cull: bool = False
    subpixels: int = 4
    near: float = 0.0
    edl: float = 0.0

    def __post_init__(self) -> None:
        check_numbers(self, "point_size", "subpixels", "near", "edl")
        if not (np.isfinite(self.point_size) and self.point_size > 0):
            raise ValueError(f"a point size of {self.point_size}; give a factor above 0")
        if self.light is not None and self.light not in list(Shading):
            raise ValueError(f"light {self.light!r}; it can be {' or '.join(Shading)}")
        if not 1 <= self.subpixels <= MOST_SUBPIXELS:
            raise ValueError(f"{self.subpixels} sub-pixels; give 1 to {MOST_SUBPIXELS}")
        if not (np.isfinite(self.near) and self.near >= 0):
            raise ValueError(f"the near plane at {self.near} must not lie behind the eye")
        if not (np.isfinite(self.edl) and self.edl >= 0):
            raise ValueError(f"eye-dome lighting of strength {self.edl}; give 0 or more")


def render_cloud(
    cloud: Cloud | Surfels,
    camera: CloudView,
    *,
    size: tuple[int, int],
    style: CloudStyle | None = None,
    filter: str | PixelFilter | None = None,  # noqa: A002
    threads: int | None = None,
) -> Frame:
    """Render a point cloud.

    Parameters
    ----------
    cloud
        Points, or the result of `prepare_cloud`, which saves time for further pictures.
    camera
        Perspective camera, also with a lens, or `Orthographic`, `Equirectangular` or
        `ProjectedCamera`. Points before its near plane are clipped. Depth is along the axis, in
        the last two along the ray.
    size
        Width and height, px.
    style
        Options of drawing.
    filter
        Pixel filter: `area`, `gaussian:sigma=0.5`, `tent`, `mitchell`, `lanczos:a=3`... Default:
        the mean over a pixel's square.
    threads
        Most threads to use, also for the preparation.

    Returns
    -------
    The picture, bit-identical for any number of threads and any order of the points. Its statistics
    count as points the discs smaller than a sub-pixel along both axes, and as splats all others.

    Raises
    ------
    ValueError
        The size is invalid or not one of the camera's, or back faces shall be culled and the cloud
        has no normals.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_points import Camera, Cloud, render_cloud
    >>> x, y = np.meshgrid(np.linspace(-1, 1, 20), np.linspace(-1, 1, 20))
    >>> place = np.stack([x, y, np.full_like(x, 3)], axis=2).reshape(-1, 3)  # of a square
    >>> cloud = Cloud(place, np.empty((0, 3)), np.ones((400, 3)), np.empty(0))
    >>> frame = render_cloud(cloud, Camera.from_fov(60, 24, 32), size=(32, 24))
    >>> frame, frame.statistics.splats
    (Frame(32 × 24 px, 33.3 % covered, depth from 3), 400)
    """
    from resample.engine import jit

    check_cloud(cloud, Cloud | Surfels)
    chosen = CloudStyle() if style is None else style
    check_kind("style", chosen, CloudStyle, "a CloudStyle, such as CloudStyle(edl=1)")
    shape = shape_of(size)
    check_threads(threads)
    with jit.threads(jit.workers() if threads is None else threads):
        start = perf_counter()
        surfels = cloud if isinstance(cloud, Surfels) else prepare_cloud(cloud)
        if chosen.cull and len(surfels.position) and not surfels.is_oriented:
            raise ValueError("back faces cannot be culled: the cloud's file has no normals")
        prepared = perf_counter() - start
        painted = painted_cloud(surfels, camera, shape, chosen, filter)
    held = np.zeros(VISIBILITY_KINDS, np.int64)
    for rows in rows_of(painted.visible):
        held += np.bincount(painted.visible[rows], minlength=VISIBILITY_KINDS)
    statistics = Statistics(
        len(painted.visible),
        int(held[POINT] + held[POINT | SHOWN]),
        int(held[SPLAT] + held[SPLAT | SHOWN]),
        int(held[POINT] + held[SPLAT]),
        painted.subpixels,
        {"prepare": prepared, **painted.seconds},
    )
    coverage = painted.rgba[..., 3].copy()
    if chosen.edl > 0:
        extent = shape[0] / camera.sy if isinstance(camera, Orthographic) else None
        light = eye_dome(painted.depth, chosen.edl, extent=extent)
        painted.rgba[..., :3] *= light[..., None]
    return Frame(painted.rgba, painted.depth, painted.first_depth, coverage, statistics)


def painted_cloud(
    surfels: Surfels,
    camera: CloudView,
    shape: tuple[int, int],
    style: CloudStyle,
    filter: str | PixelFilter | None,  # noqa: A002
) -> "PaintedCloud":
    """Paint all parts of a picture, and join them."""
    parts = pinhole_parts(camera, shape, surfels)
    pixel_filter = None if filter is None else plugin_of("filters", filter)
    fine = None if pixel_filter is None else subpixels_of(pixel_filter)
    if pixel_filter is not None and fine is not None and fine.weight.size > 1:
        fine = subpixels_of(pixel_filter, max(style.subpixels, fine.count))
        made = [_filtered(surfels, each, (shape[0], each.width), style, fine) for each in parts]
    else:
        made = [_painted(surfels, each, (shape[0], each.width), style, TILE) for each in parts]
    if len(made) == 1:
        return made[0]
    seen = zeros_beside(surfels.position, (len(surfels.position),), np.uint8)
    for part in made:
        seen |= part.visible
    rgba, depth, first = (
        np.concatenate(parts, axis=1) for parts in zip(*(part[:3] for part in made), strict=True)
    )
    seconds = {stage: sum(part.seconds[stage] for part in made) for stage in STAGES}
    return PaintedCloud(rgba, depth, first, seen, made[0].subpixels, seconds)


class PaintedCloud(NamedTuple):
    """A painted cloud."""

    rgba: Floats  # (H, W, 4)
    depth: Floats  # (H, W)
    first_depth: Floats  # (H, W)
    visible: Visibility
    subpixels: int  # per side of a pixel
    seconds: dict[str, float]  # per stage


def _painted(
    surfels: Surfels, part: PinholePart, shape: tuple[int, int], style: CloudStyle, tile: int
) -> PaintedCloud:
    """Paint a part of a picture in tiles; each pixel is the mean of its sub-pixels."""
    from resample_points.kernels.discs import SURFEL, CloudPicture, project_discs

    picture = CloudPicture(
        np.zeros((*shape, 4), np.float32),
        np.full(shape, np.inf, np.float32),
        np.full(shape, np.inf, np.float32),
    )
    canvas = WindowCanvas(Screen(shape[1], shape[0]), tile, style.subpixels, picture)
    eye = eye_of(surfels, part, shape, style)

    def project_some(rows: slice, records: Records) -> None:
        position, axes = surfels.position[rows], surfels.axes[rows]
        color = surfels.color[rows] if len(surfels.color) else np.full_like(position, GRAY)
        if part.bend is not None:
            position, axes, facing = bent(position, axes, surfels.origin, part)
            if _is_lit(surfels, style):
                color = color * np.abs(facing)[:, None]
            if style.cull:
                position[facing <= 0] = np.nan
        project_discs(position, axes, color, eye, records)

    pages = most_of(surfels.position)
    if pages is not None:
        seen, seconds = paint_in_windows(surfels, project_some, canvas, pages)
    else:
        begin, seconds = perf_counter(), dict.fromkeys(STAGES, 0.0)
        records = np.zeros(len(surfels.position), SURFEL)
        with told(None):
            project_some(slice(0, len(records)), records)
        seconds["project"] = perf_counter() - begin
        is_shown, seen = paint_discs(records, canvas, seconds), kinds_of(records)
        seen |= np.where(is_shown & (seen > 0), np.uint8(SHOWN), np.uint8(0))
    if part.shift:
        for away in (picture.depth, picture.first_depth):
            away -= np.float32(part.shift)  # noqa: PLW2901 - in place
    return PaintedCloud(*picture, seen, style.subpixels, seconds)


def _filtered(
    surfels: Surfels, part: PinholePart, shape: tuple[int, int], style: CloudStyle, parts: Subpixels
) -> PaintedCloud:
    """Paint a cloud on sub-pixels, strip by strip, and filter them."""
    from resample.engine.surfaces import nearest_of_rows, resolve_rows

    n = parts.count
    light, away = (np.zeros((*shape, count), np.float32) for count in (4, 1))
    first = np.full(shape, np.inf, np.float32)
    seen: Visibility = zeros_beside(surfels.position, (len(surfels.position),), np.uint8)
    seconds = dict.fromkeys(STAGES, 0.0)
    for strip in parts.strips(shape):
        camera = replace(part.camera, matrix=strip.matrix @ part.camera.matrix)
        fine = _painted(
            surfels,
            part._replace(camera=camera),
            strip.shape,
            replace(style, subpixels=1),
            TILE * n,
        )
        seen |= fine.visible
        for stage, spent in fine.seconds.items():
            seconds[stage] += spent
        rows = slice(strip.first, strip.last)
        resolve_rows(fine.rgba.reshape(strip.shape[0], -1), parts.weight, n, light[rows])
        cover = fine.rgba[..., 3:]
        depth = cover * np.where(cover > 0, fine.depth[..., None], np.float32(0))
        resolve_rows(depth[..., 0], parts.weight, n, away[rows])
        nearest_of_rows(fine.first_depth, n, parts.margin, first[rows])
    covered = light[..., 3:] > 0
    rgba = np.where(covered, light, np.float32(0))
    rgba /= np.maximum(rgba[..., 3:], np.float32(1))  # keep light consistent with coverage
    depth = np.full(shape, np.inf, np.float32)
    np.divide(away[..., 0], light[..., 3], out=depth, where=covered[..., 0])
    return PaintedCloud(rgba, depth, first, seen, n, seconds)


def eye_of(
    surfels: Surfels, part: PinholePart, shape: tuple[int, int], style: CloudStyle
) -> "CloudCamera":
    """Return the camera for the kernels, in the discs' own coordinates."""
    from resample_points.kernels.discs import CloudCamera

    camera, is_bent = part.camera, part.bend is not None
    origin = np.zeros(3) if is_bent else surfels.origin
    pose = np.asarray(camera.world_to_camera, np.float64)
    matrix = np.asarray(camera.matrix, np.float64)
    shift = pose[:3, :3] @ origin + pose[:3, 3]
    return CloudCamera(
        np.ascontiguousarray(matrix @ np.column_stack([pose[:3, :3], shift])),
        -pose[:3, :3].T @ shift,
        *shape,
        float(np.sqrt(abs(matrix[0, 0] * matrix[1, 1]))),
        float(max(style.near, camera.near)),
        style.subpixels,
        float(style.point_size),
        _is_lit(surfels, style) and not is_bent,
        style.cull and not is_bent,
        TOLERANCE,
    )


def _is_lit(surfels: Surfels, style: CloudStyle) -> bool:
    """Whether discs are shaded by a headlight."""
    light = style.light
    if light is None:
        light = Shading.NONE if len(surfels.color) else Shading.HEADLIGHT
    return light == Shading.HEADLIGHT


NOTHING = -1  # index of pixels that show nothing
Numbers = NDArray[np.int64]


def index_cloud(
    cloud: Cloud | Surfels,
    camera: CloudView,
    *,
    size: tuple[int, int],
    style: CloudStyle | None = None,
    threads: int | None = None,
) -> Numbers:
    """Return the index of the point that each pixel shows.

    The point is visible, and its center is nearest to the nearest surface in the pixel.

    Parameters
    ----------
    cloud, camera, size, style, threads
        See `render_cloud`.

    Returns
    -------
    Rows (height, width) of the cloud that was rendered or prepared; -1 where nothing is seen.

    Raises
    ------
    ValueError
        As `render_cloud` does; or surfels do not say which points they are.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_points import Camera, Cloud, index_cloud
    >>> place, normal = np.array([[-1.0, 0, 4], [1.0, 0, 4]]), np.array([[0, 0, -1.0]] * 2)
    >>> cloud = Cloud(place, normal, np.empty((0, 3)), np.array([0.6, 0.6]))
    >>> print(index_cloud(cloud, Camera.from_fov(30, 3, 9), size=(9, 3)))
    [[-1 -1  0  0 -1  1  1 -1 -1]
     [-1 -1  0  0 -1  1  1 -1 -1]
     [-1 -1  0  0 -1  1  1 -1 -1]]
    """
    from scipy.spatial import KDTree

    from resample.engine import jit

    check_cloud(cloud, Cloud | Surfels)
    chosen, shape = CloudStyle() if style is None else style, shape_of(size)
    found = np.full(shape, NOTHING, np.int64)
    check_threads(threads)
    with jit.threads(jit.workers() if threads is None else threads):
        surfels = cloud if isinstance(cloud, Surfels) else prepare_cloud(cloud)
        if len(surfels.source) < len(surfels.position):
            raise ValueError("these surfels do not say which points they are; prepare the cloud")
        painted = painted_cloud(surfels, camera, shape, chosen, None)
    shown, visible = np.isfinite(painted.first_depth), painted.visible
    parts = [rows.start + np.flatnonzero(visible[rows] & SHOWN) for rows in rows_of(visible)]
    which = np.concatenate([*parts, np.zeros(0, np.int64)])
    if len(which) and shown.any():
        depth = painted.first_depth[shown].astype(np.float64)
        surface = places_at(camera, shape, pixel_centers(shape)[shown], depth)
        _, nearest = KDTree(surfels.position[which]).query(surface - surfels.origin)
        found[shown] = surfels.source[which[nearest]]
    return found
