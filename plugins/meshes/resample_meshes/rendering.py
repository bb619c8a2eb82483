"""Render textured meshes by forward resampling.

The texture of every triangle is projected point by point, see `kernels.painting`; only the few
sub-pixels that no point reached look up their texel.
"""

import math
import time
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import AnyCamera
from resample.cameras.viewpoints import Sphere
from resample.engine.jit import threads
from resample.messages import number, shape_of
from resample.painting.scenes import dealt_to_tiles
from resample.profiles.filters import Box, PixelFilter
from resample.profiles.interpolation import (
    LARGEST_RADIUS,
    InterpolatingCatmullRom,
    Interpolation,
    prefilter,
)
from resample.registry import ByName
from resample.types import Doubles, Floats, Frame, Screen, View
from resample_meshes.files import load_mesh
from resample_meshes.kernels.painting import MeshPicture, MeshScene, paint
from resample_meshes.kernels.sampling import BLEND, MASK, OPAQUE, Skin
from resample_meshes.kernels.surfaces import (
    BOUNDS,
    Faces,
    Ints,
    ProjectedTriangles,
    VisibilityCamera,
    project_triangles,
)
from resample_meshes.kernels.visibility import SubpixelGrid
from resample_meshes.shapes import AlphaMode, Cover, Mesh, Pyramid
from resample_texture.texels.forward import EDGES, filtered, tap_table
from resample_texture.types import Edge

MODES = {AlphaMode.OPAQUE: OPAQUE, AlphaMode.MASK: MASK, AlphaMode.BLEND: BLEND}
CREASE = 40.0  # degrees; beyond this angle, adjacent triangles are shaded flat
__all__ = [
    "Mesh",
    "MeshStatistics",
    "MeshStyle",
    "load_mesh",
    "render_mesh",
]

TILE = 128  # sub-pixels; a tile's data then fits into a core's cache
LARGEST = 1 << 15  # px, side of a picture
WIDEST = 16  # px, largest radius of a pixel filter


def skin(mesh: Mesh, interpolation: Interpolation, view: View, *, shading: bool) -> Skin:
    """Return the data of triangles' colors."""
    light = headlight(mesh, view) if shading else np.zeros((0, 3), np.float32)
    edges = [(cover.along_u, cover.along_v) for cover in mesh.covers]
    texel, level, levels = _packed(_ready(mesh.pyramids, edges, interpolation))
    alpha = _packed(_ready(mesh.alphas, edges, interpolation))[0]
    return Skin(
        corner_places(mesh),
        mesh.color[mesh.triangle],
        light,
        mesh.texture,
        texel,
        level,
        levels,
        tap_table(interpolation),
        np.array([[EDGES[edge] for edge in both] for both in edges], np.int64).reshape(-1, 2),
        np.array([_mode(*one) for one in zip(mesh.textures, mesh.covers, strict=True)], np.int64),
        np.array([cover.cutoff for cover in mesh.covers], np.float32),
        alpha,
        np.array([cover.is_encoded for cover in mesh.covers], np.int64),
    )


def corner_places(mesh: Mesh) -> Doubles:
    """Return texture coordinates (T, 3, 2) of all corners, v downward from the top edge."""
    uv = mesh.uv[mesh.triangle]
    uv[..., 1] = 1.0 - uv[..., 1]
    return uv


def _mode(texture: Floats, cover: Cover) -> int:
    return MODES[cover.alpha] if texture.shape[2] == 4 else OPAQUE


def _ready(
    pyramids: tuple[Pyramid, ...], edges: list[tuple[Edge, Edge]], interpolation: Interpolation
) -> list[Pyramid]:
    return [
        coefficients(*one, interpolation=interpolation)
        for one in zip(pyramids, edges[: len(pyramids)], strict=True)
    ]


def coefficients(
    pyramid: Pyramid, edges: tuple[Edge, Edge], interpolation: Interpolation
) -> Pyramid:
    """Prefilter a pyramid's levels for an interpolation; as given if none is needed."""
    weights, one = prefilter(interpolation), np.ones(1, np.float32)
    if weights.size == 1:
        return pyramid
    texel = np.empty_like(pyramid.texel)
    ends = [*pyramid.levels[1:, 0], texel.size]
    for (first, height, width), end in zip(pyramid.levels, ends, strict=True):
        level = pyramid.texel[first:end].reshape(height, width, -1)
        across = filtered(level, weights, one, edges[0])
        texel[first:end] = filtered(across, one, weights, edges[1]).ravel()
    return Pyramid(texel, pyramid.levels)


def _packed(pyramids: list[Pyramid]) -> tuple[Floats, Ints, Ints]:
    """Concatenate all levels of all textures; return texels, offsets and sizes, counts."""
    count = np.array([len(pyramid.levels) for pyramid in pyramids] or [0])
    level = np.zeros((len(count), int(count.max()), 3), np.int64)
    first = 0
    for n, (texel, levels) in enumerate(pyramids):
        level[n, : len(levels)] = levels
        level[n, : len(levels), 0] += first
        first += texel.size
    texels = [pyramid.texel for pyramid in pyramids] or [np.zeros(0, np.float32)]
    return texels[0] if len(texels) == 1 else np.concatenate(texels), level, count


def headlight(mesh: Mesh, view: View) -> Floats:
    """Return the cosine between normal and view direction at triangle corners, (T, 3)."""
    corner = mesh.position[mesh.triangle]
    face = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    _, same = np.unique(mesh.position, axis=0, return_inverse=True)
    place = same.reshape(-1)[mesh.triangle]
    smooth = np.stack(
        [np.bincount(place.ravel(), np.repeat(face[:, c], 3), place.max() + 1) for c in range(3)],
        axis=1,
    )
    normal, flat = _unit(smooth[place]), _unit(face)[:, None]
    is_crease = (normal * flat).sum(axis=2, keepdims=True) < np.cos(np.radians(CREASE))
    normal = np.where(is_crease, flat, normal)
    eye = -view.rotation.T @ view.translation
    toward = _unit(eye - corner) if view.perspective else view.rotation[2]
    cosine: Floats = np.abs((normal * toward).sum(axis=2)).astype(np.float32)
    return cosine


def _unit(vector: NDArray[Any]) -> Doubles:
    """Normalize vectors; zero stays zero."""
    length = np.linalg.norm(vector, axis=-1, keepdims=True)
    unit: Doubles = np.divide(vector, length, out=np.zeros(vector.shape), where=length > 0)
    return unit


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
        Interpolation between texels, by name or as an object. One that needs a prefilter (`Spline`,
        `InterpolatingGaussian`) filters the whole texture for every picture.
    pixel_filter
        Filter from sub-pixels to pixels, by name or as an object; its radius is at most 16 px.
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
    interpolation: ByName[Interpolation] = ByName("interpolations", InterpolatingCatmullRom())
    pixel_filter: ByName[PixelFilter] = ByName("filters", Box())
    cull: bool = False
    shading: bool = False

    def __post_init__(self) -> None:
        if self.samples not in range(1, 17):
            raise ValueError(f"{self.samples} samples per side of a pixel; 1 to 16 are allowed")
        if not 0.0 < number("quality", self.quality) <= 8.0:
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


class MeshStatistics(NamedTuple):
    """Counts and time of a rendering."""

    triangles: int
    points: int  # of textures, projected
    visible: int  # points that reached a sub-pixel which shows their surface
    covered: int  # sub-pixels with a surface
    sampled: int  # covered sub-pixels that no point reached
    seconds: float


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

    Parameters
    ----------
    mesh
        Triangles with textures or vertex colors; both sides are visible.
    camera
        Any camera.
    size
        Width and height of the picture, px.
    style
        Options of drawing; None is `MeshStyle()`.

    Returns
    -------
    Premultiplied linear RGBA with depth (mean over what the pixel's square shows) and coverage
    (share of the pixel filter's mass). A pixel is the weighted mean of its sub-pixels.

    Raises
    ------
    ValueError
        The size is not allowed.
    """
    begin = time.perf_counter()
    height, width = shape_of(size)
    if max(height, width) > LARGEST:
        raise ValueError(
            f"a picture of {width} x {height} pixels; 1 to {LARGEST} along a side are allowed"
        )
    look = style or MeshStyle()
    view = camera.view()
    point, depth = _projected(mesh.position, view)
    lens = _lens(view, depth, look)
    cover = skin(mesh, look.interpolation, view, shading=look.shading)
    triangles = _surfaces(len(mesh.triangle))
    profile = pixel_profile(look.pixel_filter, look.samples)
    grid = SubpixelGrid(look.samples, (len(profile) // look.samples - 1) // 2, look.quality)
    screen = Screen(width, height, float(grid.margin))
    picture = MeshPicture(
        np.zeros((height, width, 4), np.float32),
        np.full((height, width), np.inf, np.float32),
        np.full((height, width), np.inf, np.float32),
        profile,
    )
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
