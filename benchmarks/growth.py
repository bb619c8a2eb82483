"""Growth of time and memory with samples, pixels and threads."""

import os
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.contest import Options, idle_memory
from benchmarks.measure import Run, Spread, child, exponent, peak_memory, take_turns
from benchmarks.scenes import floor_matrix, squares, waves
from benchmarks.tables import Row, Section
from resample.cameras.models import Camera
from resample.cameras.viewpoints import Orbit
from resample.engine.jit import threads
from resample_texture import warp
from resample_texture.methods.forward import Hybrid
from resample_volume.appearance import Appearance, Classification
from resample_volume.classification.transfer import from_points
from resample_volume.inputs import as_volume
from resample_volume.rendering import Subject
from resample_volume.types import Volume
from resample_volume.voxels.visible import Voxels
from resample_warp3d.depth.equation import between
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.methods.hybrid import Hybrid as HybridWarp
from resample_warp3d.types import DepthImage

SIDES = (47, 100, 215, 464)  # voxels: 1.0e5, 1.0e6, 9.9e6 and 1.0e8 in all
PIXELS = (256, 512, 1024, 2048, 4096)
OPAQUE_SHARE = 0.05  # fraction of the voxels that is visible
WAVES = 3  # periods of the surface along a volume's side
PICTURE = 400  # px
MOST_MEMORY = 24 * 1024  # MiB
NOISE = 0.05  # tolerance on an exponent of 1 for timing noise
TEXELS = 1024  # per side of the texture
SAND = (0.9, 0.8, 0.6)
LOOK = Appearance(
    from_points([(1, SAND, 0.0), (1, SAND, 0.5), (255, SAND, 0.5)]),
    classification=Classification.PRE,
)
DEPTHS = 512  # px per side of the depth image


def gyroid(side: int) -> Volume:
    """8-bit volume with a thin curved sheet of 5 % of its voxels; the rest is 0."""
    wave = np.sin(np.linspace(0, 2 * np.pi * WAVES, side, endpoint=False), dtype=np.float32)
    turned = np.cos(np.linspace(0, 2 * np.pi * WAVES, side, endpoint=False), dtype=np.float32)
    plane = wave[:, None] * turned
    values = np.empty((side, side, side), np.uint8)
    limit = _limit()
    for z in range(side):
        level = np.abs(plane + wave[None, :] * turned[z] + wave[z] * turned[:, None])
        values[z] = np.where(level < limit, 255 - 100 * level / limit, 0)
    return as_volume(values, f"gyroid of {side}³")


def _limit() -> float:
    """Level below which 5 % of space lies."""
    phase = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    sine, cosine = np.sin(phase), np.cos(phase)
    level = (
        sine[:, None, None] * cosine[None, :, None]
        + sine[None, :, None] * cosine
        + sine * cosine[:, None, None]
    )
    return float(np.quantile(np.abs(level), OPAQUE_SHARE))


def sections(options: Options) -> Iterator[Section]:
    """Samples, pixels, threads."""
    yield _samples(options)
    yield _pixels(options)
    yield _threads(options)


def in_child(side: int, rounds: int) -> dict[str, float]:
    """Seconds and memory of a volume from array to picture, in this process."""
    volume = gyroid(side)
    before = peak_memory()
    look = LOOK
    Subject.of(gyroid(16), look)  # loads kernels
    start = time.perf_counter()
    subject = Subject.of(volume, look)
    visible = subject.voxels
    assert isinstance(visible, Voxels)
    classified = time.perf_counter() - start
    camera = subject.camera(Orbit(), PICTURE, PICTURE)
    paint = _painter()
    seen = subject.samples_for(camera)
    run = {
        "light": lambda: subject.samples_for(camera),
        "paint": lambda: paint(seen, camera, height=PICTURE, width=PICTURE),
    }
    times = take_turns(run, rounds)
    return {
        "voxels": float(volume.values.size),
        "samples": float(len(visible.position)),
        "volume MiB": before,
        "classify": classified,
        **{name: Spread.of(each).median for name, each in times.items()},
        "peak": peak_memory(),
    }


def _painter() -> Any:
    from resample.resampler import Resampler

    return Resampler()


def _samples(options: Options) -> Section:
    sides = SIDES[:2] if options.quick else SIDES
    child("benchmarks.growth", side=24, rounds=1)  # compiles kernels
    found = [
        child("benchmarks.growth", side=side, rounds=max(2, options.rounds // 2)) for side in sides
    ]
    section = Section(
        "Growth with samples",
        f"A curved sheet in volumes of 8 bits, {100 * OPAQUE_SHARE:g} % of their voxels not "
        f"transparent, {PICTURE} × {PICTURE} px, each\nin a process of its own, from the array on.",
        notes=[f"a process that has only imported the library has {idle_memory()} MiB"],
    )
    for each in found:
        row: Row = {
            "voxels": int(each["voxels"]),
            "samples": int(each["samples"]),
            "classify, ms": 1000 * each["classify"],
            "light, ms": 1000 * each["light"],
            "picture, ms": 1000 * each["paint"],
            "peak MiB": int(each["peak"]),
        }
        if each["voxels"] > 9e7:
            fits = each["peak"] <= MOST_MEMORY
            row |= {"target": "≤ 24 GiB", "met": "yes" if fits else "no"}
        section.rows.append(row)
    section.rows += _fitted(found)
    return section


STAGES = {
    "classify, ms": "classify",
    "light, ms": "light",
    "picture, ms": "paint",
    "peak MiB": "peak",
}


def _fitted(found: Sequence[Mapping[str, float]]) -> list[Row]:
    """Exponents over all sizes and over the last two, where constant costs vanish."""
    rows: list[Row] = []
    for name, part in {"**exponent**": found, "**of the last two**": found[-2:]}.items():
        sizes = [each["samples"] for each in part]
        row: Row = {"voxels": name}
        for column, stage in STAGES.items():
            row[column] = exponent(sizes, [each[stage] for each in part])
        rows.append(row)
    worst = max(float(str(row[column])) for row in rows for column in list(STAGES)[:3])
    rows[0] |= _linear(worst)
    return rows


def _linear(power: float) -> Row:
    return {"target": "exponents ≤ 1", "met": "yes" if power <= 1 + NOISE else f"no: {power:.2f}"}


def _painters(pixels: int, count: int | None = None) -> dict[str, Run]:
    """A picture of pixels × pixels by each application, from constant sources."""
    from resample.painting.choices import Primitive
    from resample.resampler import Resampler

    subject = _subject()
    near = subject.camera(Orbit(), pixels, pixels)
    far = subject.camera(Orbit(zoom=0.1), pixels, pixels)
    lit, dim = subject.samples_for(near), subject.samples_for(far)
    splats, points = Resampler(), Resampler(primitive=Primitive.POINTS)
    texels, matrix = squares(TEXELS), floor_matrix(TEXELS, pixels)
    source, camera = _depth_image()
    equation = between(camera, Camera.from_fov(60, pixels, pixels, _moved()))

    def warped() -> object:
        with threads(count):
            return HybridWarp()(source, equation, (pixels, pixels))

    return {
        "volume, filling the frame": lambda: splats(
            lit, near, height=pixels, width=pixels, threads=count
        ),
        "volume, far away (points)": lambda: points(
            dim, far, height=pixels, width=pixels, threads=count
        ),
        "texture": lambda: warp(texels, matrix, (pixels, pixels), Hybrid(), threads=count),
        "depth image": warped,
    }


def _subject() -> Subject:
    return Subject.of(gyroid(100), LOOK)


def _depth_image() -> tuple[Any, Camera]:
    """Prepared source and its camera."""
    color, depth = waves(DEPTHS)
    image = DepthImage(color, (1 / depth).astype(np.float32))
    return prepare(image), Camera.from_fov(60, DEPTHS, DEPTHS)


def _moved() -> Any:
    pose = np.eye(4)
    pose[:3, 3] = (-0.2, 0.0, -0.3)
    return pose


def _pixels(options: Options) -> Section:
    sides = PIXELS[:2] if options.quick else PIXELS
    section = Section(
        "Growth with pixels",
        "The same sources in larger pictures of the same view: a volume of 100³ voxels, a texture "
        "of 1024², a depth\nimage of 512². Milliseconds.",
    )
    found = []
    for side in sides:
        times = take_turns(_painters(side), max(2, options.rounds // 2))
        found.append({name: 1000 * Spread.of(each).median for name, each in times.items()})
    for name in found[0]:
        medians = [each[name] for each in found]
        power = exponent([side * side for side in sides], medians)
        row: Row = {
            "": name,
            **{f"{side}²": median for side, median in zip(sides, medians, strict=True)},
        }
        last = exponent([side * side for side in sides[-2:]], medians[-2:])
        row |= {"exponent": power, "of the last two": last, **_linear(max(power, last))}
        section.rows.append(row)
    return section


def _threads(options: Options) -> Section:
    cores = (
        len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    )
    counts = sorted({1, 2, cores} & set(range(1, cores + 1)))
    side = 128 if options.quick else 1024
    section = Section(
        "Growth with threads", f"The same pictures at {side} × {side} px. Milliseconds."
    )
    painters = {count: _painters(side, count) for count in counts}
    for name in painters[counts[0]]:
        runs = {str(count): painters[count][name] for count in counts}
        times = take_turns(runs, options.rounds)
        row: Row = {"": name}
        row |= {
            f"{count} thread{'s' * (count > 1)}": Spread.of(times[str(count)]).times(1000)
            for count in counts
        }
        medians = [Spread.of(times[str(count)]).median for count in counts]
        if len(counts) > 1:
            row["times faster"] = medians[0] / medians[-1]
            row["exponent"] = exponent(counts, medians)
        section.rows.append(row)
    return section
