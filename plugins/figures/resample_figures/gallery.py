"""Figure 8: the paper's volumes."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from resample.cameras.viewpoints import Orbit
from resample.console import SPLAT_COLOR
from resample.files.saving import write_png
from resample.measuring.compare import contact_sheet
from resample.painting.choices import Primitive
from resample.resampler import Resampler
from resample.types import Frame
from resample_figures.volumes import FigureVolume, Row, VolumeFolder, missing, write_numbers
from resample_volume.appearance import Appearance
from resample_volume.calls import render
from resample_volume.classification.transfer import from_points
from resample_volume.voxels.shading import Light

NAME = "figure-8"
SIDE, QUICK_SIDE = 400, 32  # px; the paper's, and that of a trial
BLACK = (0.0, 0.0, 0.0)
HYBRID = Resampler(primitive=Primitive.PAPER)
MARKED = Resampler(primitive=Primitive.PAPER, splat_color=SPLAT_COLOR)

TAN, IVORY, CREAM = (0.75, 0.5, 0.35), (0.93, 0.87, 0.75), (1.0, 0.98, 0.95)
STEEL, BRASS = (0.62, 0.7, 0.78), (0.95, 0.68, 0.3)
SHELL, MEAT = (0.85, 0.12, 0.06), (1.0, 0.97, 0.92)


@dataclass(frozen=True)
class Shot:
    """One picture."""

    letter: str
    subject: str  # one of `paper.TITLES`
    caption: str
    orbit: Orbit
    resampler: Resampler = HYBRID

    def light(self) -> Light:
        """Lamp above the viewer's right shoulder."""
        down = -1.0 if self.orbit.up == "-z" else 1.0
        return Light((0.4, -1.0, 0.8 * down), 0.25, 0.75, 0.35, 40.0)


class Taken(NamedTuple):
    """A shot that was taken."""

    shot: Shot
    subject: FigureVolume
    frame: Frame


TRANSFERS = {
    # The least value is that of Figure 9.
    "aneurism": from_points([(25, TAN, 0.0), (25, TAN, 0.3), (80, IVORY, 0.7), (255, CREAM, 0.95)]),
    "engine": from_points(
        [
            (71, STEEL, 0.0),
            (90, STEEL, 0.05),
            (150, STEEL, 0.04),
            (180, BRASS, 0.5),
            (220, BRASS, 0.9),
        ]
    ),
    "lobster": from_points(
        [(34, SHELL, 0.0), (55, SHELL, 0.1), (95, SHELL, 0.3), (120, MEAT, 0.35), (165, MEAT, 0.9)]
    ),
    "skull": from_points([(40, TAN, 0.0), (60, TAN, 0.2), (90, IVORY, 0.7), (160, CREAM, 0.95)]),
    "vis_male": from_points(
        [(84, TAN, 0.0), (94, TAN, 0.2), (110, IVORY, 0.7), (160, CREAM, 0.95)]
    ),
}
SHOTS = (
    Shot("a", "aneurism", "pseudo-colored, splats red", Orbit(20, 10, 0.66), MARKED),
    Shot("b", "aneurism", "distant view", Orbit(20, 10, 0.4)),
    Shot("c", "aneurism", "close view", Orbit(20, 10, 1.4)),
    Shot("d", "engine", "", Orbit(35, 25, 1.0)),
    Shot("e", "skull", "", Orbit(215, 8, 1.1, up="-z")),
    Shot("f", "lobster", "shell red, meat white", Orbit(-35, 62, 1.2)),
)


def make(folder: Path, shelf: VolumeFolder, *, quick: bool = False) -> str:
    """Write the figure; returns the remarks about it."""
    side = QUICK_SIDE if quick else SIDE
    taken = list(_taken(shelf, side))
    for picture in taken:
        path = folder / f"{NAME}{picture.shot.letter}.png"
        write_png(path, picture.frame.rgba, background=BLACK)
    if taken:
        cells = {_title(picture): picture.frame.rgba for picture in taken}
        notes = {_title(picture): _counts(picture.frame) for picture in taken}
        contact_sheet(cells, folder / f"{NAME}.png", columns=3, captions=notes)
    absent = [shot for shot in SHOTS if shot.letter not in {t.shot.letter for t in taken}]
    remarks = [picture.subject.note for picture in taken if picture.subject.note]
    remarks += [f"{missing(shot.subject)}; {NAME}{shot.letter} is left out" for shot in absent]
    remarks = list(dict.fromkeys(remarks))
    facts = {"figure": "8", "side_px": side, "notes": remarks}
    write_numbers(folder, NAME, [_row(picture) for picture in taken], facts)
    return "\n".join([f"figure 8: {len(taken)} of {len(SHOTS)} pictures", *remarks])


def _taken(shelf: VolumeFolder, side: int) -> Iterator[Taken]:
    """Pictures of all volumes that are there."""
    subjects: dict[str, FigureVolume | None] = {}
    for shot in SHOTS:
        if shot.subject not in subjects:
            subjects = {shot.subject: shelf.subject(shot.subject)}  # one at a time in memory
        subject = subjects[shot.subject]
        if subject is not None:
            yield Taken(shot, subject, _picture(shot, subject, side))


def _picture(shot: Shot, subject: FigureVolume, side: int) -> Frame:
    transfer = TRANSFERS.get(subject.name, TRANSFERS[shot.subject])
    look = Appearance(transfer, shot.light())
    return render(subject.volume, look, shot.orbit, size=(side, side), resampler=shot.resampler)


def _title(picture: Taken) -> str:
    parts = [picture.subject.title, picture.shot.caption]
    return f"({picture.shot.letter}) {', '.join(filter(None, parts))}"


def _counts(frame: Frame) -> str:
    return f"{frame.statistics.splats} splats, {frame.statistics.points} points"


def _row(picture: Taken) -> Row:
    statistics, orbit = picture.frame.statistics, picture.shot.orbit
    return {
        "picture": f"{NAME}{picture.shot.letter}.png",
        "volume": picture.subject.name,
        "stands_for": picture.shot.subject,
        "caption": picture.shot.caption,
        "primitive": str(picture.shot.resampler.primitive),
        "azimuth_deg": orbit.azimuth,
        "elevation_deg": orbit.elevation,
        "zoom": orbit.zoom,
        "samples": statistics.samples,
        "points": statistics.points,
        "splats": statistics.splats,
        "ms": 1000 * sum(statistics.seconds.values()),
    }
