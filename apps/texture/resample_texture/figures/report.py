"""Write a comparison as one self-contained HTML page."""

import base64
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from resample.colors import as_levels
from resample.files.writing import replacing
from resample_texture.figures.compare import PictureComparison, Screen

TEMPLATE = Path(__file__).with_name("report.html.j2")
BEST = {"psnr": max, "ssim": max, "flip": min, "ms": min}
FORMATS = {"psnr": "{:.2f}", "ssim": "{:.4f}", "flip": "{:.4f}", "ms": "{:.1f}"}
MEASURES = ("psnr", "ssim", "flip")


def write_report(comparison: PictureComparison, path: Path, *, about: Mapping[str, str]) -> None:
    """Write a page with the table, a slider between two pictures, and enlarged details."""
    with replacing(path) as temporary:
        html = page(comparison, about=about)
        temporary.write_text(html, encoding="utf-8", errors="backslashreplace")


def page(comparison: PictureComparison, *, about: Mapping[str, str]) -> str:
    """Return the page's HTML, with all texts escaped."""
    from jinja2 import Environment, StrictUndefined

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    template = environment.from_string(TEMPLATE.read_text(encoding="utf-8"))
    height, width = next(iter(comparison.screens.values())).shape[:2]
    return template.render(
        title=comparison.title,
        about=about,
        pictures={name: data_uri(screen) for name, screen in comparison.screens.items()},
        size={"width": width, "height": height},
        details=_details(comparison),
        zones=list(comparison.zones),
        measures=MEASURES,
        lines=_lines(comparison),
        truth=comparison.truth,
    )


def data_uri(screen: Screen) -> str:
    """Return a picture as a data URI with a PNG."""
    import cv2

    _, png = cv2.imencode(".png", as_levels(screen[..., ::-1]))
    return "data:image/png;base64," + base64.b64encode(png.tobytes()).decode("ascii")


def _details(comparison: PictureComparison) -> list[dict[str, Any]]:
    """Return the position of each zone's detail for the page's script and style."""
    return [
        {"zone": zone, "top": rows.start, "left": columns.start, "side": rows.stop - rows.start}
        for zone, (rows, columns) in comparison.details().items()
    ]


def _lines(comparison: PictureComparison) -> list[dict[str, Any]]:
    """Return one table row per method: cells with their text and whether they are best."""
    cell = {(row["zone"], row["method"]): row for row in comparison.rows}
    lines = []
    for method in comparison.methods:
        cells = [
            _cell(comparison, cell[zone, method], measure)
            for zone in comparison.zones
            for measure in MEASURES
        ]
        duration = _cell(comparison, cell["whole", method], "ms")
        lines.append({"method": method, "ms": duration, "cells": cells})
    return lines


def _cell(comparison: PictureComparison, row: dict[str, Any], measure: str) -> dict[str, Any]:
    rivals: list[Any] = [
        other[measure] for other in comparison.rows if other["zone"] == row["zone"]
    ]
    value = row[measure]
    text = "equal" if value == math.inf else FORMATS[measure].format(value)
    return {"text": text, "is_best": value == BEST[measure](rivals)}
