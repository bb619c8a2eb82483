"""Quick test for gross regressions: `python -m benchmarks.guard`, under a minute on two cores.

Four pictures are made by our kernels and by fixed NumPy code that does the same work. The speedup
is compared with the record in `guard.json`; only half of it, or less, is an error, since machines
differ. Both run on one thread, and the smallest CPU time of each counts, which depends least on the
number of cores and on other load. Absolute times are never judged.

`--record` stores the measurement; run it on an idle machine, and give the reason.
"""

import argparse
import json
import math
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.measure import Run, Spread, machine, take_turns
from benchmarks.scenes import floor_matrix, squares, waves
from benchmarks.tables import Row, table

RECORD = Path(__file__).with_suffix(".json")
ROUNDS = 15
WORST = 0.5  # fraction of the recorded ratio below which it is a regression
SIDE = 96  # px
LATTICE = 40  # samples along each side
RADIUS = 2.0  # voxels, of the kernel
SIGMA = 0.7  # voxels


class Work(NamedTuple):
    """A picture made by our kernels and by NumPy."""

    ours: Run
    baseline: Run


def lattice() -> Any:
    """Positions (N, 3) of a cube of samples around the origin."""
    axis = np.arange(LATTICE) - (LATTICE - 1) / 2
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    return np.stack([x, y, z], axis=-1).reshape(-1, 3)


def _volume(focal: float, primitive: str) -> tuple[Run, Any, Any]:
    """Our picture of the cube, its positions in px with depths (N, 3), and opacities."""
    from resample.cameras.models import Camera
    from resample.cameras.poses import orbit
    from resample.painting.choices import Primitive
    from resample.resampler import Resampler
    from resample.types import Samples

    place = lattice()
    rng = np.random.default_rng(7)
    color = rng.uniform(0, 1, (len(place), 3)).astype(np.float32)
    extinction = np.full(len(place), 0.02, np.float32)
    samples = Samples(place.astype(np.float32), color, extinction, np.eye(3))
    camera = Camera.from_intrinsics(
        focal, focal, SIDE / 2, SIDE / 2, orbit((0, 0, 0), 4 * LATTICE, 30, 20)
    )
    paint = Resampler(primitive=Primitive(primitive))
    view = camera.view()
    seen = place @ view.rotation.T + view.translation
    screen = seen[:, :2] / seen[:, 2:] * focal + SIDE / 2
    run = lambda: paint(samples, camera, height=SIDE, width=SIDE, threads=1)  # noqa: E731
    return run, np.column_stack([screen, seen[:, 2]]), np.column_stack([color, extinction])


def splats() -> Work:
    """Splats of about 8 px diameter."""
    focal = 2.0 * 4 * LATTICE
    run, place, look = _volume(focal, "splats")
    return Work(run, lambda: painted_splats(place, look, focal))


def points() -> Work:
    """Points, two to four per pixel."""
    focal = 0.4 * 4 * LATTICE
    run, place, look = _volume(focal, "points")
    return Work(run, lambda: painted_points(place, look, focal, grid=4))


def painted_splats(place: Any, look: Any, focal: float) -> Any:
    """Gaussian splats summed within depth layers, front to back; (H, W, 4) premultiplied.

    `place` (N, 3) is in px with depth, `look` (N, 4) red, green, blue and extinction.
    """
    reach = math.ceil(RADIUS * focal / place[:, 2].min())
    offset = np.arange(-reach, reach + 1)
    picture = np.zeros((SIDE * SIDE, 4))
    clear = np.ones(SIDE * SIDE)
    for layer in _layers(place[:, 2]):
        corner = np.floor(place[layer, :2])
        column = corner[:, 0, None, None] + offset
        row = corner[:, 1, None, None] + offset[:, None]
        scale = (focal / place[layer, 2])[:, None, None]
        dx, dy = (column + 0.5 - place[layer, 0, None, None]) / scale, row + 0.5
        dy = (dy - place[layer, 1, None, None]) / scale
        squared = dx * dx + dy * dy
        integral = np.exp(squared / (-2 * SIGMA**2)) * (squared < RADIUS**2)
        depth = integral / (2 * np.pi * SIGMA**2) * look[layer, 3, None, None]
        inside = (column >= 0) & (column < SIDE) & (row >= 0) & (row < SIDE) & (depth > 0)
        pixel = (row * SIDE + column)[inside].astype(np.int64)
        _composite(picture, clear, pixel, depth[inside], np.nonzero(inside)[0], look[layer])
    return picture.reshape(SIDE, SIDE, 4)


def painted_points(place: Any, look: Any, focal: float, grid: int) -> Any:
    """Points of 3 × 3 taps on a grid of sub-pixels, summed within depth layers.

    Parameters and result as of `painted_splats`; `grid` is sub-pixels along a pixel.
    """
    side = SIDE * grid
    picture, clear = np.zeros((side * side, 4)), np.ones(side * side)
    area = (focal * grid / place[:, 2]) ** 2
    offset = np.arange(-1, 2)
    for layer in _layers(place[:, 2]):
        x, y = (place[layer, n] * grid for n in (0, 1))
        column = np.floor(x)[:, None, None] + offset
        row = np.floor(y)[:, None, None] + offset[:, None]
        weight = np.exp(-((column + 0.5 - x[:, None, None]) ** 2))
        weight = weight * np.exp(-((row + 0.5 - y[:, None, None]) ** 2))
        weight *= (area[layer] * look[layer, 3] / weight.sum(axis=(1, 2)))[:, None, None]
        inside = (column >= 0) & (column < side) & (row >= 0) & (row < side)
        pixel = (row * side + column)[inside].astype(np.int64)
        _composite(picture, clear, pixel, weight[inside], np.nonzero(inside)[0], look[layer])
    return picture.reshape(SIDE, grid, SIDE, grid, 4).mean(axis=(1, 3))


def _layers(depth: Any) -> list[Any]:
    """Samples (K,) of each layer, one voxel deep, front to back."""
    order = np.argsort(depth, kind="stable")
    layer = np.floor(depth[order]).astype(np.int64)
    return np.split(order, np.flatnonzero(np.diff(layer)) + 1)


def _composite(picture: Any, clear: Any, pixel: Any, depth: Any, sample: Any, look: Any) -> None:
    """Composite a layer's fragments behind the picture."""
    total = np.bincount(pixel, depth, minlength=clear.size)
    alpha = 1 - np.exp(-total)
    share = clear * np.divide(alpha, total, out=np.zeros_like(total), where=total > 0)
    for channel in range(3):
        light = np.bincount(pixel, depth * look[sample, channel], minlength=clear.size)
        picture[:, channel] += share * light
    picture[:, 3] += clear * alpha
    clear *= 1 - alpha


def texture() -> Work:
    """A floor, against 4 × 4 bilinear lookups per pixel."""
    from resample_texture import warp

    size = 192
    texels, matrix = squares(2 * size), floor_matrix(2 * size, size)
    return Work(
        lambda: warp(texels, matrix, (size, size), edge="clamp", threads=1),
        lambda: supersampled(texels, matrix, size, 4),
    )


def supersampled(texels: Any, matrix: Any, size: int, rays: int) -> Any:
    """Mean of rays × rays bilinear lookups per pixel, (size, size)."""
    y, x = (np.mgrid[0 : size * rays, 0 : size * rays] + 0.5) / rays
    u, v, w = np.einsum("rc,cij->rij", np.linalg.inv(matrix), np.stack([x, y, np.ones_like(x)]))
    u, v = (np.clip(each / w - 0.5, 0, texels.shape[0] - 1.001) for each in (u, v))
    column, row = u.astype(np.int64), v.astype(np.int64)
    right, down = u - column, v - row
    above = texels[row, column] * (1 - right) + texels[row, column + 1] * right
    below = texels[row + 1, column] * (1 - right) + texels[row + 1, column + 1] * right
    read = above * (1 - down) + below * down
    return read.reshape(size, rays, size, rays).mean(axis=(1, 3))


def warp3d() -> Work:
    """A depth image moved aside, against summing nearest samples at twice the resolution."""
    from resample.cameras.models import Camera
    from resample.engine.jit import threads
    from resample_warp3d.depth.equation import between, places, warp_places
    from resample_warp3d.depth.preparation import prepare
    from resample_warp3d.methods.hybrid import Hybrid
    from resample_warp3d.types import DepthImage

    size = 256
    color, depth = waves(size)
    image = DepthImage(color, (1 / depth).astype(np.float32))
    pose = np.eye(4)
    pose[:3, 3] = (-0.2, 0.0, 0.1)
    camera = Camera.from_fov(60, size, size)
    source, method = prepare(image), Hybrid()

    def ours() -> object:
        with threads(1):
            return method(source, between(camera, camera.moved(pose)), (size, size))

    def baseline() -> object:
        fine = image._replace(color=doubled(color), nearness=doubled(image.nearness))
        matrix = np.array([[2.0, 0.0, -0.5], [0.0, 2.0, -0.5], [0.0, 0.0, 1.0]])
        equation = between(Camera(matrix @ camera.matrix), camera.moved(pose))
        near = np.asarray(fine.nearness, np.float64)
        place, nearness = warp_places(equation, places(fine), near)
        return nearest_summed(place.reshape(-1, 2), nearness.ravel(), fine.color, size)

    return Work(ours, baseline)


def doubled(image: Any) -> Any:
    """Upsample by inserting midpoints between rows and columns."""
    for axis in (0, 1):
        after = np.minimum(np.arange(image.shape[axis]) + 1, image.shape[axis] - 1)
        between = (image + np.take(image, after, axis)) / 2
        shape = list(image.shape)
        shape[axis] *= 2
        image = np.stack([image, between], axis=axis + 1).reshape(shape)
    return image


def nearest_summed(place: Any, nearness: Any, color: Any, size: int) -> Any:
    """Sum samples over 2 × 2 pixels, only those near the nearest per pixel; (size, size, 3)."""
    color = color.reshape(-1, 3)
    corner = np.floor(place - 0.5).astype(np.int64)
    part = place - 0.5 - corner
    nearest = np.zeros(size * size)
    taps = []
    for down in (0, 1):
        for right in (0, 1):
            column, row = corner[:, 0] + right, corner[:, 1] + down
            inside = (column >= 0) & (column < size) & (row >= 0) & (row < size)
            pixel = np.where(inside, row * size + column, 0)
            weight = np.abs(1 - right - part[:, 0]) * np.abs(1 - down - part[:, 1]) * inside
            taps.append((pixel, weight))
            np.maximum.at(nearest, pixel[inside], nearness[inside])
    sums, weights = np.zeros((3, size * size)), np.full(size * size, 1e-9)
    for pixel, weight in taps:
        kept = weight * (nearness > 0.97 * nearest[pixel])
        weights += np.bincount(pixel, kept, minlength=size * size)
        for channel in range(3):
            sums[channel] += np.bincount(pixel, kept * color[:, channel], minlength=size * size)
    return (sums / weights).T.reshape(size, size, 3)


WORKS: dict[str, Callable[[], Work]] = {
    "volume, splats": splats,
    "volume, points": points,
    "texture": texture,
    "depth image": warp3d,
}


def measured(rounds: int) -> dict[str, tuple[Spread, Spread, float]]:
    """CPU seconds of ours and the baseline, and the best speedup."""
    found = {}
    for name, prepare in WORKS.items():
        work = prepare()
        runs = {"ours": work.ours, "baseline": work.baseline}
        times = take_turns(runs, rounds, clock=time.process_time)
        faster = min(times["baseline"]) / min(times["ours"])
        found[name] = Spread.of(times["ours"]), Spread.of(times["baseline"]), faster
    return found


def regressions(faster: Mapping[str, float], recorded: Mapping[str, float]) -> list[str]:
    """Messages about works whose speedup is less than half of the record."""
    said = []
    for name, now in faster.items():
        before = recorded.get(name)
        if before is None:
            said.append(f"{name}: nothing is on record; measure with --record")
        elif now < WORST * before:
            said.append(f"{name}: {now:.1f} times as fast as NumPy, and {before:.1f} on record")
    return said


def read_record(path: Path) -> dict[str, float]:
    """Recorded ratios; empty if there is no file."""
    if not path.is_file():
        return {}
    return {
        str(name): float(value) for name, value in json.loads(path.read_text())["faster"].items()
    }


def main() -> int:
    """Print ratios beside the record; returns 1 for a gross regression."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.guard")
    parser.add_argument("--record", action="store_true", help="keep what is measured")
    is_recording = parser.parse_args().record
    recorded, rows = read_record(RECORD), list[Row]()
    found = measured(ROUNDS)
    faster = {name: round(times, 2) for name, (_, _, times) in found.items()}
    for name, (ours, baseline, _) in found.items():
        row: Row = {
            "": name,
            "ours, CPU ms": ours.times(1000),
            "NumPy, CPU ms": baseline.times(1000),
        }
        rows.append(row | {"times faster": faster[name], "on record": recorded.get(name, "")})
    sys.stdout.write(table(rows))
    if is_recording:
        text = json.dumps({"faster": faster, "machine": machine()}, indent=1, ensure_ascii=False)
        RECORD.write_text(text + "\n", encoding="utf-8")
        return 0
    said = regressions(faster, recorded)
    sys.stdout.write("".join(f"{line}\n" for line in said))
    return 1 if said else 0


if __name__ == "__main__":
    sys.exit(main())
