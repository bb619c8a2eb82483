"""The paper's Figures 1 to 4 and 7 to 9 remade: volumes for them, pictures and numbers as files.

Figures 5 and 6 are made by `resample-texture figures` and `resample-warp3d figures`.
"""

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from resample.files.public import place_of
from resample.files.writing import replacing, write_json
from resample_volume.files.source import generate, open_volume
from resample_volume.types import Volume

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SUFFIXES = (".nhdr", ".nrrd", ".mhd", ".mha", ".nii", ".nii.gz")
TITLES = {"engine": "Engine", "lobster": "Lobster", "aneurism": "Aneurism", "skull": "Skull"}
STAND_INS = {"skull": "vis_male", "aneurism": "vessel-tree:size=256"}
# Modules with a function `make`, imported when their figure is made.
FIGURES = {
    "1-2": "schematic",
    "3-4": "footprints",
    "7": "popping",
    "8": "gallery",
    "9": "timing",
}
PARTS = {"1": "1-2", "2": "1-2", "3": "3-4", "4": "3-4"}
DPI = 120

Row = Mapping[str, object]


class FigureVolume(NamedTuple):
    """The volume of a figure."""

    volume: Volume
    name: str  # of the volume; a generated one with its parameters
    title: str  # for captions; names the volume that this one replaces, if any
    note: str  # one-line note for the reader; often empty


@dataclass(frozen=True)
class VolumeFolder:
    """Where volumes are searched: a folder, and the downloads of `files.public.fetch`.

    Raises NotADirectoryError: the folder does not exist.
    """

    folder: Path | None = None  # holds NAME.nhdr, or another of `SUFFIXES`

    def __post_init__(self) -> None:
        if self.folder is not None and not self.folder.is_dir():
            raise NotADirectoryError(f"{self.folder}: there is no such folder of volumes")

    def find(self, name: str) -> Path | None:
        """Return the file of a volume; None if it is in neither place."""
        places = [place for place in (self.folder, place_of(None)) if place is not None]
        files = [place / f"{name}{suffix}" for place in places for suffix in SUFFIXES]
        return next((file for file in files if file.is_file()), None)

    def subject(self, name: str) -> FigureVolume | None:
        """Return one of the paper's volumes or its substitute; None if there is neither."""
        path = self.find(name)
        if path is not None:
            return FigureVolume(open_volume(path), name, TITLES[name], "")
        return self._stand_in(name, STAND_INS[name]) if name in STAND_INS else None

    def _stand_in(self, name: str, other: str) -> FigureVolume | None:
        generated = ":" in other
        path = None if generated else self.find(other)
        if path is None and not generated:
            return None
        volume = generate(other) if path is None else open_volume(path)
        kind = f"the generated {other}" if generated else other
        note = f"{missing(name)}; {kind} stands in for it"
        return FigureVolume(volume, other, f"{other} (for {TITLES[name]})", note)


def missing(name: str) -> str:
    """Return the message that a volume is missing, and how to get it."""
    return (
        f"{TITLES[name]} is not there (give --data a folder with {name}.nhdr, or run "
        f"resample-volume fetch {name})"
    )


def make(
    folder: Path,
    numbers: Sequence[str] | None = None,
    data: Path | None = None,
    *,
    quick: bool = False,
) -> str:
    """Write figures: `figure-NUMBER.png`, `.csv` and `.json`, and single pictures beside them.

    Parameters
    ----------
    numbers
        Which figures: some of `FIGURES`, or 1 to 4 for the halves of two of them; None for all.

    Returns
    -------
    Remarks about them: counts and times, and missing data.
    """
    chosen = chosen_figures(numbers)
    return "\n".join(_made_figures(folder, chosen, data, quick)) + "\n"


def chosen_figures(numbers: Sequence[str] | None) -> list[str]:
    """Figures of `FIGURES` by their numbers, each once, in that order; all for None."""
    if numbers is None:
        return list(FIGURES)
    wanted = [PARTS.get(number, number) for number in numbers]
    for number in wanted:
        if number not in FIGURES:
            raise ValueError(
                f"figure {number!r}; there are {', '.join(FIGURES)} (5: resample-texture figures, "
                "6: resample-warp3d figures)"
            )
    return [figure for figure in FIGURES if figure in wanted]


def _made_figures(
    folder: Path, chosen: Sequence[str], data: Path | None, quick: bool
) -> Iterator[str]:
    shelf = VolumeFolder(data)
    folder.mkdir(parents=True, exist_ok=True)
    for figure in chosen:
        module = import_module(f"resample_figures.{FIGURES[figure]}")
        yield module.make(folder, shelf, quick=quick)


def drawing(width: float, height: float) -> "Figure":
    """Return an empty figure of this size in inches, for `save`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure((width, height), dpi=DPI, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save(figure: "Figure", path: Path) -> None:
    """Write a figure as PNG.

    Raises OSError: the file cannot be written.
    """
    with replacing(path) as temporary:
        figure.savefig(temporary, format="png", dpi=DPI)


def write_numbers(folder: Path, name: str, rows: Sequence[Row], facts: Mapping[str, Any]) -> None:
    """Write the numbers of a figure.

    `rows`: columns are all keys in the order in which they first occur; None is left empty.
    """
    columns = list(dict.fromkeys(key for row in rows for key in row))
    with (
        replacing(folder / f"{name}.csv") as temporary,
        temporary.open("w", newline="", encoding="utf-8") as file,
    ):
        writer = csv.DictWriter(file, columns, restval="")
        writer.writeheader()
        writer.writerows(rows)
    write_json(folder / f"{name}.json", {**facts, "rows": [dict(row) for row in rows]})
