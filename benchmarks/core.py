"""The core against hardware limits: points and splat fragments per second.

A *fragment* is a sub-pixel whose center lies inside a splat's footprint and which is not opaque
when the splat is composited. `kernels.fragments` counts them: it processes all samples front to
back in plain loops, evaluates the kernel's line integral at every sub-pixel of a bounding box and
attenuates the light as the painters do. So it counts necessary work, whatever else a painter does
or skips.

The limits are measured in the same run on all threads: bandwidth by copying between arrays far
larger than caches (read and written), operations by chains of fused multiply-adds in registers.
"""

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from benchmarks.contest import AbsentError, Options
from benchmarks.measure import Spread, take_turns
from benchmarks.tables import Row, Section
from benchmarks.volume import POINTS, View
from resample.painting.choices import Primitive
from resample.painting.preparing import OPAQUE
from resample.painting.scenes.scene import ellipsoid_of
from resample.profiles.reconstruction import footprint_table
from resample.resampler import Resampler
from resample.types import Samples

SPLATS = Resampler(primitive=Primitive.SPLATS)
# Minimum cost of a fragment in fused multiply-adds; other operations count as one each.
FRAGMENT = {
    "offset from the center and quadratic form": 3,
    "scale of the ray and test for the rim": 2,
    "the kernel’s line integral by a polynomial of degree 5": 5,
    "optical depth": 2,
    "1 − exp(−x) by range reduction and a polynomial": 8,
    "weight, red, green, blue, depth, coverage, opacity and light that is left": 8,
}
SAMPLE_BYTES = 28  # position, color and extinction in float32, read once
SPLAT_GOAL, POINT_GOAL = 0.4, 0.3


class Roofs(NamedTuple):
    """The best of all rounds on all threads, per second."""

    copied: float  # bytes read and written
    multiplied: float  # fused multiply-adds


def roofs(options: Options) -> Roofs:
    """Measure the hardware limits."""
    from benchmarks.kernels.roofline import CHAIN, multiply_add

    cores, often = os.cpu_count() or 1, 2000
    size = (1 << (20 if options.quick else 26)) // cores * cores
    source, target = np.ones(size, np.float32), np.ones(size, np.float32)
    parts = [slice(n * (size // cores), (n + 1) * (size // cores)) for n in range(cores)]
    numbers = np.ones((8 * cores, 512), np.float32)
    with ThreadPoolExecutor(cores) as pool:
        times = take_turns(
            {
                "copy": lambda: list(pool.map(lambda n: np.copyto(target[n], source[n]), parts)),
                "multiply": lambda: multiply_add(numbers, 0.999, 0.001, often),
            },
            max(5, options.rounds),
        )
    operations = CHAIN * often * numbers.size
    return Roofs(8 * size / min(times["copy"]), operations / min(times["multiply"]))


class Fragments(NamedTuple):
    """Counts of sub-pixels in a picture of splats."""

    inside: int  # in footprints
    painted: int  # of these, not opaque yet when composited
    light: Any  # (H, W) transmittance


def fragments(samples: Samples, camera: Any, side: int) -> Fragments:
    """Count the fragments of splats at one ray per pixel."""
    from benchmarks.kernels.fragments import count_fragments

    view, kernel = camera.view(), SPLATS.reconstruction
    place = samples.position @ view.rotation.T + view.translation
    order = np.argsort(place[:, 2], kind="stable")
    light = np.ones((side, side))
    inside, painted = count_fragments(
        np.ascontiguousarray(place[order], np.float64),
        np.ascontiguousarray(samples.extinction[order], np.float32),
        view,
        ellipsoid_of(samples.lattice, view, kernel.radius),
        footprint_table(kernel).values,
        OPAQUE,
        light,
    )
    return Fragments(inside, painted, light)


def sections(options: Options) -> Iterator[Section]:
    """Hardware limits, then points and splats relative to them."""
    roof = roofs(options)
    yield _roof_table(roof)
    yield _core_table(roof, options)


def _roof_table(roof: Roofs) -> Section:
    rows: list[Row] = [
        {"": "copy, 10⁹ bytes read and written per second", "all threads": roof.copied / 1e9},
        {"": "fused multiply-adds, 10⁹ per second", "all threads": roof.multiplied / 1e9},
    ]
    return Section("What the machine can do", "The best of all rounds.", rows)


def _core_table(roof: Roofs, options: Options) -> Section:
    operations = sum(FRAGMENT.values())
    section = Section(
        "The core beside the roofs",
        "A fragment is a sub-pixel inside a splat’s footprint that is not opaque yet when its turn "
        "comes, as a plain\nwalk through the samples counts them. It needs "
        f"{operations} multiply-adds at least:\n"
        + ";\n".join(f"{name}, {count}" for name, count in FRAGMENT.items())
        + f".\nA point needs its {SAMPLE_BYTES} bytes read once.",
    )
    sides = (48,) if options.quick else (400, 1024)
    name = "engine" if not options.quick else "checker-box"
    for side in sides:
        try:
            section.rows += _splats(View(name, "all splats", side, 0.3, options), roof, options)
            if name == "engine":
                low = View(name, "all splats", side, 0.02, options)
                section.rows += _splats(low, roof, options)
            section.rows += _points(View(name, "all points", side, 0.3, options), roof, options)
        except AbsentError as error:
            section.notes.append(f"{name}: left out, {error}")
            break
    return section


def _timed(view: View, form: Resampler, options: Options) -> tuple[Spread, Spread]:
    """Seconds of a picture, and of painting alone."""
    stages: list[float] = []

    def run() -> None:
        frame = form(view.samples, view.camera, height=view.side, width=view.side)
        stages.append(frame.statistics.seconds.get("paint", float("nan")))

    times = take_turns({"picture": run}, options.rounds)["picture"]
    return Spread.of(times), Spread.of(stages[-len(times) :])


def _splats(view: View, roof: Roofs, options: Options) -> list[Row]:
    found = fragments(_lit(view), view.camera, view.side)
    best = roof.multiplied / sum(FRAGMENT.values())
    what = f"splats, {view.name} {view.side} px, opacity {view.opacity:g}"
    rows: list[Row] = []
    for stage, seconds in zip(("picture", "painting"), _timed(view, SPLATS, options), strict=True):
        speed = found.painted / seconds.median
        row: Row = {
            "": f"{what}, {stage}",
            "ms": seconds.times(1000),
            "10⁶ done": found.painted / 1e6,
            "10⁶ per second": speed / 1e6,
            "roof": best / 1e6,
            "share of the roof": speed / best,
        }
        if stage == "painting":
            row |= _judged(speed / best, SPLAT_GOAL)
        rows.append(row)
    rows[0]["10⁶ inside footprints"] = found.inside / 1e6
    return rows


def _points(view: View, roof: Roofs, options: Options) -> list[Row]:
    count = len(_lit(view).extinction)
    seconds, _ = _timed(view, POINTS, options)
    speed = count / seconds.median
    best = roof.copied / SAMPLE_BYTES
    row: Row = {
        "": f"points, {view.name} {view.side} px",
        "ms": seconds.times(1000),
        "10⁶ done": count / 1e6,
        "10⁶ per second": speed / 1e6,
        "roof": best / 1e6,
        "share of the roof": speed / best,
    }
    return [row | _judged(speed / best, POINT_GOAL)]


def _lit(view: View) -> Samples:
    samples = view.samples
    if not isinstance(samples, Samples):
        raise TypeError(f"samples are wanted here, not {type(samples).__name__}")
    return samples


def _judged(share: float, goal: float) -> Row:
    return {"target": f"≥ {goal:g}", "met": "yes" if share >= goal else "no"}
