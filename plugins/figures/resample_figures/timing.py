"""Figure 9: how long volumes take as splats, as points and mixed, beside the paper and others."""

import math
import os
import platform
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np

from resample.cameras.models import AnyCamera, Camera
from resample.cameras.viewpoints import Orbit, Sphere
from resample.hybrid.record import NOTHING, SPLAT
from resample.measuring.compare import milliseconds, plain
from resample.painting.choices import Primitive
from resample.painting.scenes import spacing_of
from resample.resampler import Resampler
from resample.types import Floats, Samples
from resample_comparisons.volume.painting import AxisSheets, ImageSheets
from resample_comparisons.volume.peers import Peer, VtkRenderer
from resample_figures.volumes import (
    FigureVolume,
    Row,
    VolumeFolder,
    drawing,
    missing,
    save,
    write_numbers,
)
from resample_volume.appearance import Appearance
from resample_volume.classification.presets import load_transfer
from resample_volume.classification.transfer import TransferFunction, from_points
from resample_volume.files.source import generate
from resample_volume.rendering import visible_voxels
from resample_volume.types import Volume
from resample_volume.voxels.framing import centered, sphere_around

NAME = "figure-9"
THRESHOLD = 1.0  # px, the paper's
NEAREST, FARTHEST = 3.5, 1e-3  # zooms between which views are looked for
CLOSE, DISTANT = 1.02, 0.4  # px: smallest spacing in the close view, median one in the distant
HUGE = 1 << 14  # px, side of a frame in which nothing is out of sight
SOME = 20_000  # samples from which views are found
SKULL_VOXELS = 775_985
WHITE, OPACITY = (1.0, 1.0, 1.0), 0.3


class PaperSeconds(NamedTuple):
    """What the paper's Figure 9 says of a volume; P4 at 1.7 GHz, 400 × 400 px."""

    voxels: int  # that are not transparent
    splats: float  # s, where all are splats
    mixed: float  # s
    share: float  # of splats in the mixed view
    points: float  # s, where all are points


PAPER = {
    "engine": PaperSeconds(1_160_038, 15.83, 9.76, 0.5673, 1.59),
    "lobster": PaperSeconds(190_815, 3.18, 1.97, 0.4820, 1.52),
    "aneurism": PaperSeconds(114_695, 3.78, 3.36, 0.7638, 2.67),
    "skull": PaperSeconds(SKULL_VOXELS, 10.39, 9.29, 0.8874, 4.87),
    "checker-box": PaperSeconds(1_000_000, 20.48, 6.72, 0.4660, 2.78),
}


@dataclass(frozen=True)
class Effort:
    """How much is measured."""

    side: int = 400  # px
    frames: int = 5  # medians of so many, after one that is not counted
    baseline_frames: int = 3
    box: str = "checker-box:size=100,block=10"


QUICK = Effort(24, 1, 1, "checker-box:size=8,block=2")


@dataclass(frozen=True)
class Case:
    """A volume with samples near to and far from a camera."""

    name: str  # one of `PAPER`
    subject: FigureVolume
    volume: Volume  # around the origin
    transfer: TransferFunction
    samples: Samples
    sphere: Sphere

    def camera(self, zoom: float, side: int) -> AnyCamera:
        """Camera for a square picture."""
        return Orbit(zoom=zoom).around(self.sphere, side, side)

    def spacing(self, zoom: float, side: int) -> Floats:
        """Spacing on screen of some samples, px, also of those out of sight."""
        count = len(self.samples.position)
        chosen = np.random.default_rng(7).choice(count, min(count, SOME), replace=False)
        some = self.samples._replace(
            position=self.samples.position[chosen],
            color=self.samples.color[chosen],
            extinction=self.samples.extinction[chosen],
        )
        view = self.camera(zoom, side).view()
        focal, pose = float(view.focal[0]), np.column_stack([view.rotation, view.translation])
        wide = Camera.from_intrinsics(focal, focal, HUGE / 2, HUGE / 2, pose)
        return spacing_of(wide.view(), some)


_PAPER_FORM = Resampler(primitive=Primitive.PAPER, threshold=THRESHOLD)
_HYBRID = Resampler()


BASELINES = {
    "inflate": Resampler(primitive=Primitive.INFLATE),
    "ewa": Resampler(primitive=Primitive.EWA),
    "axis-sheets": Resampler(order=AxisSheets()),
    "image-sheets": Resampler(order=ImageSheets()),
}


def make(folder: Path, shelf: VolumeFolder, *, quick: bool = False) -> str:
    """Write the figure; returns the table and the remarks about it."""
    choices = QUICK if quick else Effort()
    rows: list[Row] = []
    remarks: list[str] = []
    for name in PAPER:
        case = case_of(name, shelf, choices)
        if case is None:
            remarks.append(f"{missing(name)}; its lines are left out")
            continue
        if case.subject.note:
            remarks.append(case.subject.note)
        rows += measured(case, choices, remarks)
    remarks = list(dict.fromkeys(remarks))
    facts: dict[str, Any] = {
        "figure": "9",
        "side_px": choices.side,
        "machine": machine(),
        "frames": choices.frames,
        "measure": "median milliseconds of warm frames, unlit, without classification",
        "paper_machine": "1.7 GHz Pentium 4, 2003",
        "notes": remarks,
    }
    write_numbers(folder, NAME, rows, facts)
    table = [_line(row) for row in rows]
    _draw(folder / f"{NAME}.png", table, facts)
    return "\n".join(["figure 9: milliseconds on " + machine(), plain(table).rstrip(), *remarks])


def case_of(name: str, shelf: VolumeFolder, choices: Effort) -> Case | None:
    """Volume with the paper's visible voxels, all of opacity `OPACITY`; None where it is missing.

    The Checker Box has the opacity 1. Of the Skull, whose least value the paper does not tell, and
    of what stands in for it, the least value is that which comes nearest to the paper's count.
    """
    if name == "checker-box":
        box = generate(choices.box)
        subject: FigureVolume | None = FigureVolume(box, choices.box, "Checker Box", "")
    else:
        subject = shelf.subject(name)
    if subject is None:
        return None
    volume, _ = centered(subject.volume)
    transfer = _transfer(name, volume)
    voxels = visible_voxels(volume, Appearance(transfer, light=None))
    samples = Samples(voxels.position, voxels.color, voxels.extinction, voxels.lattice)
    return Case(name, subject, volume, transfer, samples, sphere_around(voxels, volume))


def _transfer(name: str, volume: Volume) -> TransferFunction:
    if name == "skull":
        least = least_value(volume, SKULL_VOXELS)
        return from_points([(least, WHITE, 0.0), (least, WHITE, OPACITY)])
    preset = "checker" if name == "checker-box" else f"paper-{name}"
    return cast(TransferFunction, load_transfer(preset))


def least_value(volume: Volume, count: int) -> float:
    """Value from which on there are as nearly `count` voxels as can be."""
    value, number = np.unique(volume.values, return_counts=True)
    from_here = np.cumsum(number[::-1])[::-1]
    return float(value[np.argmin(np.abs(from_here - count))])


def zooms(case: Case, side: int) -> dict[str, float]:
    """Zoom of each view: all splats, as large a share of them as in the paper, and none."""
    share = PAPER[case.name].share

    def lacking(zoom: float) -> float:
        return CLOSE - float(case.spacing(zoom, side).min())

    def mixed(zoom: float) -> float:
        return share - float((case.spacing(zoom, side) > THRESHOLD).mean())

    def distant(zoom: float) -> float:
        return DISTANT - float(np.median(case.spacing(zoom, side)))

    return {
        "all splats": max(1.0, _root(lacking)),
        "mixed": _root(mixed),
        "all points": _root(distant),
    }


def _root(lacking: Callable[[float], float]) -> float:
    """Least zoom from which on nothing is lacking."""
    low, high = FARTHEST, NEAREST
    for _ in range(16):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if lacking(middle) > 0 else (low, middle)
    return high


def measured(case: Case, choices: Effort, remarks: list[str]) -> list[Row]:
    """A row for each of the three views; the remarks explain a missing time of VTK."""
    paper = PAPER[case.name]
    seconds = {"all splats": paper.splats, "mixed": paper.mixed, "all points": paper.points}
    percent = {"all splats": 100.0, "mixed": 100 * paper.share, "all points": 0.0}
    peer = _peer(case, choices.side, remarks)
    rows: list[Row] = []
    for view, zoom in zooms(case, choices.side).items():
        camera = case.camera(zoom, choices.side)
        row: dict[str, object] = {
            "volume": case.subject.title,
            "stands_for": case.name,
            "voxels": len(case.samples.position),
            "paper_voxels": paper.voxels,
            "view": view,
            "zoom": zoom,
            "px_per_voxel": float(np.median(case.spacing(zoom, choices.side))),
            "paper_s": seconds[view],
            "paper_splats_percent": percent[view],
        }
        for label, resample in (("paper_form", _PAPER_FORM), ("hybrid", _HYBRID)):
            row |= _timed(label, resample, case, camera, choices)
        row["paper_form_splats_percent"] = 100 * _share_of_splats(case, camera, choices.side)
        row["speed_up"] = 1000 * seconds[view] / float(str(row["paper_form_ms"]))
        row["vtk_ms"] = None if peer is None else _vtk_milliseconds(peer, camera, choices.frames)
        row |= _baseline_times(case, camera, choices) if view == "mixed" else {}
        rows.append(row)
    return rows


def machine() -> str:
    """What times were taken on."""
    return f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores"


def _timed(
    label: str, resample: Resampler, case: Case, camera: AnyCamera, choices: Effort
) -> dict[str, object]:
    """Milliseconds of a frame, and the share of splats in its samples."""
    run = partial(resample, case.samples, camera, height=choices.side, width=choices.side)
    frame = run()
    return {
        f"{label}_ms": milliseconds(run, choices.frames, math.inf),
        f"{label}_splats_percent": 100 * frame.statistics.splat_fraction,
    }


def _share_of_splats(case: Case, camera: AnyCamera, side: int) -> float:
    """Share of the samples in the picture, also of those that opaque ones hide."""
    records = _PAPER_FORM.footprints(case.samples, camera, height=side, width=side)
    seen = records["kind"] != NOTHING
    return float((records["kind"][seen] == SPLAT).mean()) if seen.any() else 0.0


def _baseline_times(case: Case, camera: AnyCamera, choices: Effort) -> dict[str, object]:
    """Milliseconds of each of `BASELINES`."""
    few = replace(choices, frames=choices.baseline_frames)
    times: dict[str, object] = {}
    for name, resample in BASELINES.items():
        times[f"{name}_ms"] = _timed("rival", resample, case, camera, few)["rival_ms"]
    return times


def _peer(case: Case, side: int, remarks: list[str]) -> VtkRenderer | None:
    """VTK with the same volume, unlit; where it cannot be had, the remarks say why."""
    try:
        return VtkRenderer(
            case.volume, case.transfer, height=side, width=side, look=Peer(light=None)
        )
    except ValueError as error:
        remarks.append(f"no times of VTK: {error}")
        return None


def _vtk_milliseconds(peer: VtkRenderer, camera: AnyCamera, frames: int) -> float:
    peer.draw(camera)
    return milliseconds(lambda: peer.draw(camera), frames, math.inf)


def _line(row: Row) -> dict[str, str]:
    """Line of the table; rivals are measured in the mixed view alone."""
    return {
        "volume": str(row["volume"]),
        "voxels (paper)": f"{row['voxels']:,} ({row['paper_voxels']:,})",
        "view": str(row["view"]),
        "px/voxel": f"{row['px_per_voxel']:.2f}",
        "paper": f"{row['paper_s']:.2f} s ({row['paper_splats_percent']:.0f} %)",
        "paper's form": _time(row, "paper_form"),
        "times faster": f"{row['speed_up']:.0f}",
        "hybrid": _time(row, "hybrid"),
        "VTK": _number(row["vtk_ms"]),
        **{name: _number(row.get(f"{name}_ms")) for name in BASELINES},
    }


def _time(row: Row, label: str) -> str:
    return f"{row[f'{label}_ms']:.0f} ms ({row[f'{label}_splats_percent']:.0f} %)"


def _number(milliseconds: object) -> str:
    return "" if milliseconds is None else f"{milliseconds:.0f} ms"


def _draw(path: Path, table: Sequence[dict[str, str]], facts: dict[str, Any]) -> None:
    figure = drawing(15, 1.3 + 0.19 * len(table))
    axes = figure.subplots()
    axes.set_axis_off()
    axes.set_title(
        f"Figure 9. {facts['side_px']} x {facts['side_px']} px, {facts['measure']}; "
        f"{facts['machine']}. In brackets: share of splats.",
        fontsize=9,
    )
    if table:
        text = [list(line.values()) for line in table]
        drawn = axes.table(cellText=text, colLabels=list(table[0]), loc="upper center")
        drawn.auto_set_font_size(False)
        drawn.set_fontsize(7.5)
        drawn.auto_set_column_width(list(range(len(table[0]))))
    notes = "\n".join(facts["notes"])
    axes.text(0, 0, notes, fontsize=7.5, va="bottom", transform=axes.transAxes)
    save(figure, path)
