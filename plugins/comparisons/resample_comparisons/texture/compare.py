"""Compare methods on one view of a picture, measured against the truth; write an HTML page."""

import base64
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from resample import registry
from resample.colors import as_levels, from_srgb, to_srgb
from resample.console import progress_bar
from resample.engine.jit import threads
from resample.files.writing import replacing
from resample.measuring.compare import contact_sheet, enlarged, milliseconds, shown
from resample.measuring.quality import flip, psnr, ssim
from resample.types import Floats
from resample_comparisons.texture import scenes
from resample_comparisons.texture.scenes import ComparedView, Mask
from resample_texture.types import Edge, Method

Row = dict[str, object]
Screen = Floats  # (H, W, 3) sRGB-encoded, 0..1, as a screen shows it

CROP = 64  # px, side of a detail
TEMPLATE = Path(__file__).with_name("report.html.j2")
BEST = {"psnr": max, "ssim": max, "flip": min, "ms": min}
FORMATS = {"psnr": "{:.2f}", "ssim": "{:.4f}", "flip": "{:.4f}", "ms": "{:.1f}"}
MEASURES = ("psnr", "ssim", "flip")


@dataclass(frozen=True)
class PictureComparison:
    """Pictures of one scene by several methods, and their errors."""

    title: str
    screens: dict[str, Screen]  # the truth first, then the methods
    zones: dict[str, Mask]
    rows: list[Row]  # one for each zone and method

    @property
    def methods(self) -> list[str]:
        return list(self.screens)[1:]

    @property
    def truth(self) -> str:
        return next(iter(self.screens))

    def details(self) -> dict[str, tuple[slice, slice]]:
        """Return the most detailed square of every zone except the whole."""
        truth = self.screens[self.truth]
        masks = {name: mask for name, mask in self.zones.items() if name != "whole"}
        return {name: _busiest(truth, mask) for name, mask in masks.items()}


@dataclass(frozen=True)
class Judge:
    """Settings of a comparison: filter of the truth, edge mode, values."""

    kind: str = "box"  # pixel filter of the truth: box or gaussian
    # Edge mode for the methods; pixels that it affects are not measured.
    edge: Edge = Edge.TRANSPARENT
    linear: bool = True  # True: values are linear light; false: sRGB-encoded

    def compare(self, title: str, scene: ComparedView, names: Sequence[str]) -> PictureComparison:
        """Measure methods by name in a scene.

        Raises ValueError, LookupError: a method is unknown or refuses its parameters or the scene.
        """
        methods = {name: registry.build("methods", name) for name in names}
        masks = scenes.zones(scene)
        with progress_bar("casting rays") as progress:
            target = self._screen(scenes.truth(scene, self.kind, progress))
        screens = {f"truth, {scenes.RAYS} x {scenes.RAYS} rays": target}
        milliseconds = {}
        with progress_bar("warping") as progress:
            for n, (name, method) in enumerate(methods.items()):
                image, milliseconds[name] = timed(method, scene, self.edge)
                screens[name] = self._screen(image)
                if progress is not None:
                    progress((n + 1) / len(methods))
        rows = [
            {"zone": zone, "method": name, **measured(screens[name], target, mask), "ms": duration}
            for zone, mask in masks.items()
            for name, duration in milliseconds.items()
        ]
        return PictureComparison(title, screens, masks, rows)

    def about(self, scene: ComparedView) -> dict[str, str]:
        """Describe the comparison for the reader."""
        height, width = scene.shape
        rows, columns, channels = scene.source.shape
        kind = {"box": "area", "gaussian": "Gaussian of 0.5 px"}[self.kind]
        seen = "spline of degree 4 with the texels as means"
        if scene.fine is not None:
            seen = f"picture {scene.fine.shape[0] // rows} times as fine"
        values = "linear light" if self.linear else "values as they are encoded"
        return {
            "view": f"{columns} x {rows} texels of {channels} to {width} x {height} pixels",
            "truth": f"{scenes.RAYS} x {scenes.RAYS} rays per pixel, {seen}, {kind}",
            "filtered": values,
            "edge": str(self.edge),
        }

    def _screen(self, image: Floats) -> Screen:
        if self.linear:
            return shown(image)
        return np.clip(image[..., [0, 0, 0]] if image.shape[2] == 1 else image, 0.0, 1.0)


def timed(method: Method, scene: ComparedView, edge: Edge) -> tuple[Floats, float]:
    """Return a method's picture, and the median time of several warm runs in ms."""

    def run() -> Floats:
        return method(scene.source, scene.geometry, scene.shape, edge).image

    with threads(None):
        return run(), milliseconds(run)


def measured(screen: Screen, truth: Screen, mask: Mask) -> dict[str, float]:
    """Return PSNR in dB, SSIM and FLIP of a zone's pixels.

    SSIM and FLIP compare neighbourhoods: they are computed on a picture that equals the truth
    outside the zone, and their error is divided by the zone's share of the pixels.
    """
    share = float(mask.mean())
    alone = np.where(mask[..., None], screen, truth)
    return {
        "psnr": psnr(screen, truth, mask=mask),
        "ssim": 1.0 - (1.0 - ssim(alone, truth)) / share,
        "flip": flip(alone, truth) / share,
    }


def sheet(comparison: PictureComparison, path: Path, zoom: int | None = None) -> None:
    """Write one PNG of the pictures and enlarged details, a row per method."""
    pictures, captions = {}, {}
    details = comparison.details()
    for name, screen in comparison.screens.items():
        pictures[name] = screen
        captions[name] = note(comparison, name, "whole")
        for zone, part in details.items():
            title = f"{name}: {zone}"
            pictures[title] = enlarged(screen[part], min(screen.shape[:2]))
            captions[title] = note(comparison, name, zone)
    light = {title: from_srgb(picture) for title, picture in pictures.items()}
    contact_sheet(light, path, columns=1 + len(details), captions=captions, zoom=zoom)


def note(comparison: PictureComparison, method: str, zone: str) -> str:
    """Return the caption of a zone: PSNR and time; empty for the truth."""
    for row in comparison.rows:
        if (row["method"], row["zone"]) == (method, zone):
            time_taken = f", {row['ms']:.1f} ms" if zone == "whole" else ""
            return f"{row['psnr']:.2f} dB{time_taken}"
    return ""


def source_values(picture: Floats, *, linear: bool) -> Floats:
    """Return the methods' input from linear light: itself, or sRGB-encoded values."""
    return picture if linear else np.ascontiguousarray(to_srgb(picture))


def _busiest(screen: Screen, mask: Mask) -> tuple[slice, slice]:
    """Return the square inside a zone, as far as possible, with the most varying values."""
    side = min(CROP, *mask.shape)
    step = max(1, side // 4)
    places = [
        (slice(top, top + side), slice(left, left + side))
        for top in range(0, mask.shape[0] - side + 1, step)
        for left in range(0, mask.shape[1] - side + 1, step)
    ]
    return max(places, key=lambda place: (mask[place].mean(), screen[place].std()))


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
        details=[
            {"zone": zone, "top": rows.start, "left": columns.start, "side": rows.stop - rows.start}
            for zone, (rows, columns) in comparison.details().items()
        ],
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
