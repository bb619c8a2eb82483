"""Render textured meshes by forward resampling.

The texture of every triangle is projected point by point, see `kernels.painting`; only the few
sub-pixels that no point reached look up their texel.
"""

import math
import time
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from resample.cameras.models import AnyCamera
from resample.cameras.viewpoints import Orbit, Sphere
from resample.engine.jit import threads
from resample.lazy import old_members
from resample.painting.scenes.plans import shape_of
from resample.painting.scenes.scene import dealt_to_tiles
from resample.profiles.filters import Box, PixelFilter
from resample.profiles.interpolation import (
    LARGEST_RADIUS,
    InterpolatingCatmullRom,
    Interpolation,
    prefilter,
)
from resample.types import Doubles, Frame, Screen, View
from resample_texture.mesh.files import load_mesh
from resample_texture.mesh.kernels.painting import MeshPicture, MeshScene, paint
from resample_texture.mesh.kernels.surfaces import (
    BOUNDS,
    Faces,
    ProjectedTriangles,
    VisibilityCamera,
    project_triangles,
)
from resample_texture.mesh.kernels.visibility import SubpixelGrid
from resample_texture.mesh.shapes import Mesh
from resample_texture.mesh.skin import skin

__all__ = [
    "Mesh",
    "MeshStatistics",
    "MeshStyle",
    "fitted_camera",
    "load_mesh",
    "render_mesh",
]

TILE = 128  # sub-pixels; a tile's data then fits into a core's cache
LARGEST = 1 << 15  # px, side of a picture
WIDEST = 16  # px, largest radius of a pixel filter


@dataclass(frozen=True)
class MeshStyle:
    """Options of drawing a mesh.

    Parameters
    ----------
    samples
        Sub-pixels per side of a pixel, 1 to 16: the resolution of outlines.
    quality
        Least number of texture points per sub-pixel along each axis, above 0 up to 8.
    interpolation
        Interpolation between texels. One that needs a prefilter (`Spline`,
        `InterpolatingGaussian`) filters the whole texture for every picture.
    pixel_filter
        Filter from sub-pixels to pixels; its radius is at most 16 px.
    cull
        Cull triangles that face away.
    shading
        Shade by a light at the camera (Lambert's law).

    Raises
    ------
    ValueError
        A number is out of range, or a filter is too wide, or too narrow to hit a sub-pixel.
    """

    samples: int = 4
    quality: float = 1.0
    interpolation: Interpolation = field(default_factory=InterpolatingCatmullRom)
    pixel_filter: PixelFilter = field(default_factory=Box)
    cull: bool = False
    shading: bool = False

    def __post_init__(self) -> None:
        if self.samples not in range(1, 17):
            raise ValueError(f"{self.samples} samples per side of a pixel; 1 to 16 are allowed")
        if not 0.0 < self.quality <= 8.0:
            raise ValueError(f"a quality of {self.quality}; above 0 to 8 is allowed")
        if not 0.0 < self.interpolation.radius <= LARGEST_RADIUS:
            radius = self.interpolation.radius
            raise ValueError(f"an interpolation over {radius} texels; 0 to {LARGEST_RADIUS} work")
        if not 0.0 < self.pixel_filter.radius <= WIDEST:
            radius = self.pixel_filter.radius
            raise ValueError(
                f"a pixel filter of radius {radius} px; above 0 to {WIDEST} is allowed"
            )
        prefilter(self.interpolation)  # refuses one that cannot interpolate texels
        pixel_profile(self.pixel_filter, self.samples)


@old_members(seen="visible", looked_up="sampled")
class MeshStatistics(NamedTuple):
    """Counts and time of a rendering."""

    triangles: int
    points: int  # of textures, projected
    visible: int  # points that reached a sub-pixel which shows their surface
    covered: int  # sub-pixels with a surface
    sampled: int  # covered sub-pixels that no point reached
    seconds: float


def fitted_camera(
    mesh: Mesh,
    azimuth: float = 30.0,
    elevation: float = 20.0,
    zoom: float = 1.0,
    fov: float = 30.0,
    up: str = "y",
    size: tuple[int, int] = (512, 512),
) -> AnyCamera:
    """Return a camera on a sphere around a mesh.

    `zoom`: at 1 the mesh's bounding sphere just fits the picture; at 2 the camera is at half the
    distance, and a parallel projection shows everything at twice the size. `fov`: degrees along the
    picture's shorter side; 0 is parallel projection. `size`: width and height of the picture, px.
    """
    shape = _shape_of(size)
    return Orbit(azimuth, elevation, zoom, fov, up).around(ball_around(mesh), *shape)


def ball_around(mesh: Mesh) -> Sphere:
    """Return a bounding sphere of a mesh's triangles."""
    used = mesh.position[np.unique(mesh.triangle)]
    center = (used.min(axis=0) + used.max(axis=0)) / 2
    radius = float(np.sqrt(((used - center) ** 2).sum(axis=1).max())) or 1.0
    return Sphere(center, radius)


def render_mesh(
    mesh: Mesh, camera: AnyCamera, *, size: tuple[int, int], style: MeshStyle | None = None
) -> Frame[MeshStatistics]:
    """Render a mesh.

    `mesh`: triangles with textures or vertex colors; both sides are visible. `camera`: any camera.
    `size`: width and height of the picture, px. `style`: options of drawing; None is `MeshStyle()`.
    Result: premultiplied linear RGBA with depth (mean over what the pixel's square shows) and
    coverage (share of the pixel filter's mass). A pixel is the weighted mean of its sub-pixels.
    Raises ValueError: the size is not allowed.
    """
    begin = time.perf_counter()
    height, width = _shape_of(size)
    look = style or MeshStyle()
    view = camera.view()
    point, depth = _projected(mesh.position, view)
    lens = _lens(view, depth, look)
    cover = skin(mesh, look.interpolation, view, shading=look.shading)
    triangles = _surfaces(len(mesh.triangle))
    profile = pixel_profile(look.pixel_filter, look.samples)
    grid = _grid(len(profile), look)
    screen = Screen(width, height, float(grid.margin), np.zeros((4, 4)))
    picture = _picture(height, width, profile)
    with threads(None):
        project_triangles(Faces(point, depth, mesh.triangle, cover.uv), lens, triangles)
        tiles = dealt_to_tiles(triangles.bounds, screen, max(1, TILE // look.samples))
        tally = np.zeros((len(tiles.spacing), 4), np.int64)
        paint(MeshScene(triangles, cover, lens, grid, tally), tiles, picture)
    points, seen, covered, sampled = tally.sum(axis=0).tolist()
    seconds = time.perf_counter() - begin
    statistics = MeshStatistics(len(mesh.triangle), points, seen, covered, sampled, seconds)
    coverage = picture.rgba[..., 3].copy()
    return Frame(picture.rgba, picture.depth, picture.first_depth, coverage, statistics)


def pixel_profile(pixel_filter: PixelFilter, samples: int) -> Doubles:
    """Return the weights, along a row, of all sub-pixels that a pixel's filter covers."""
    margin = max(0, math.ceil(pixel_filter.radius - 0.5))
    place = (np.arange((2 * margin + 1) * samples) + 0.5) / samples - (margin + 0.5)
    distance = np.minimum(np.abs(place), pixel_filter.radius)
    weight = np.where(np.abs(place) <= pixel_filter.radius, pixel_filter(distance), 0.0)
    total = float(weight.sum())
    if not total > 0.0:
        raise ValueError(
            f"{pixel_filter} meets none of the {samples} samples along a pixel; choose a wider one"
        )
    return weight / total


def _grid(taps: int, look: MeshStyle) -> SubpixelGrid:
    """Return the grid of sub-pixels for a filter of that many taps."""
    return SubpixelGrid(look.samples, (taps // look.samples - 1) // 2, look.quality)


def _shape_of(size: tuple[int, int]) -> tuple[int, int]:
    height, width = shape_of(size)
    if max(height, width) > LARGEST:
        raise ValueError(
            f"a picture of {width} x {height} pixels; 1 to {LARGEST} along a side are allowed"
        )
    return height, width


def _in_camera(vector: Doubles, view: View) -> tuple[Doubles, Doubles, Doubles]:
    """Return the components of vectors along the camera's axes.

    Written out, as a matrix product may round equal vertices differently and open a seam.
    """
    x, y, z = vector.T
    first, second, third = (row[0] * x + row[1] * y + row[2] * z for row in view.rotation)
    return first, second, third


def _projected(position: Doubles, view: View) -> tuple[Doubles, Doubles]:
    """Project vertices to (x w, y w, w) in px, (V, 3); also return their depths (V,)."""
    x, y, z = (
        component + shift
        for component, shift in zip(_in_camera(position, view), view.translation, strict=True)
    )
    w = z if view.perspective else np.ones_like(z)
    (fx, fy), (cx, cy) = view.focal, view.principal
    return np.stack([fx * x + cx * w, fy * y + cy * w, w], axis=1), z


def _lens(view: View, depth: Doubles, look: MeshStyle) -> VisibilityCamera:
    """Return the near plane, projection and depth tolerance for the visibility test."""
    near = max(view.near, 1e-6 * float(np.abs(depth).max())) if view.perspective else view.near
    tolerance = 1.0 / (float(min(view.focal)) * look.samples)
    return VisibilityCamera(float(near), bool(view.perspective), look.cull, tolerance)


def _surfaces(count: int) -> ProjectedTriangles:
    return ProjectedTriangles(
        np.zeros((count, 4, 2)),
        np.zeros(count, np.int64),
        np.zeros((count, 3, 3)),
        np.zeros((count, 3)),
        np.zeros((count, 2)),
        np.zeros((count, 3, 3)),
        np.zeros(count),
        np.zeros(count),
        np.zeros(count, BOUNDS),
    )


def _picture(height: int, width: int, profile: Doubles) -> MeshPicture:
    return MeshPicture(
        np.zeros((height, width, 4), np.float32),
        np.full((height, width), np.inf, np.float32),
        np.full((height, width), np.inf, np.float32),
        profile,
    )
