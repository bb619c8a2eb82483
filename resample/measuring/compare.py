"""Comparison of several renderings: tables of numbers and labelled sheets of pictures."""

import math
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from resample.colors import Background, as_levels, over, to_srgb
from resample.files.pictures import read_picture
from resample.files.writing import replacing
from resample.measuring.quality import measure
from resample.messages import visible
from resample.types import Floats

if TYPE_CHECKING:
    from rich.table import Table

DPI = 100
MARGIN = 12  # px around each picture
LINE = 16  # px per line of text
SMALLEST = 192  # px; narrower pictures are enlarged
RUNS = 5  # per timing; their median is the time
PATIENCE = 2.0  # seconds for all runs

Row = Mapping[str, object]


def shown(image: Floats, background: Background = (0.0, 0.0, 0.0)) -> Floats:
    """Convert a picture to display colors.

    `image`: (H, W, C) linear light: gray, RGB, or premultiplied with alpha as channel 2 or 4.
    `background`: background, 3 values of linear light. Result: (H, W, 3) sRGB-encoded, 0..1.
    """
    channels = image.shape[2]
    if channels in (1, 2):
        image = image[..., [0, 0, 0] if channels == 1 else [0, 0, 0, 1]]
    color = over(image, background) if image.shape[2] == 4 else image[..., :3]
    return to_srgb(np.clip(color, 0.0, 1.0))


def milliseconds(run: Callable[[], object], runs: int = RUNS, patience: float = PATIENCE) -> float:
    """Median time of runs; after `patience` seconds no new run begins."""
    duration: list[float] = []
    begin = time.perf_counter()
    while not duration or (len(duration) < runs and time.perf_counter() - begin < patience):
        start = time.perf_counter()
        run()
        duration.append(1000.0 * (time.perf_counter() - start))
    return statistics.median(duration)


def plain_name(method: str) -> str:
    """Name without characters that files may not have."""
    return "".join(letter if letter.isalnum() else "-" for letter in method)


def measure_files(
    paths: Sequence[str | Path], reference: str | Path
) -> tuple[list[dict[str, object]], dict[str, Floats]]:
    """Compare files with a reference file.

    Result: a row of `resample.measuring.quality.measure` for each file, computed on the displayed
    pictures, and the pictures as read, reference first; both by file name.
    """
    target = read_picture(reference).data
    pictures, rows = {str(reference): target}, []
    for path in paths:
        picture = pictures[str(path)] = read_picture(path).data
        if picture.shape[:2] != target.shape[:2]:
            raise ValueError(f"{path} is {_size(picture)} px, {reference} is {_size(target)} px")
        rows.append({"picture": str(path), **measure(shown(picture), shown(target))})
    return rows, pictures


def table(rows: Sequence[Row]) -> "Table":
    """Table for a terminal, with a column per key of the first row."""
    from rich.table import Table
    from rich.text import Text

    grid = Table()
    for key in rows[0] if rows else ():
        grid.add_column(Text(key), justify="left" if isinstance(rows[0][key], str) else "right")
    for row in rows:
        grid.add_row(*(Text(_text(value)) for value in row.values()))
    return grid


def plain(rows: Sequence[Row]) -> str:
    """Table for a file: aligned columns, one per key of the first row."""
    if not rows:
        return ""
    lines = [list(rows[0]), *([_text(value) for value in row.values()] for row in rows)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        + "\n"
        for line in lines
    )


def check_sheet(path: str | Path) -> None:
    """Reject a name that `contact_sheet` would reject, before any work is done."""
    if Path(path).suffix.lower() != ".png":
        raise ValueError(f"{path}: contact sheets are written as .png")


def contact_sheet(
    images: Mapping[str, Floats],
    path: str | Path,
    *,
    columns: int | None = None,
    captions: Mapping[str, str] | None = None,
    zoom: int | None = None,
) -> None:
    """Write pictures with their titles to one PNG, each pixel enlarged to a square.

    `images`: (H, W, 3) or premultiplied (H, W, 4), linear light, by title; shown over black.
    `columns`: pictures per row; None: chosen automatically. `zoom`: side of a pixel's square; None
    enlarges small pictures to `SMALLEST` px or more.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    if not images:
        raise ValueError("a contact sheet needs at least one picture")
    check_sheet(path)
    for name, number in (("columns", columns), ("zoom", zoom)):
        if number is not None and number < 1:
            raise ValueError(f"{name} is a positive number, not {number}")
    height, width = (max(image.shape[axis] for image in images.values()) for axis in (0, 1))
    zoom, count = zoom or max(1, math.ceil(SMALLEST / width)), len(images)
    columns = min(columns or (count if count <= 4 else math.ceil(math.sqrt(count))), count)
    rows = math.ceil(count / columns)
    # Each cell has a line of text above the picture and one below.
    wide, high = width * zoom + MARGIN, height * zoom + 2 * LINE + MARGIN
    whole = MARGIN + columns * wide, MARGIN + rows * high
    figure = Figure((whole[0] / DPI, whole[1] / DPI), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    room = max(4, int(width * zoom / 6.5))  # characters of 10 px type
    for cell, (title, image) in enumerate(images.items()):
        left, top = MARGIN + cell % columns * wide, MARGIN + LINE + cell // columns * high
        pixels = np.repeat(np.repeat(as_levels(shown(image)), zoom, 0), zoom, 1)
        figure.figimage(pixels, left, whole[1] - top - pixels.shape[0])
        caption = (captions or {}).get(title, "")
        for row, told in ((top - LINE, title), (top + height * zoom, caption)):
            text = visible(told)
            short = text if len(text) <= room else "…" + text[1 - room :]
            x, y = left / whole[0], 1 - (row + 2) / whole[1]
            figure.text(x, y, short, fontsize=7.5, va="top", parse_math=False)
    with replacing(path) as temporary:
        figure.savefig(temporary, format="png", dpi=DPI)


def enlarged(detail: Floats, side: int) -> Floats:
    """Enlarge each pixel of a detail to a square; as large as fits into `side`."""
    zoom = max(1, side // max(detail.shape[:2]))
    return np.repeat(np.repeat(detail, zoom, 0), zoom, 1)


def _size(picture: NDArray[Any]) -> str:
    return f"{picture.shape[1]} × {picture.shape[0]}"


def _text(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def write_screen(path: Path, screen: Floats) -> None:
    """Write display colors (H, W, 3), 0..1, as a PNG."""
    from PIL import Image

    with replacing(path) as temporary:
        Image.fromarray(as_levels(screen)).save(temporary, format="PNG")
