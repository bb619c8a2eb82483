"""The paper's Figure 5 remade: a floor by forward points, by the hybrid, and backward."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from resample.colors import from_srgb
from resample.files.writing import replacing
from resample.measuring.compare import contact_sheet, enlarged, plain, plain_name, write_screen
from resample.types import Floats
from resample_comparisons.texture import scenes
from resample_comparisons.texture.compare import Judge, PictureComparison, note
from resample_comparisons.texture.scenes import scene_of

SCENE = "floor-close"
SHEET = "figure5.png"
TABLE = "table.txt"
FIGURE = {  # the paper's pictures, and good practice
    "points": "(a) points",
    "hybrid": "(b) hybrid",
    "bilinear": "(c) backward, bilinear",
    "paper": "the paper's hybrid",
    "opencv-supersample:n=8": "backward, 8 x 8 cubic",
}


class FloorPicture(NamedTuple):
    """A picture to look at, and the same finer, if it is known."""

    picture: Floats  # (H, W, C), gray or RGB in linear light
    fine: Floats | None = None


def generated(name: str) -> FloorPicture:
    """A checkerboard, or a wall of bricks, as means of a finer picture."""
    side = 1024 * scenes.FINER
    is_checker = name == "checker"
    fine = scenes.checker(side, 8 * scenes.FINER) if is_checker else scenes.bricks(side)
    return FloorPicture(scenes.means(fine), fine)


def compare_floors(
    subjects: Mapping[str, FloorPicture],
    methods: Sequence[str],
    size: tuple[int, int] | None = None,
) -> dict[str, PictureComparison]:
    """Floors of pictures by several methods."""
    judge = Judge()
    return {
        name: judge.compare(name, scene_of(seen.picture, SCENE, size, seen.fine), methods)
        for name, seen in subjects.items()
    }


def write_figures(
    folder: Path,
    comparisons: Mapping[str, PictureComparison],
    titles: Mapping[str, str],
    sheet: str,
) -> str:
    """Write every picture, a sheet of all and a table; returns the table."""
    for subject, comparison in comparisons.items():
        for name, screen in comparison.screens.items():
            method = "truth" if name == comparison.truth else name
            write_screen(folder / f"{subject}-{plain_name(method)}.png", screen)
    _write_sheet(folder / sheet, comparisons, titles)
    rows = [
        {"picture": subject, **row}
        for subject, comparison in comparisons.items()
        for row in comparison.rows
    ]
    table = plain(rows)
    with replacing(folder / TABLE) as temporary:
        temporary.write_text(table, encoding="utf-8", errors="backslashreplace")
    return table


def _write_sheet(
    path: Path, comparisons: Mapping[str, PictureComparison], titles: Mapping[str, str]
) -> None:
    """A line of whole pictures for each subject, and below it lines of enlarged details."""
    cells: dict[str, Floats] = {}
    captions: dict[str, str] = {}
    count = 0
    for subject, comparison in comparisons.items():
        count = len(comparison.methods)
        parts = {"whole": (slice(None), slice(None)), **comparison.details()}
        for zone, part in parts.items():
            if zone == "mixed":
                continue
            for method in comparison.methods:
                where = subject if zone == "whole" else f"{subject}, {zone}"
                title = f"{titles.get(method, method)}: {where}"
                screen = comparison.screens[method]
                cells[title] = from_srgb(enlarged(screen[part], min(screen.shape[:2])))
                captions[title] = note(comparison, method, zone)
    contact_sheet(cells, path, columns=count, captions=captions)
