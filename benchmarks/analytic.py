"""Analytic fields, and reference pictures by ray casting the formulas without our kernels."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from resample.cameras.models import AnyCamera
from resample.cameras.viewpoints import Orbit, Sphere, camera_from
from resample.types import Doubles, Floats, Indices
from resample_volume.classification.transfer import from_points
from resample_volume.types import Volume
from resample_volume.voxels.shading import Light

SIDE = 64  # voxels
STEP = 1 / 8  # voxels
ISO = 100.0  # value of the surfaces
HALVINGS = 20  # of a step, to locate a surface
LEAST = 1e-4  # transmittance that counts as opaque

Formula = Callable[[Doubles, Doubles, Doubles], Doubles]


def rings(width: float) -> Formula:
    """Two tori and a shell with a Gaussian profile; `width` is its half width at 1 / e, voxels."""

    def values(x: Doubles, y: Doubles, z: Doubles) -> Doubles:
        first = (np.hypot(x, y) - 20.0) ** 2 + z * z
        second = (np.hypot(y, z) - 14.0) ** 2 + x * x
        shell = (np.sqrt(x * x + y * y + z * z) - 26.0) ** 2
        nearest = np.minimum(np.minimum(first, second), shell * 1.3 + 0.3)
        return 230.0 * np.exp(-nearest / width**2)

    return values


def marschner_lobb(x: Doubles, y: Doubles, z: Doubles) -> Doubles:
    """Marschner and Lobb's signal, of frequency 6 and depth ¼, over 64 voxels."""
    u, v, w = x / 32, y / 32, z / 32
    wave = np.cos(12 * np.pi * np.cos(0.5 * np.pi * np.hypot(u, v)))
    return 255.0 * (1.0 - np.sin(0.5 * np.pi * w) + 0.25 * (1.0 + wave)) / 2.5


def ramp(x: Doubles, y: Doubles, z: Doubles) -> Doubles:
    """Ball whose values decrease linearly from its center."""
    return np.clip(255.0 * (1.0 - np.sqrt(x * x + y * y + z * z) / 28.0), 0.0, None)


FIELDS: dict[str, Formula] = {
    "rings 1.2": rings(1.2),
    "rings 2.0": rings(2.0),
    "rings 3.5": rings(3.5),
    "ramp": ramp,
    "marschner-lobb": marschner_lobb,
}
TRANSFER = from_points(
    [
        (40.0, (0.1, 0.2, 0.9), 0.0),
        (70.0, (0.1, 0.7, 0.9), 0.15),
        (110.0, (0.2, 0.9, 0.2), 0.05),
        (160.0, (0.9, 0.7, 0.1), 0.35),
        (255.0, (0.95, 0.2, 0.1), 0.8),
    ],
    opacity_unit=1.0,
)


def sampled(formula: Formula, stretch: float = 1.0) -> Volume:
    """Sample a formula around the origin to an 8-bit volume with voxels of 1 × 1 × `stretch`."""
    count = np.array([SIDE, SIDE, round(SIDE / stretch)])
    spacing = np.array([1.0, 1.0, stretch])
    origin = -0.5 * spacing * (count - 1)
    x, y, z = (origin[n] + spacing[n] * np.arange(count[n]) for n in range(3))
    values = formula(x, y[:, None], z[:, None, None])
    return Volume(
        np.rint(np.clip(values, 0, 255)).astype(np.uint8), spacing, origin, np.eye(3), "formula"
    )


class Shot(NamedTuple):
    """A view of a formula's volume."""

    per_voxel: float  # px at the volume's center
    size: int  # px, side of the picture
    rays: int  # per side of a pixel, for the reference


SHOTS = (Shot(3.0, 128, 4), Shot(1.0, 96, 6), Shot(0.3, 32, 20))


def camera_of(shot: Shot) -> AnyCamera:
    """Camera from above that shows voxels at the requested size."""
    sphere = Sphere(np.zeros(3), SIDE * 0.87)
    once = camera_from(Orbit(30, 20, 1.0), sphere, shot.size, shot.size).view()
    per_voxel = once.focal[0] / once.translation[2]
    return camera_from(Orbit(30, 20, shot.per_voxel / per_voxel), sphere, shot.size, shot.size)


class Rays(NamedTuple):
    """Rays (N,) from an eye."""

    eye: Doubles  # (3,)
    way: Doubles  # (N, 3) of length 1
    enter: Doubles  # (N,) distances at which they enter the field's box; more than `leave`: never
    leave: Doubles

    def at(self, which: Indices, distance: Doubles) -> Doubles:
        """Positions on some of the rays, (3, M)."""
        return np.asarray((self.eye + distance[:, None] * self.way[which]).T)


class Truth(NamedTuple):
    """Reference values of pixels (H, W), means over their rays."""

    unlit: Floats  # (H, W, 4) premultiplied
    lit: Floats | None  # (H, W, 4)
    maximum: Floats  # (H, W) of values; empty is 0, as outside the box
    minimum: Floats
    average: Floats
    additive: Floats  # values × voxels
    surface: Floats  # (H, W, 4) surface where the field first exceeds `ISO`, lit


def truth_of(formula: Formula, half: Doubles, shot: Shot, light: Light, *, is_lit: bool) -> Truth:
    """Cast rays through a formula in a box with half sides (3,)."""
    view = camera_of(shot).view()
    fine = (np.arange(shot.size * shot.rays) + 0.5) / shot.rays
    eye = -view.rotation.T @ view.translation
    rows = []
    for row in range(shot.size):
        y = fine[row * shot.rays : (row + 1) * shot.rays]
        at = np.stack(np.meshgrid(fine, y), axis=-1).reshape(-1, 2)
        way = np.column_stack([(at - view.principal) / view.focal, np.ones(len(at))])
        way = way @ view.rotation
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        with np.errstate(divide="ignore"):
            walls = np.stack([(-half - eye) / way, (half - eye) / way])
        rays = Rays(eye, way, walls.min(axis=0).max(axis=1), walls.max(axis=0).min(axis=1))
        seen = np.column_stack(
            [
                _composited(formula, rays, None),
                _composited(formula, rays, light if is_lit else None),
                *_measured(formula, rays),
                _surface(formula, rays, light),
            ]
        )
        rows.append(seen.reshape(shot.rays, shot.size, shot.rays, -1).mean(axis=(0, 2)))
    all_of = np.array(rows, np.float32)
    return Truth(
        unlit=all_of[..., :4],
        lit=all_of[..., 4:8] if is_lit else None,
        maximum=all_of[..., 8],
        minimum=all_of[..., 9],
        average=all_of[..., 10],
        additive=all_of[..., 11],
        surface=all_of[..., 12:16],
    )


def _composited(formula: Formula, rays: Rays, light: Light | None) -> Doubles:
    """Composite light (N, 4) along rays."""
    seen, passed = np.zeros((len(rays.way), 4)), np.ones(len(rays.way))
    left = np.flatnonzero(rays.leave > rays.enter)
    for step in range(int(np.ceil((rays.leave - rays.enter).max(initial=0.0) / STEP))):
        at = rays.enter[left] + (step + 0.5) * STEP
        left = left[(at < rays.leave[left]) & (passed[left] > LEAST)]
        if not left.size:
            break
        place = rays.at(left, rays.enter[left] + (step + 0.5) * STEP)
        color, opacity = TRANSFER.classify(formula(*place), None, (0.0, 255.0), 1.0)
        if light is not None:
            color = _lit(color, formula, place, -rays.way[left], light)
        share = passed[left] * -np.expm1(np.log1p(-opacity) * STEP)
        seen[left, :3] += share[:, None] * color
        seen[left, 3] += share
        passed[left] -= share
    return seen


def _lit(color: Floats, formula: Formula, place: Doubles, eye: Doubles, light: Light) -> Floats:
    """Shade positions (3, N) by a light at the viewer, after Blinn and Phong."""
    ways = 1e-3 * np.eye(3)[:, :, None]
    slope = np.stack([formula(*(place + d)) - formula(*(place - d)) for d in ways], axis=-1)
    length = np.linalg.norm(slope, axis=1)
    cosine = np.abs(np.einsum("nd,nd->n", slope, eye)) / np.maximum(length, 1e-30)
    cosine[length == 0] = 1.0
    highlight = np.where(length > 0, light.specular * cosine**light.shininess, 0.0)
    own = light.ambient + light.diffuse * cosine
    return np.asarray(own[:, None] * color + highlight[:, None], np.float32)


def _measured(formula: Formula, rays: Rays) -> list[Doubles]:
    """Maximum, minimum, mean, and sum times length along each ray (N,)."""
    count = len(rays.way)
    most, least = np.zeros(count), np.full(count, np.inf)
    total, steps = np.zeros(count), np.zeros(count)
    left = np.flatnonzero(rays.leave > rays.enter)
    for step in range(int(np.ceil((rays.leave - rays.enter).max(initial=0.0) / STEP))):
        at = rays.enter[left] + (step + 0.5) * STEP
        left = left[at < rays.leave[left]]
        value = formula(*rays.at(left, rays.enter[left] + (step + 0.5) * STEP))
        most[left] = np.maximum(most[left], value)
        least[left] = np.minimum(least[left], value)
        total[left] += value
        steps[left] += 1
    least[steps == 0] = 0.0
    return [most, least, total / np.maximum(steps, 1), total * STEP]


def _surface(formula: Formula, rays: Rays, light: Light) -> Doubles:
    """First intersections of rays with the surface at `ISO` (N, 4), colored and lit."""
    seen = np.zeros((len(rays.way), 4))
    left = np.flatnonzero(rays.leave > rays.enter)
    for step in range(int(np.ceil((rays.leave - rays.enter).max(initial=0.0) / STEP)) + 1):
        far = np.minimum(rays.enter[left] + step * STEP, rays.leave[left])
        is_hit = formula(*rays.at(left, far)) >= ISO
        hits, behind = left[is_hit], far[is_hit]
        if hits.size:
            before = np.maximum(behind - STEP, rays.enter[hits])
            for _ in range(HALVINGS):
                middle = 0.5 * (before + behind)
                is_in = formula(*rays.at(hits, middle)) >= ISO
                before, behind = np.where(is_in, before, middle), np.where(is_in, middle, behind)
            color = TRANSFER.colors(np.full(hits.size, ISO), (0.0, 255.0))
            seen[hits, :3] = _lit(color, formula, rays.at(hits, behind), -rays.way[hits], light)
            seen[hits, 3] = 1.0
        left = left[~is_hit & (far < rays.leave[left])]
        if not left.size:
            break
    return seen
