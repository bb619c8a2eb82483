"""A generated scene with exact depth and several viewpoints; needs no file.

It replaces real depth images in comparisons of methods: the true picture of any view, and the
pixels of it that another view sees, are known.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from resample.cameras.models import Camera
from resample.colors import from_srgb
from resample.types import Doubles, Floats
from resample_warp3d.types import DepthImage

if TYPE_CHECKING:
    from resample_comparisons.warp3d.kernels.tracing import Objects, RayCamera

RAYS = 8  # per side of a pixel, for colors
VISIBILITY_RAYS = 4  # per side of a pixel, for visibility
FOV = 60.0  # degrees
SMALLEST, LARGEST = 8, 4096  # px per side
NEAR = 1e-4  # z: nearer points cannot be projected
Point = tuple[float, float, float]


class SceneViewpoint(NamedTuple):
    """Viewpoint of a camera; the source is at the origin and looks along z."""

    eye: Point
    yaw: float = 0.0  # rad, to the right
    pitch: float = 0.0  # rad, downward
    roll: float = 0.0  # rad, clockwise


VIEWPOINTS: Mapping[str, SceneViewpoint] = {
    "side": SceneViewpoint(
        (-0.34, -0.07, 0.09), -0.042, 0.012
    ),  # about 1 : 1, uncovers backgrounds
    "back4": SceneViewpoint((-0.3, -0.12, -12.5), -0.012),  # objects shrink to a quarter and less
    "in3": SceneViewpoint((0.06, 0.12, 2.95)),  # objects grow threefold and more
    "oblique": SceneViewpoint(
        (3.0, -0.3, 1.1), -0.6
    ),  # objects grow along one axis, shrink along the other
    "roll": SceneViewpoint((0.05, 0.02, 0.2), 0.02, -0.02, 0.45),  # turned about its axis
}


class SurfaceMaterial(NamedTuple):
    """Pattern and colors of a surface."""

    pattern: str
    scale: float  # cells per scene unit
    dark: str  # #rrggbb
    bright: str


class Ball(NamedTuple):
    """Sphere."""

    center: Point
    radius: float
    material: SurfaceMaterial


class Panel(NamedTuple):
    """Rectangle, visible from both sides."""

    corner: Point
    right: Point  # first side
    down: Point  # second side, perpendicular to the first
    material: SurfaceMaterial


@dataclass(frozen=True)
class ObjectScene:
    """Objects, and cameras that look at them."""

    objects: "Objects"
    source: Camera
    views: Mapping[str, Camera]
    shape: tuple[int, int]  # height and width of all frames, px

    def render(
        self, camera: Camera, shape: tuple[int, int], rays: int = RAYS
    ) -> tuple[Floats, Doubles]:
        """Render the picture of a camera with square pixels, and exact depth.

        `camera`: camera without distortion. `shape`: height and width, px. `rays`: rays per side of
        a pixel; their mean is the pixel's color. Result: color (H, W, 3) in linear light, and z (H,
        W) at the pixels' centers, inf where nothing is.
        """
        from resample_comparisons.warp3d.kernels.tracing import render_rows

        color, depth = np.empty((*shape, 3), np.float32), np.empty(shape)
        render_rows(self.objects, _eye(self.objects, camera, shape), rays, color, depth)
        return color, depth

    def visible(
        self,
        camera: Camera,
        shape: tuple[int, int],
        other: Camera,
        other_shape: tuple[int, int],
        rays: int = VISIBILITY_RAYS,
    ) -> tuple[Floats, Doubles, Doubles]:
        """Return the share of each pixel visible from another camera, and the pixel's depths.

        `camera`, `shape`: camera with the tested pixels, and its height and width, px. `other`,
        `other_shape`: the other camera, and its height and width, px. `rays`: rays per side of a
        pixel. Result: fraction (H, W) 0..1; nearest and farthest z (H, W), inf where a ray hits
        nothing.
        """
        from resample_comparisons.warp3d.kernels.tracing import VisibleShare, trace_visibility

        sight = VisibleShare(np.empty(shape, np.float32), np.empty(shape), np.empty(shape))
        eye, other_eye = (
            _eye(self.objects, each, its_shape)
            for each, its_shape in ((camera, shape), (other, other_shape))
        )
        trace_visibility(self.objects, eye, other_eye, rays, sight)
        return sight.fraction, sight.nearest, sight.farthest

    def depth_image(self, rays: int = RAYS) -> DepthImage:
        """Render the source's depth image; its nearness is 1 / z."""
        color, depth = self.render(self.source, self.shape, rays)
        return DepthImage(color, (1.0 / depth).astype(np.float32))


def generated(size: int = 512) -> ObjectScene:
    """Make a room with a photo-like wall, tiles, a page, balls, cards and thin bars.

    Parameters
    ----------
    size
        Height and width of the frames, px; all cameras see 60 degrees.

    Returns
    -------
    The scene with the views of `VIEWPOINTS`.
    """
    if not SMALLEST <= size <= LARGEST:
        raise ValueError(f"a generated scene has {SMALLEST} to {LARGEST} px a side, not {size}")
    source = Camera.from_fov(FOV, size, size)
    views = {name: source.moved(pose_of(stand)) for name, stand in VIEWPOINTS.items()}
    return ObjectScene(_objects(_things()), source, views, (size, size))


def pose_of(stand: SceneViewpoint) -> Doubles:
    """Return the world-to-camera pose (4, 4) of a viewpoint."""
    rotation = np.eye(3)
    for angle, first, second in ((stand.yaw, 0, 2), (stand.pitch, 1, 2), (stand.roll, 1, 0)):
        turn = np.eye(3)
        turn[first, first] = turn[second, second] = math.cos(angle)
        turn[first, second] = -math.sin(angle)
        turn[second, first] = math.sin(angle)
        rotation = turn @ rotation
    pose = np.eye(4)
    pose[:3, :3] = rotation
    pose[:3, 3] = -rotation @ np.array(stand.eye)
    return pose


def _things() -> list[Ball | Panel]:
    """Return all objects in the room, in meters."""
    leaves = SurfaceMaterial("photo", 2.6, "#182214", "#e6dfa8")
    sky = SurfaceMaterial("photo", 1.5, "#24395c", "#eef0e4")
    plaster = SurfaceMaterial("cloth", 2.2, "#6b4a3a", "#e0c8a6")
    tiles = SurfaceMaterial("checker", 2.2, "#2b2a33", "#cfc9b8")
    room: list[Ball | Panel] = [
        Panel((-13.0, -13.0, 8.6), (26.0, 0.0, 0.0), (0.0, 14.7, 0.0), leaves),
        Panel((-13.0, 1.7, 8.6), (26.0, 0.0, 0.0), (0.0, 0.0, -21.0), tiles),
        Panel((4.3, -8.0, 8.6), (1.9, 0.0, -17.9), (0.0, 9.7, 0.0), plaster),
        Ball((-1.9, 0.75, 5.6), 0.95, SurfaceMaterial("photo", 5.0, "#3a1410", "#f2b98c")),
        Ball((1.55, 0.95, 4.5), 0.75, SurfaceMaterial("stripes", 5.0, "#15324a", "#e8e2d0")),
        Ball((0.5, -1.25, 6.6), 0.85, SurfaceMaterial("cloth", 4.0, "#2a3d1c", "#d4e39a")),
        Ball((2.75, -0.2, 7.4), 0.6, SurfaceMaterial("checker", 6.0, "#40204a", "#e2c43c")),
        Panel(
            (-2.75, -1.5, 4.4),
            (1.25, 0.0, -0.35),
            (0.0, 1.6, 0.0),
            SurfaceMaterial("text", 11.0, "#1a1a22", "#efe9da"),
        ),
        Panel((0.9, -1.9, 3.9), (0.8, 0.0, 0.25), (0.0, 0.62, 0.0), sky),
    ]
    return [*room, *_cards(), *_railing()]


def _cards() -> list[Panel]:
    """Return cards behind one another, each a small step farther away."""
    colors = ("#c8502d", "#dba03a", "#4f8a5b", "#3a6ea5")
    cards = []
    for n, color in enumerate(colors):
        corner = (-0.75 - 0.22 * n, -0.62 - 0.16 * n, 4.9 * 1.06**n)
        look = SurfaceMaterial("photo", 6.0, "#1d1d1d", color)
        cards.append(Panel(corner, (0.5, 0.0, 0.0), (0.0, 0.5, 0.0), look))
    return cards


def _railing() -> list[Panel]:
    """Return posts of 1.5 cm to 5 cm, two handrails, and a slanted bar of 2 cm."""
    wood = SurfaceMaterial("stripes", 16.0, "#5a3216", "#d8a468")
    posts = [
        Panel((-0.62 + 0.27 * n, 0.0, 3.5), (0.015 + 0.007 * n, 0.0, 0.0), (0.0, 1.7, 0.0), wood)
        for n in range(6)
    ]
    rails = [
        Panel((-0.75, y, 3.49), (1.75, 0.0, 0.0), (0.0, height, 0.0), wood)
        for y, height in ((0.02, 0.05), (1.1, 0.025))
    ]
    slanted = Panel((-0.6, 1.05, 3.52), (1.3, -0.95, 0.0), (0.0118, 0.0161, 0.0), wood)
    return [*posts, *rails, slanted]


def _objects(things: Sequence[Ball | Panel]) -> "Objects":
    """Pack the objects into arrays for ray tracing."""
    from resample_comparisons.warp3d.kernels import tracing

    is_sphere = [isinstance(thing, Ball) for thing in things]
    sides = [
        np.eye(3)[:2] if isinstance(thing, Ball) else np.array([thing.right, thing.down])
        for thing in things
    ]
    lengths = np.linalg.norm(sides, axis=2)
    units = np.array(sides) / lengths[..., None]
    extent = [
        (thing.radius, thing.radius) if isinstance(thing, Ball) else length
        for thing, length in zip(things, lengths, strict=True)
    ]
    looks = [thing.material for thing in things]
    return tracing.Objects(
        np.array(is_sphere),
        np.array([thing.center if isinstance(thing, Ball) else thing.corner for thing in things]),
        np.ascontiguousarray(units[:, 0]),
        np.ascontiguousarray(units[:, 1]),
        np.array(extent, np.float64),
        np.array([getattr(tracing, look.pattern.upper()) for look in looks], np.int64),
        np.array([look.scale for look in looks]),
        np.array([_light(look.dark) for look in looks]),
        np.array([_light(look.bright) for look in looks]),
    )


def _light(color: str) -> Doubles:
    """Return the linear light (3,) of #rrggbb."""
    levels = np.array([int(color[n : n + 2], 16) for n in (1, 3, 5)])
    return np.asarray(from_srgb(levels / 255.0), np.float64)


def _eye(objects: "Objects", camera: Camera, shape: tuple[int, int]) -> "RayCamera":
    """Return a camera's data for ray tracing."""
    from resample_comparisons.warp3d.kernels.tracing import RayCamera

    if camera.distortion is not None:
        raise ValueError("generated scenes need cameras without distortion")
    pose = camera.world_to_camera
    turn = np.ascontiguousarray(pose[:3, :3].T)
    matrix = np.ascontiguousarray(camera.matrix @ pose[:3])
    return RayCamera(
        np.ascontiguousarray(-turn @ pose[:3, 3]),
        np.ascontiguousarray(turn @ np.linalg.inv(camera.matrix)),
        matrix,
        _bounds(objects, matrix),
        np.array(shape, np.int64),
    )


def _bounds(objects: "Objects", matrix: Doubles) -> Doubles:
    """Return the bounding rectangles (N, 4), px, of objects in the frame."""
    bounds = np.empty((objects.pattern.size, 4))
    for n, is_sphere in enumerate(objects.is_sphere):
        corner = _box(objects, n) if is_sphere else _corners(objects, n)
        point = corner @ matrix[:, :3].T + matrix[:, 3]
        depth = point[:, 2]
        if is_sphere and depth.min() < NEAR:
            bounds[n] = -np.inf, -np.inf, np.inf, np.inf
            continue
        visible = _before_eye(point)
        if not visible.size:
            bounds[n] = np.inf, np.inf, -np.inf, -np.inf
            continue
        place = visible[:, :2] / visible[:, 2:]
        bounds[n] = *(place.min(axis=0) - 1.0), *(place.max(axis=0) + 1.0)
    return bounds


def _corners(objects: "Objects", n: int) -> Doubles:
    """Return the corners of a rectangle in order, (4, 3)."""
    right = objects.right[n] * objects.extent[n, 0]
    down = objects.down[n] * objects.extent[n, 1]
    return np.asarray(objects.place[n] + np.array([0 * right, right, right + down, down]))


def _box(objects: "Objects", n: int) -> Doubles:
    """Return the corners of a sphere's bounding box, (8, 3)."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return np.asarray(objects.place[n] + signs * objects.extent[n, 0])


def _before_eye(point: Doubles) -> Doubles:
    """Clip a polygon to the part in front of the camera; homogeneous px (N, 3)."""
    found = [corner for corner in point if corner[2] >= NEAR]
    for here, there in zip(point, np.roll(point, -1, axis=0), strict=True):
        if (here[2] < NEAR) != (there[2] < NEAR):
            share = (NEAR - here[2]) / (there[2] - here[2])
            found.append(here + share * (there - here))
    return np.array(found)
