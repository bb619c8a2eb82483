"""The paper's Figure 6 remade: a depth image, and a view of it by the hybrid and by McMillan."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from resample.colors import from_srgb
from resample.files.writing import write_json
from resample.measuring.compare import contact_sheet, enlarged, plain_name, shown, write_screen
from resample_comparisons.warp3d.compare import (
    TRUTH,
    DepthComparison,
    Row,
    WarpCase,
    busiest,
    check_views,
    compare_cases,
    scene_case,
)
from resample_comparisons.warp3d.expected import edges_in_view, expected_nearness
from resample_comparisons.warp3d.scenes import generated
from resample_comparisons.warp3d.scoring import ScoringTarget, Screen
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.types import Equation, Source

METHODS = ("paper", "mcmillan")
VIEW = "oblique"
SHEET = "figure-6.png"
NUMBERS = "figure-6.json"
MARK = (0.95, 0.1, 0.1)  # sRGB, the frame around the marked region
THICKNESS = 2  # px
LETTERS = "bcdefghijklmnopqrstuvwxyz"
PARTS = 7  # the marked region's side is this part of the frame's shorter side


@dataclass(frozen=True)
class Figure:
    """What Figure 6 shows; all pictures as a screen shows them."""

    reference: Screen  # the depth image's colors
    pictures: dict[str, Screen]  # by method; the truth, where it is known, comes first
    notes: dict[str, str]  # what pictures are worth
    region: tuple[slice, slice]  # that is enlarged
    rows: list[Row]  # numbers, by method


def generated_figure(size: int = 512, view: str = VIEW, methods: Sequence[str] = METHODS) -> Figure:
    """Figure of the generated scene, with the true view.

    `size`: height and width, px. `methods`: by name; the paper has two.
    """
    check_views([view])
    scene = generated(size)
    case = scene_case(scene, view, prepare(scene.depth_image()))
    comparison = compare_cases([case], methods)
    return _figure(case, comparison, comparison.pictures[view])


def figure_of(
    source: Source,
    equation: Equation,
    shape: tuple[int, int],
    methods: Sequence[str] = METHODS,
) -> Figure:
    """Figure of any depth image, without a truth: only holes and times are measured.

    `source`: prepared depth image, linear light. `shape`: its height and width, px.
    """
    mask = expected_nearness(source, equation, shape) > 0
    if not mask.any():
        raise ValueError("the view shows nothing of the depth image; check pose and intrinsics")
    target = ScoringTarget(np.zeros((*shape, 3)), mask, edges_in_view(source, equation, shape))
    case = WarpCase("view", source, equation, target)
    comparison = compare_cases([case], methods)
    rows = [{key: row[key] for key in ("method", "hole %", "ms")} for row in comparison.rows]
    pictures = {
        name: screen for name, screen in comparison.pictures["view"].items() if name != TRUTH
    }
    return _figure(case, DepthComparison(rows, {}, {}), pictures)


def write_figures(folder: Path, figure: Figure) -> dict[str, object]:
    """Write the figure, each of its pictures, and its numbers.

    `figure`: what is written: `figure-6.png` with captions, `figure-6.json`, and every picture 1 :
    1 as `reference.png`, `METHOD.png` and `METHOD-zoom.png`. Result: what the JSON file holds.
    """
    write_screen(folder / "reference.png", figure.reference)
    for name, screen in figure.pictures.items():
        write_screen(folder / f"{plain_name(name)}.png", screen)
        write_screen(folder / f"{plain_name(name)}-zoom.png", _zoomed(figure, screen))
    _write_sheet(folder / SHEET, figure)
    rows, columns = figure.region
    numbers: dict[str, object] = {
        "region": {
            "left": columns.start,
            "top": rows.start,
            "width": columns.stop - columns.start,
            "height": rows.stop - rows.start,
        },
        "methods": figure.rows,
    }
    write_json(folder / NUMBERS, numbers)
    return numbers


def _figure(case: WarpCase, comparison: DepthComparison, pictures: dict[str, Screen]) -> Figure:
    """Figure with the region where methods differ most."""
    warped = [screen for name, screen in pictures.items() if name != TRUTH]
    behind = case.target.truth if TRUTH in pictures else np.mean(warped, axis=0)
    errors = [np.asarray(np.abs(screen - behind).mean(axis=2), np.float32) for screen in warped]
    side = max(8, min(case.target.mask.shape) // PARTS)
    rows = [{key: value for key, value in row.items() if key != "view"} for row in comparison.rows]
    notes = {str(row["method"]): _note(row) for row in rows}
    reference = shown(case.source.color)
    return Figure(reference, pictures, notes, busiest(errors, case.target, side), rows)


def _note(row: Mapping[str, object]) -> str:
    quality = f"{row['psnr']:.2f} dB, " if "psnr" in row else ""
    return f"{quality}{row['hole %']:.2f} % holes"


def _write_sheet(path: Path, figure: Figure) -> None:
    """Whole pictures in a line, and below them the marked region, first as it really looks."""
    methods = [name for name in figure.pictures if name != TRUTH]
    cells: dict[str, Screen] = {"(a) reference image": figure.reference}
    captions: dict[str, str] = {}
    for name, letter in zip(methods, LETTERS[::2], strict=False):
        title = f"({letter}) {name}"
        cells[title] = _marked(figure.pictures[name], figure.region)
        captions[title] = figure.notes[name]
    truth = figure.pictures.get(TRUTH)
    if truth is None:
        cells[""] = np.ones_like(figure.reference)
    else:
        cells["marked region of the true view"] = _zoomed(figure, truth)
    for name, letter in zip(methods, LETTERS[1::2], strict=False):
        cells[f"({letter}) marked region of {name}"] = _zoomed(figure, figure.pictures[name])
    light = {title: from_srgb(np.asarray(cell, np.float32)) for title, cell in cells.items()}
    contact_sheet(light, path, columns=1 + len(methods), captions=captions)


def _marked(screen: Screen, region: tuple[slice, slice]) -> Screen:
    """Picture with a frame around a region."""
    rows, columns = region
    outer = (_grown(rows, screen.shape[0]), _grown(columns, screen.shape[1]))
    marked = np.array(screen)
    marked[outer] = MARK
    marked[region] = screen[region]
    return marked


def _grown(part: slice, length: int) -> slice:
    return slice(max(0, part.start - THICKNESS), min(length, part.stop + THICKNESS))


def _zoomed(figure: Figure, screen: Screen) -> Screen:
    return enlarged(screen[figure.region], min(figure.reference.shape[:2]))
