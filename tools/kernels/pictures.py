"""Small pictures by every painter: the goldens, and what the library's kernels are compiled for."""

from collections.abc import Callable
from typing import Any

import numpy as np

from resample import registry
from resample.cameras.models import Camera
from resample.cameras.poses import look_at
from resample.painting.choices import Footprint, Opacity, Primitive, Projection
from resample.painting.splines import spline_of
from resample.profiles.filters import Gaussian
from resample.profiles.orders import EverySample, Rays
from resample.profiles.reconstruction import BSplineKernel
from resample.resampler import Resampler
from resample.types import Classifier, Lamp, LatticeField, Samples
from resample_comparisons.volume.painting import AxisSheets, ImageSheets

SIDE = 24  # px
LATTICE = 12  # samples per side
ALL = slice(None), slice(None)
FLOOR = np.array([[0.9, -0.6, 12.0], [0.0, 0.25, 6.0], [0.0, -0.012, 1.0]])
GROWN = np.array([[3.1, 0.7, -40.0], [-0.8, 2.9, -20.0], [0.0, 0.001, 1.0]])
SCENES: dict[str, Callable[[], Any]] = {}

VOLUMES: dict[str, dict[str, Any]] = {
    "default": {},
    "bspline": {"reconstruction": BSplineKernel()},
    "linear opacity": {"opacity": Opacity.LINEAR},
    "splat color": {"splat_color": (0.8, 0.02, 0.02)},
    "by distance": {"order": EverySample(key="distance")},
    "corrected": {"footprint": Footprint.CORRECTED},
    "projected": {"footprint": Footprint.PROJECTED},
    "affine": {"footprint": Footprint.AFFINE},
    "gaussian filter": {"pixel_filter": Gaussian(0.6)},
    "splats": {"primitive": Primitive.SPLATS},
    "points": {"primitive": Primitive.POINTS},
    "paper": {"primitive": Primitive.PAPER},
    "inflate": {"primitive": Primitive.INFLATE},
    "ewa": {"primitive": Primitive.EWA},
    "axis-sheets": {"order": AxisSheets()},
    "image-sheets": {"order": ImageSheets()},
}
FAR = ("default", "points", "paper", "ewa", "axis-sheets", "image-sheets")


def camera(away: float = 16.0) -> Camera:
    """Camera that sees the lattice, at 2 px per sample; farther away it shrinks."""
    pose = look_at((0.6 * away, -0.5 * away, 0.62 * away), (0, 0, 0))
    return Camera.from_fov(45.0, height=SIDE, width=SIDE, world_to_camera=pose)


def samples() -> Samples:
    """Colored samples of a lattice, of which some are opaque."""
    axis = np.arange(LATTICE) - (LATTICE - 1) / 2
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    position = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    ripple = np.sin(1.3 * position[:, 0]) * np.cos(0.9 * position[:, 1] + position[:, 2])
    color = 0.5 + 0.5 * np.cos(position + ripple[:, None])
    extinction = 0.6 * np.maximum(0.0, ripple) ** 2
    shown = extinction > 0
    return Samples(
        position[shown].astype(np.float32),
        color[shown].astype(np.float32),
        extinction[shown].astype(np.float32),
        np.eye(3),
    )


def particles() -> Samples:
    """Samples of a size each, from specks to spheres that reach over their neighbours."""
    rng = np.random.default_rng(11)
    scale = np.exp(rng.uniform(-4, 0.7, 300)).astype(np.float32)
    return Samples(
        rng.uniform(-6, 6, (300, 3)).astype(np.float32),
        rng.uniform(0, 1, (300, 3)).astype(np.float32),
        (rng.uniform(1, 20, 300) / scale).astype(np.float32),
        0.5 * np.eye(3),
        scale,
    )


def classifier() -> Classifier:
    """Colors for values."""
    table = np.random.default_rng(7).uniform(0, 1, (1, 8, 4)).astype(np.float32)
    lamp = Lamp(np.zeros(3), np.array([9.6, -8.0, 9.9, 1.0]), 0.2, 0.7, 0.3, 8.0, 0.1)
    return Classifier(table, -2.0, 2.0, 2.0, lamp, 0.0, 1.0, 0.0)


def values_of_lattice() -> Any:
    """A formula on all of a lattice."""
    axis = np.arange(LATTICE) - (LATTICE - 1) / 2
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    return (np.sin(x) + np.cos(y * z / 3)).astype(np.float32)


def lattice_field() -> LatticeField:
    """These values, as rays go through them."""
    spline, bounds = spline_of(values_of_lattice())
    none, first = np.zeros(0, np.uint8), -(LATTICE - 1) / 2
    return LatticeField(spline, bounds, none, np.eye(3), np.full(3, first), classifier())


def lattice_fields() -> list[LatticeField]:
    """Two such fields, half a sample apart."""
    one = lattice_field()
    return [one, one._replace(origin=one.origin + 0.5)]


def volume(source: Callable[[], Any], away: float, **choices: Any) -> Callable[[], Any]:
    """Picture of a volume by a `Resampler` of these choices."""

    def painted() -> Any:
        frame = Resampler(**choices)(source(), camera(away), height=SIDE, width=SIDE)
        return frame.rgba if frame.value is None else np.nan_to_num(frame.value)

    return painted


def _add_volumes() -> None:
    for name, choices in VOLUMES.items():
        SCENES[f"volume, {name}"] = volume(samples, 16.0, **choices)
        if name in FAR:
            SCENES[f"volume, {name}, far"] = volume(samples, 60.0, **choices)
    for projection in Projection:
        if projection is Projection.XRAY:
            continue  # the sums of additive
        iso = 0.5 if projection is Projection.FIRST_HIT else None
        choices = {"projection": projection, "iso": iso}
        SCENES[f"rays, {projection}"] = volume(lattice_field, 16.0, order=Rays(), **choices)
    SCENES["rays, several fields"] = volume(lattice_fields, 16.0, order=Rays())
    SCENES["volume, inside and cut"] = _inside
    SCENES["volume, default, few"] = _few()
    SCENES["volume, corrected, few"] = _few(footprint=Footprint.CORRECTED)
    SCENES["particles"] = volume(particles, 16.0)
    SCENES["particles, splats"] = volume(particles, 16.0, primitive=Primitive.SPLATS)


def _few(**choices: Any) -> Callable[[], Any]:
    """One slice, row and sample, of all sizes that scenes may have, and seen by one pixel."""

    def painted() -> Any:
        found = []
        for axes in ("z", "zy", "zyx"):
            whole = samples()
            is_kept = np.all([whole.position[:, "xyz".index(axis)] == 0.5 for axis in axes], axis=0)
            for power in (0, -36, 33):
                size = 2.0**power
                part = Samples(
                    (size * whole.position[is_kept]).astype(np.float32),
                    whole.color[is_kept],
                    (whole.extinction[is_kept] / size + 0.1 / size).astype(np.float32),
                    size * np.eye(3),
                )
                near = size * np.array([3.6, -3.0, 3.7])
                for side in (SIDE, 1):
                    pose = look_at(near, (0, 0, 0))
                    eye = Camera.from_fov(75.0, height=side, width=side, world_to_camera=pose)
                    frame = Resampler(**choices)(part, eye, height=side, width=side)
                    found.append(np.broadcast_to(frame.rgba, (side, side, 4)).reshape(-1, 4))
        return np.concatenate(found)

    return painted


def _inside() -> Any:
    pose = look_at((3, 2, 1), (0, 0, 0))
    eye = Camera.from_fov(70.0, height=SIDE, width=SIDE, world_to_camera=pose)
    clip = [(0.6, 0.0, 0.8, 3.0)]
    return Resampler()(samples(), eye, height=SIDE, width=SIDE, clip=clip).rgba


def photograph(side: int) -> Any:
    """Smooth waves with hard edges, (side, side, 3)."""
    y, x = np.mgrid[:side, :side] / side
    waves = np.stack([np.sin(40 * x * y), np.cos(25 * x), np.sin(31 * (x + y * y))], axis=-1)
    squares = ((16 * x).astype(int) + (16 * y).astype(int)) % 2
    return (0.5 + 0.3 * waves + 0.2 * (squares[..., None] - 0.5)).astype(np.float32)


def bent(x: Any, y: Any) -> tuple[Any, Any]:
    """Where places of the photograph go."""
    return 0.45 * x + 2 * np.sin(y / 9), 0.5 * y + np.cos(x / 7)


def back(x: Any, y: Any) -> tuple[Any, Any]:
    """Where places of a picture come from."""
    return 1.7 * x + np.sin(y / 5), 1.6 * y + np.sin(x / 4)


def _add_textures() -> None:
    from resample_gradients.adjoint import adjoint
    from resample_texture import BackwardMap, ForwardMap, Homography, warp
    from resample_texture.texels.forward import CellGrid
    from resample_texture.types import Edge

    y, x = np.mgrid[:64, :64] + 0.5
    row, column = np.mgrid[:SIDE, :SIDE] + 0.5
    geometries = {
        "plane": Homography(FLOOR),
        "grown": Homography(GROWN),
        "map": ForwardMap(*bent(x, y)),
        "backward map": BackwardMap(*back(column, row)),
    }
    size = (SIDE, SIDE)
    for method in ("hybrid", "points", "splats", "paper"):
        for name, geometry in geometries.items():
            if name == "backward map" and method in ("splats", "paper"):
                continue
            SCENES[f"texture, {method}, {name}"] = lambda geometry=geometry, method=method: (
                warp(photograph(64), geometry, size, method=method, fill="premultiplied").image
            )
    SCENES["texture, hybrid, plane, few"] = lambda: _few_texels(geometries["plane"])
    SCENES["texture, filtered"] = lambda: (
        warp(
            photograph(64),
            geometries["plane"],
            size,
            filter="gaussian",
            edge="mirror",
            fill="premultiplied",
        ).image
    )
    SCENES["texture, adjoint"] = lambda: adjoint(
        photograph(SIDE), geometries["plane"], (40, 40), Edge.TRANSPARENT, CellGrid()
    )
    SCENES["texture, mesh"] = _mesh


def _few_texels(plane: Any) -> Any:
    """One texel, row and column, and pictures of one pixel, row and column."""
    from resample_texture import warp

    found = []
    for source in (photograph(64)[:1, :1], photograph(64)[:1], photograph(64)[:, :1]):
        for shape in ((SIDE, SIDE), (1, 1), (1, SIDE), (SIDE, 1)):
            for edge in ("transparent", "clamp"):
                found.append(
                    warp(source, plane, shape, edge=edge, fill="premultiplied").image.reshape(-1, 3)
                )
    return np.concatenate(found)


def _mesh() -> Any:
    """A cube with one picture on its six squares."""
    from resample_meshes.rendering import Mesh, MeshStyle, render_mesh

    corner = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    face = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    halves = np.array([[0, 1, 2], [0, 2, 3]])
    triangle = (4 * np.arange(6)[:, None, None] + halves).reshape(-1, 3)
    uv = np.tile(np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float), (6, 1))
    cube = Mesh(corner[np.ravel(face)], triangle, uv=uv, textures=(photograph(64),))
    pose = look_at((2.1, 1.7, 2.6), (0.5, 0.5, 0.5))
    eye = Camera.from_fov(45, height=SIDE, width=SIDE, world_to_camera=pose)
    return render_mesh(cube, eye, size=(SIDE, SIDE), style=MeshStyle()).rgba


def _add_depth_images() -> None:
    for method in registry.names("warps"):
        SCENES[f"depth image, {method}"] = lambda method=method: _warped(method)
    SCENES["depth image, hybrid, few"] = _few_depths
    SCENES["cloud, few"] = lambda: np.concatenate([_cloud(40.0, n)[0] for n in (2, 3, 5)])
    SCENES["cloud"] = lambda: _cloud(40.0)
    SCENES["cloud, far"] = lambda: _cloud(12.0)


def _warped(method: str, part: tuple[slice, slice] = ALL, unit: float = 1.0) -> Any:
    from resample_comparisons.warp3d.scenes import generated
    from resample_warp3d import warp

    scene = generated(64)
    image = scene.depth_image(4)
    color, depth = image.color[part], unit / image.nearness[part]
    return warp(color, depth, scene.source, target_of(scene.source, unit), method).image


def target_of(source: Camera, unit: float = 1.0) -> Camera:
    """The camera a little beside and before one that looks along z."""
    pose = look_at((0.3 * unit, -0.1 * unit, 0.4 * unit), (0, 0, 4 * unit), (0, -1, 0))
    return source.moved(pose)


def _few_depths() -> Any:
    """One pixel, row and column of a depth image, near and far away."""
    found = [
        _warped("hybrid", (slice(8, 8 + rows), slice(8, 8 + columns)), unit).reshape(-1, 3)
        for rows, columns in ((1, 1), (1, 8), (8, 1), (2, 2))
        for unit in (1.0, 2.0**-36, 2.0**33)
    ]
    return np.concatenate(found)


def _cloud(scale: float, count: int = 600) -> Any:
    from resample_points.files.readers import Cloud
    from resample_points.painting.rendering import render_cloud

    n = np.arange(count) + 0.5
    z, angle = 1 - 2 * n / count, np.pi * (1 + np.sqrt(5)) * n
    around = np.sqrt(1 - z * z)
    ball = np.stack([around * np.cos(angle), around * np.sin(angle), z], axis=1)
    color = (0.5 + 0.5 * ball).astype(np.float32)
    nothing = np.zeros((0, 3), np.float32)
    return render_cloud(
        Cloud(ball, nothing, color, np.zeros(0, np.float32)),
        cloud_camera(scale),
        size=(SIDE, SIDE),
    ).rgba


def cloud_camera(scale: float) -> Camera:
    """Camera that sees the unit ball."""
    pose = look_at((0, 0, -4), (0, 0, 0), (0, -1, 0))
    return Camera(np.array([[scale, 0, SIDE / 2], [0, scale, SIDE / 2], [0, 0, 1.0]]), pose)


_add_volumes()
_add_textures()
_add_depth_images()
