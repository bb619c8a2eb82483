"""Volumes against the integral of the field that they were sampled from.

`python -m benchmarks.fields` samples fields that are formulas, renders the samples by our methods
and by VTK, and compares with the formula itself, integrated along many rays per pixel in steps of
an eighth of a voxel. No kernel of ours takes part in that truth, so blur counts as an error.
"""

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from resample.cameras.models import AnyCamera
from resample.cameras.viewpoints import Orbit, Sphere, camera_from
from resample.profiles.orders import ImageSheets, Rays
from resample.resampler import Resampler
from resample.types import Doubles, Floats
from resample_volume.looks.transfer import from_points
from resample_volume.rendering import Appearance, Classification, Subject
from resample_volume.rivals.peers import Peer, VtkRenderer
from resample_volume.types import Volume
from resample_volume.voxels.shading import Light

SIDE = 64  # voxels
STEP = 1 / 8  # voxels

Formula = Callable[[Doubles, Doubles, Doubles], Doubles]


def rings(width: float) -> Formula:
    """Two tori and a shell of Gaussian profile; `width` is its half at 1 / e, voxels."""

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
    """Ball whose values fall evenly from its middle."""
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
    """Volume of 8 bits of a formula around the origin, with voxels of 1 × 1 × `stretch`."""
    count = np.array([SIDE, SIDE, round(SIDE / stretch)])
    spacing = np.array([1.0, 1.0, stretch])
    origin = -0.5 * spacing * (count - 1)
    x, y, z = (origin[n] + spacing[n] * np.arange(count[n]) for n in range(3))
    values = formula(x, y[:, None], z[:, None, None])
    return Volume(
        np.rint(np.clip(values, 0, 255)).astype(np.uint8), spacing, origin, np.eye(3), "formula"
    )


class Shot(NamedTuple):
    """A view of the formula's volume."""

    per_voxel: float  # px in the middle of the volume
    size: int  # px, side of the picture
    rays: int  # per side of a pixel, of the truth


SHOTS = (Shot(3.0, 128, 4), Shot(1.0, 96, 6), Shot(0.3, 32, 20))


def camera_of(shot: Shot) -> AnyCamera:
    """Camera from above that sees voxels as large as asked for."""
    sphere = Sphere(np.zeros(3), SIDE * 0.87)
    once = camera_from(Orbit(30, 20, 1.0), sphere, shot.size, shot.size).view()
    per_voxel = once.focal[0] / once.translation[2]
    return camera_from(Orbit(30, 20, shot.per_voxel / per_voxel), sphere, shot.size, shot.size)


def integrated(formula: Formula, half: Doubles, shot: Shot, light: Light | None) -> Floats:
    """Picture (H, W, 4) of a formula within a box of half sides (3,), premultiplied."""
    view = camera_of(shot).view()
    fine = (np.arange(shot.size * shot.rays) + 0.5) / shot.rays
    eye = -view.rotation.T @ view.translation
    picture = np.empty((shot.size, shot.size, 4), np.float32)
    for row in range(shot.size):
        y = fine[row * shot.rays : (row + 1) * shot.rays]
        at = np.stack(np.meshgrid(fine, y), axis=-1).reshape(-1, 2)
        way = np.column_stack([(at - view.principal) / view.focal, np.ones(len(at))])
        way = way @ view.rotation
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        rays = _marched(formula, half, eye, way, light)
        seen = rays.reshape(shot.rays, shot.size, shot.rays, 4)
        picture[row] = seen.mean(axis=(0, 2))
    return picture


def _marched(
    formula: Formula, half: Doubles, eye: Doubles, way: Doubles, light: Light | None
) -> Doubles:
    """What rays (N, 3) of length 1 from an eye see of a formula, (N, 4)."""
    with np.errstate(divide="ignore"):
        walls = np.stack([(-half - eye) / way, (half - eye) / way])
    enter, leave = walls.min(axis=0).max(axis=1), walls.max(axis=0).min(axis=1)
    seen, passed = np.zeros((len(way), 4)), np.ones(len(way))
    rays = np.flatnonzero(leave > enter)
    for step in range(int(np.ceil((leave - enter).max(initial=0.0) / STEP))):
        at = enter[rays] + (step + 0.5) * STEP
        rays = rays[(at < leave[rays]) & (passed[rays] > 1e-4)]
        if not rays.size:
            break
        place = eye + (enter[rays] + (step + 0.5) * STEP)[:, None] * way[rays]
        color, opacity = TRANSFER.looks(formula(*place.T), None, (0.0, 255.0), 1.0)
        if light is not None:
            color = _lit(color, formula, place, -way[rays], light)
        share = passed[rays] * -np.expm1(np.log1p(-opacity) * STEP)
        seen[rays, :3] += share[:, None] * color
        seen[rays, 3] += share
        passed[rays] -= share
    return seen


def _lit(color: Floats, formula: Formula, place: Doubles, eye: Doubles, light: Light) -> Floats:
    """Colors under a light at the viewer, after Blinn and Phong."""
    ways = 1e-3 * np.eye(3)
    slope = np.stack([formula(*(place + d).T) - formula(*(place - d).T) for d in ways], axis=-1)
    length = np.linalg.norm(slope, axis=1)
    cosine = np.abs(np.einsum("nd,nd->n", slope, eye)) / np.maximum(length, 1e-30)
    cosine[length == 0] = 1.0
    highlight = np.where(length > 0, light.specular * cosine**light.shininess, 0.0)
    own = light.ambient + light.diffuse * cosine
    return np.asarray(own[:, None] * color + highlight[:, None], np.float32)


class Result(NamedTuple):
    """A picture against the truth."""

    decibels: float
    seconds: float  # of CPU time, a frame once all is ready


def measured(draw: Callable[[], Floats], truth: Floats) -> Result:
    """Picture that is drawn, compared, and drawn again for its time."""
    picture = draw()
    seconds = []
    for _ in range(3):
        begun = time.process_time()
        draw()
        seconds.append(time.process_time() - begun)
    error = float(np.mean((picture[..., :3].astype(np.float64) - truth[..., :3]) ** 2))
    return Result(10 * np.log10(1.0 / error), min(seconds))


def drawers(volume: Volume, shot: Shot, light: Light | None) -> dict[str, Callable[[], Floats]]:
    """What draws the volume's samples, by name."""
    camera, size = camera_of(shot), shot.size
    found: dict[str, Callable[[], Floats]] = {}

    def ours(name: str, classification: Classification, resampler: Resampler) -> None:
        appearance = Appearance(TRANSFER, light, classification=classification)
        subject = Subject.of(volume, appearance, resampler)
        found[name] = lambda: (
            resampler(subject.seen_by(camera), camera, height=size, width=size).rgba
        )

    ours("pre", Classification.PRE, Resampler())
    ours("slabs", Classification.POST, Resampler(order=ImageSheets(0.5)))
    ours("rays", Classification.POST, Resampler(order=Rays()))
    for rays in (1, 8):
        look = Peer(rays=rays, light=light)
        peer = VtkRenderer(volume, TRANSFER, height=size, width=size, look=look)
        found[f"VTK {rays * rays}"] = partial(peer.render, camera)
    return found


def main(arguments: Sequence[str]) -> None:
    """Print decibels and CPU seconds of every field, view and method."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fields", description=__doc__)
    parser.add_argument("--only", default=",".join(FIELDS), help="fields, separated by commas")
    parser.add_argument("--without", default="", help="methods to leave out")
    given = parser.parse_args(arguments)
    for name in given.only.split(","):
        for stretch, light in ((1.0, None), (1.0, Light()), (5.0, None)):
            volume = sampled(FIELDS[name], stretch)
            half = 0.5 * volume.spacing * volume.values.shape[::-1]
            for shot in SHOTS:
                truth = integrated(FIELDS[name], half, shot, light)
                row = [f"{name} {'lit' if light else 'unlit'} 1x1x{stretch:g} {shot.per_voxel:g}"]
                for method, draw in drawers(volume, shot, light).items():
                    if method not in given.without.split(","):
                        result = measured(draw, truth)
                        row.append(f"{method} {result.decibels:.1f} {result.seconds:.3f}")


if __name__ == "__main__":
    main(sys.argv[1:])
