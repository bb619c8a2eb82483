"""Write figures and their numbers atomically."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from resample.files.writing import replacing, write_json

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 120

Row = Mapping[str, object]


def drawing(width: float, height: float) -> "Figure":
    """Return an empty figure of this size in inches, for `save`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure((width, height), dpi=DPI, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save(figure: "Figure", path: Path) -> None:
    """Write a figure as PNG.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    with replacing(path) as temporary:
        figure.savefig(temporary, format="png", dpi=DPI)


def write_numbers(folder: Path, name: str, rows: Sequence[Row], facts: Mapping[str, Any]) -> None:
    """Write the numbers of a figure.

    Parameters
    ----------
    rows
        Columns are all keys in the order in which they first occur; None is left empty.
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
