"""What the golden scenes show in truth: many rays per pixel, in float64, by the obvious loops.

`python -m tests.golden.truths NAME ...` computes these anew and stores them, which takes minutes:
to be done when a scene is changed or added. A truth is that of what a scene is asked to show, in
its order of compositing, and knows nothing of footprints, sub-pixels, tables and points.
"""

import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import map_coordinates

from resample.cameras.models import Camera
from resample.cameras.poses import look_at
from resample.profiles.filters import Gaussian
from resample.profiles.reconstruction import BSplineKernel, GaussianKernel
from tests import naive, ray_truth
from tests.filtered import plain_filtered, window
from tests.golden.scenes import packed, unpacked
from tools.kernels import pictures as scenes
from tools.kernels.pictures import SIDE, camera

STORED = Path(__file__).with_name("truths.npz")
FINE = 4  # rays per side of a pixel, through volumes
RAYS = 16  # likewise, of textures and outlines
STEP = 0.1  # voxels, along rays through fields
CLIP = np.array([(0.6, 0.0, 0.8, 3.0)])
SIZE = {"height": SIDE * FINE, "width": SIDE * FINE}

MANY_IN_ONE = "many small pictures in one, each of them compared with loops elsewhere"
SURFACE = "a surface is compared with formulas, in tests/core/test_projections.py"
NONE = {
    "volume, splat color": "colors that tell splats from points are in no scene",
    "volume, default, few": MANY_IN_ONE,
    "volume, corrected, few": MANY_IN_ONE,
    "texture, hybrid, plane, few": MANY_IN_ONE,
    "depth image, hybrid, few": MANY_IN_ONE,
    "cloud, few": MANY_IN_ONE,
    "rays, first-hit": SURFACE,
    "rays, attenuated": "values of a ball are compared with formulas, in tests/volume/test_rays.py",
    "texture, adjoint": "a derivative, whose products with any picture tests/texture knows",
}


def finer(eye: Any, margin: int = 0, count: int = FINE) -> Camera:
    """The camera with so many rays per side of a pixel, and some px around."""
    matrix = eye.matrix.copy()
    matrix[:2, 2] += margin
    return Camera(np.diag([count, count, 1.0]) @ matrix, eye.world_to_camera)


def mean(fine: Any, count: int = FINE) -> Any:
    """Means over pixels."""
    high, wide = (side // count for side in fine.shape[:2])
    return fine.reshape(high, count, wide, count, -1).mean(axis=(1, 3))


def one_by_one(
    given: Any,
    eye: Camera,
    kernel: Any = None,
    *,
    is_linear: bool = False,
    key: str = "depth",
    clip: Any = None,
    size: dict[str, int] = SIZE,
) -> Any:
    """Whole kernels composited in the order of their centers, of as many rays as the camera has."""
    center = naive.in_camera(eye, given.position)
    order = np.argsort(center[:, 2] if key == "depth" else np.linalg.norm(center, axis=1))
    between = None if clip is None else naive.kept_by(eye, clip, **size)
    scale = np.ones(len(center)) if given.scale is None else given.scale.astype(float)
    picture = np.zeros((size["height"], size["width"], 4))
    for n in order:
        integral = naive.line_integrals(
            eye, center[n], scale[n] * given.lattice, kernel or GaussianKernel(),
            between=between, **size,
        )  # fmt: skip
        alpha = 1 - np.exp(-float(given.extinction[n]) * integral)
        if is_linear:  # of a lattice of unit spacing
            alpha = np.minimum(1.0, (1 - np.exp(-float(given.extinction[n]))) * integral)
        picture += (1 - picture[..., 3:]) * alpha[..., None] * np.append(given.color[n], 1.0)
    return picture


def densities(given: Any, eye: Camera, what: Any) -> Any:
    """Densities, and sums of densities times `what` (N, K), in steps along rays (H, W, S, 1 + K).

    Beside them the depth of steps (S,) and their length (H, W).
    """
    kernel, reach = GaussianKernel(), naive.reach(eye, given.lattice, GaussianKernel())
    center = naive.in_camera(eye, given.position)
    depth = np.arange(center[:, 2].min() - reach, center[:, 2].max() + reach, STEP) + STEP / 2
    origin, way = naive.rays(eye, **SIZE)
    to_voxels = np.linalg.inv(eye.view().rotation @ given.lattice)
    sums = np.zeros((*way.shape[:2], len(depth), 1 + what.shape[1]), np.float32)
    mass = naive.kernel_mass(kernel)
    for place, of_it in zip(center, what, strict=True):
        near = np.flatnonzero(np.abs(depth - place[2]) < reach)
        at = np.linalg.norm(place - way * place[2], axis=-1) < 1.5 * reach
        rows, columns = np.nonzero(at)
        away = (origin[at][:, None] + depth[near][:, None] * way[at][:, None] - place) @ to_voxels.T
        density = kernel(np.linalg.norm(away, axis=-1)) / mass
        part = density[..., None] * np.append(1.0, of_it)
        sums[rows[:, None], columns[:, None], near] += part.astype(np.float32)
    return sums, depth, STEP * np.linalg.norm(way, axis=-1)


def light(color: Any, depth: Any) -> Any:
    """Light (H, W, 4) of straight colors and optical depths along rays (H, W, S)."""
    share = np.exp(-(np.cumsum(depth, axis=-1) - depth)) * -np.expm1(-depth)
    return np.concatenate(
        [(share[..., None] * color).sum(axis=2), share.sum(axis=2)[..., None]], axis=-1
    )


def along_the_ray(away: float) -> Any:
    """The field of all kernels together, from front to back."""
    given = scenes.samples()
    tinted = given.extinction[:, None] * np.column_stack([np.ones(len(given.color)), given.color])
    sums, _, length = densities(given, finer(camera(away)), tinted.astype(float))
    total = sums[..., 1]
    color = sums[..., 2:] / np.where(total > 0, total, 1)[..., None]
    return mean(light(color, total * length[..., None]))


@cache
def met_on_lattice() -> ray_truth.Along:
    """What rays meet of a field on a lattice, in short steps."""
    given, size = scenes.lattice_field(), (SIZE["height"], SIZE["width"])
    values, none = scenes.values_of_lattice(), np.zeros((0, 4))
    return ray_truth.along_rays(values, given, finer(camera()), size, none)


def of_lattices() -> Any:
    """Two such fields: short steps of both, in the order of their depths."""
    size, none = (SIZE["height"], SIZE["width"]), np.zeros((0, 4))
    values, fields = scenes.values_of_lattice(), scenes.lattice_fields()
    met = [ray_truth.along_rays(values, given, finer(camera()), size, none) for given in fields]
    return mean(ray_truth.composite_several(list(zip(met, fields, strict=True)), none))


def of_lattice(projection: str) -> Any:
    """A field on a lattice by SciPy's spline."""
    given, met, none = scenes.lattice_field(), met_on_lattice(), np.zeros((0, 4))
    if projection == "composite":
        return mean(ray_truth.composite(met, given, none))
    hit = met.inside.any(axis=2)
    inner = np.where(met.inside, met.value, 0.0).sum(axis=2)
    shown = {
        "maximum": lambda: np.where(met.inside, met.value, -np.inf).max(axis=2),
        "minimum": lambda: np.where(met.inside, met.value, np.inf).min(axis=2),
        "additive": lambda: inner * met.length,
        "average": lambda: inner / np.maximum(met.inside.sum(axis=2), 1),
    }[projection]()
    share = mean(hit[..., None].astype(float))
    sums = mean(np.where(hit, shown, 0.0)[..., None])
    if projection == "additive":
        return sums[..., 0]
    return (sums / np.where(share > 0, share, 1))[..., 0]  # of what a pixel shows of the field


def filtered(away: float) -> Any:
    """Whole kernels under a Gaussian pixel filter."""
    weight, margin = window(Gaussian(0.6), FINE)
    side = (SIDE + 2 * margin) * FINE
    fine = one_by_one(
        scenes.samples(), finer(camera(away), margin), size={"height": side, "width": side}
    )
    return plain_filtered(fine, weight, (SIDE, SIDE), FINE)


def inside() -> Any:
    """Whole kernels seen from among them, behind a cut."""
    pose = look_at((3, 2, 1), (0, 0, 0))
    eye = Camera.from_fov(70.0, height=SIDE, width=SIDE, world_to_camera=pose)
    return mean(one_by_one(scenes.samples(), finer(eye), clip=CLIP))


def texels(u: Any, v: Any, mode: str = "nearest") -> Any:
    """Photograph at places in texels, between texels by SciPy's cubic spline."""
    source = scenes.photograph(64).astype(float)
    at = np.stack([v - 0.5, u - 0.5])
    return np.stack(
        [map_coordinates(source[..., c], at, order=3, mode=mode) for c in range(3)], axis=-1
    )


def fine_centers(margin: int = 0) -> tuple[Any, Any]:
    """Places (x, y) of RAYS × RAYS rays per pixel, px."""
    axis = (np.arange((SIDE + 2 * margin) * RAYS) + 0.5) / RAYS - margin
    return np.meshgrid(axis, axis)


def on_plane(matrix: Any) -> Any:
    """The photograph on a plane, by rays back to it."""
    x, y = fine_centers()
    u, v, w = np.tensordot(np.linalg.inv(matrix), np.stack([x, y, np.ones_like(x)]), 1)
    hit = (w > 0) & (u >= 0) & (u <= 64 * w) & (v >= 0) & (v <= 64 * w)
    safe = np.where(hit, w, 1.0)
    return mean(np.where(hit[..., None], texels(u / safe, v / safe), 0.0), RAYS)


def on_mirrored_plane(matrix: Any) -> Any:
    """The same, mirrored at its edges, under a Gaussian of half a pixel."""
    weight, margin = window(Gaussian(0.5), RAYS)
    x, y = fine_centers(margin)
    u, v, w = np.tensordot(np.linalg.inv(matrix), np.stack([x, y, np.ones_like(x)]), 1)
    ahead = w > 0
    safe = np.where(ahead, w, 1.0)
    fine = np.where(ahead[..., None], texels(u / safe, v / safe, "reflect"), 0.0)
    return plain_filtered(fine, weight, (SIDE, SIDE), RAYS)


def on_map() -> Any:
    """The photograph bent by formulas: parts of texels, with the area that they have on screen."""
    axis = (np.arange(64 * 48) + 0.5) / 48
    u, v = np.meshgrid(axis, axis)
    x, y = scenes.bent(u, v)
    inside = (x >= 0) & (x < SIDE) & (y >= 0) & (y < SIDE)
    area = np.abs(0.45 * 0.5 + 2 / 9 * np.cos(v / 9) * np.sin(u / 7) / 7) / 48**2
    pixel = y[inside].astype(int) * SIDE + x[inside].astype(int)
    color = texels(u[inside], v[inside]) * area[inside][:, None]
    found = [np.bincount(pixel, color[:, c], SIDE * SIDE) for c in range(3)]
    return np.stack(found, axis=-1).reshape(SIDE, SIDE, 3)


def on_backward_map() -> Any:
    """The photograph where a map looks, which is a formula."""
    u, v = scenes.back(*fine_centers())
    hit = (u >= 0) & (u <= 64) & (v >= 0) & (v <= 64)
    return mean(np.where(hit[..., None], texels(u, v), 0.0), RAYS)


def mesh() -> Any:
    """A cube with the photograph on it, by rays that ask every triangle."""
    from tests.texture.mesh_shapes import cube, naive_mesh

    pose = look_at((2.1, 1.7, 2.6), (0.5, 0.5, 0.5))
    eye = Camera.from_fov(45, height=SIDE, width=SIDE, world_to_camera=pose)
    return naive_mesh(cube(scenes.photograph(64)), eye, SIDE, rays=RAYS)


def depth_room() -> Any:
    """The generated scene from where the depth image goes, NaN where that does not show it."""
    from resample_comparisons.warp3d.scenes import generated

    scene = generated(64)
    shape, target = scene.shape, scenes.target_of(scene.source)
    color, _ = scene.render(target, shape, rays=16)
    share, _, _ = scene.visible(target, shape, scene.source, shape, rays=4)
    return np.where((share > 0.999)[..., None], color, np.nan)


def ball(scale: float) -> Any:
    """The ball that the cloud was taken of."""
    eye, side = scenes.cloud_camera(scale), SIDE * RAYS
    origin, way = naive.rays(finer(eye, count=RAYS), side, side)
    middle = eye.view().translation
    a, b = (way * way).sum(-1), ((origin - middle) * way).sum(-1)
    root = b * b - a * (middle @ middle - 1)
    nearest = (-b - np.sqrt(np.maximum(root, 0))) / a
    point = (way * nearest[..., None] - middle) @ eye.view().rotation
    hit = (root > 0)[..., None]
    return mean(np.where(hit, np.concatenate([0.5 + 0.5 * point, hit], axis=-1), 0.0), RAYS)


TRUTHS: dict[str, Callable[[], Any]] = {
    "volume": lambda: mean(one_by_one(scenes.samples(), finer(camera()))),
    "volume, far": lambda: mean(one_by_one(scenes.samples(), finer(camera(60.0)))),
    "volume, bspline": lambda: mean(one_by_one(scenes.samples(), finer(camera()), BSplineKernel())),
    "volume, linear opacity": lambda: mean(
        one_by_one(scenes.samples(), finer(camera()), is_linear=True)
    ),
    "volume, by distance": lambda: mean(
        one_by_one(scenes.samples(), finer(camera()), key="distance")
    ),
    "volume, gaussian filter": lambda: filtered(16.0),
    "volume, axis-sheets": lambda: mean(
        naive.axis_sheets(scenes.samples(), finer(camera()), GaussianKernel(), **SIZE)
    ),
    "volume, axis-sheets, far": lambda: mean(
        naive.axis_sheets(scenes.samples(), finer(camera(60.0)), GaussianKernel(), **SIZE)
    ),
    "volume, along the ray": lambda: along_the_ray(16.0),
    "volume, along the ray, far": lambda: along_the_ray(60.0),
    "volume, inside and cut": inside,
    "particles": lambda: mean(one_by_one(scenes.particles(), finer(camera()))),
    **{
        f"rays, {name}": lambda name=name: of_lattice(name)
        for name in ("composite", "maximum", "average", "additive", "minimum")
    },
    "rays, several fields": of_lattices,
    "texture, plane": lambda: on_plane(scenes.FLOOR),
    "texture, grown": lambda: on_plane(scenes.GROWN),
    "texture, map": on_map,
    "texture, backward map": on_backward_map,
    "texture, filtered": lambda: on_mirrored_plane(scenes.FLOOR),
    "texture, mesh": mesh,
    "depth image": depth_room,
    "cloud": lambda: ball(40.0),
    "cloud, far": lambda: ball(12.0),
}


def truth_of(scene: str) -> str | None:
    """Name of the truth of a scene; None if it has none, and `NONE` says why."""
    if scene in NONE:
        return None
    if scene in TRUTHS:
        return scene
    kind = scene.partition(",")[0]
    far = ", far" if scene.endswith(", far") else ""
    if "image-sheets" in scene:
        return f"volume, along the ray{far}"
    if kind == "texture":
        return f"texture, {scene.rpartition(', ')[2]}"
    return f"{kind}{far}"


def stored() -> dict[str, Any]:
    """Truths, to within a 65535th of their span; NaN where there is none."""
    return unpacked(STORED)


def decibels(picture: Any, truth: Any) -> float:
    """PSNR of a picture where the truth is known; its peak is 1, or the truth's span."""
    known = np.isfinite(truth)
    error = np.mean((np.asarray(picture, float)[known] - truth[known]) ** 2)
    return float(10 * np.log10(max(1.0, np.ptp(truth[known])) ** 2 / max(error, 1e-20)))


def main(names: list[str]) -> None:
    """Compute truths and store them."""
    known = stored() if names else {}
    for name in names or TRUTHS:
        known[name] = np.asarray(TRUTHS[name](), np.float32)
    packed(STORED, known)


if __name__ == "__main__":
    main(sys.argv[1:])
