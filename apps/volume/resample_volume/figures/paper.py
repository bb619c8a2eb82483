"""The paper's Figures 1 to 4 and 7 to 9 remade, each as pictures with their numbers.

Figures 5 and 6 are made by `resample-texture figures` and `resample-warp3d figures`.
"""

from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path

# Modules with a function `make`, imported when their figure is made.
FIGURES = {
    "1-2": "schematic",
    "3-4": "footprints",
    "7": "popping",
    "8": "gallery",
    "9": "timing",
}
PARTS = {"1": "1-2", "2": "1-2", "3": "3-4", "4": "3-4"}


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
    What is to be said about them: counts and times, and what was not to be had.
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
    from resample_volume.figures.data import VolumeFolder

    shelf = VolumeFolder(data)
    folder.mkdir(parents=True, exist_ok=True)
    for figure in chosen:
        module = import_module(f"resample_volume.figures.{FIGURES[figure]}")
        yield module.make(folder, shelf, quick=quick)
