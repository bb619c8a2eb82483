"""Cost of volume options: CPU time of every mode relative to the default."""

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial

from benchmarks.contest import Options
from benchmarks.measure import Run, Spread, ratio, take_turns
from benchmarks.tables import Row, Section
from benchmarks.volume import PAPER_OPACITY, View
from resample.painting.choices import Footprint, Opacity, Primitive
from resample.profiles.orders import EverySample, ImageSheets
from resample.profiles.reconstruction import BSplineKernel
from resample.resampler import Resampler
from resample_volume.baselines.painting import AxisSheets

PLACES = ("all splats", "mixed", "all points")
DEFAULT = "default"
SPLAT_COLOR = (0.8, 0.02, 0.02)


@dataclass(frozen=True)
class Mode:
    """Options that differ from the default, and the allowed ratio of CPU times."""

    form: Resampler = field(default_factory=Resampler)
    most: float | None = None  # target where all samples are splats


MODES: Mapping[str, Mode] = {
    DEFAULT: Mode(),
    "kernel bspline": Mode(Resampler(reconstruction=BSplineKernel()), 2.0),
    "opacity linear": Mode(Resampler(opacity=Opacity.LINEAR), 2.0),
    "splats colored": Mode(Resampler(splat_color=SPLAT_COLOR), 2.0),
    "order by distance": Mode(Resampler(order=EverySample(key="distance")), 2.0),
    "footprint corrected": Mode(Resampler(footprint=Footprint.CORRECTED), 2.0),
    "footprint affine": Mode(Resampler(footprint=Footprint.AFFINE), 2.0),
    "footprint disc": Mode(Resampler(footprint=Footprint.DISC)),
    "inflate": Mode(Resampler(primitive=Primitive.INFLATE)),
    "ewa": Mode(Resampler(primitive=Primitive.EWA)),
    "the paper's form": Mode(Resampler(primitive=Primitive.PAPER), 2.5),
    "axis-sheets": Mode(Resampler(order=AxisSheets()), 2.0),
    "image-sheets": Mode(Resampler(order=ImageSheets()), 3.0),
}


def sections(options: Options) -> Iterator[Section]:
    """A table for each distance of the Engine."""
    side = 48 if options.quick else options.sides[0]
    for place in PLACES:
        view = View("engine", place, side, PAPER_OPACITY, options)
        samples = view.samples
        runs: dict[str, Run] = {
            name: partial(view.paint, mode.form, samples) for name, mode in MODES.items()
        }
        times = take_turns(runs, options.rounds, clock=time.process_time, patience=30.0)
        text = f"Engine, {side} × {side}, opacity {PAPER_OPACITY}; CPU time of all threads."
        yield Section(f"Modes: {place}", text, _rows(times, has_goals=place == PLACES[0]))


def _rows(times: Mapping[str, list[float]], *, has_goals: bool) -> list[Row]:
    rows: list[Row] = []
    for name, seconds in times.items():
        share, most = ratio(seconds, times[DEFAULT]), MODES[name].most if has_goals else None
        row: Row = {"": name, "CPU ms": Spread.of(seconds).times(1000), "ratio": share}
        if most is not None:
            row |= {"target": f"≤ {most:g}", "met": "yes" if share.median <= most else "no"}
        rows.append(row)
    return rows
