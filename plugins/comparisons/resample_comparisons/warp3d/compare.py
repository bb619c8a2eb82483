"""Compare methods on views of a depth image, measured against true views."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample import registry
from resample.colors import from_srgb
from resample.console import progress_bar
from resample.measuring.compare import check_sheet, contact_sheet, enlarged, milliseconds, shown
from resample.types import Doubles, Floats
from resample_comparisons.warp3d.expected import edges_in_view, expected_nearness
from resample_comparisons.warp3d.scenes import VIEWPOINTS, ObjectScene, generated
from resample_comparisons.warp3d.scoring import (
    Mask,
    ScoringTarget,
    Screen,
    WarpedScreen,
    delivered,
    near_steps,
    score,
)
from resample_warp3d.depth.equation import between
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.types import Equation, Method, Rendered, Source

Row = dict[str, object]

CROP = 48  # px, side of a detail
WHOLE = 0.999  # share of a pixel's rays that the source must see
SEVERE = 0.2  # larger errors count as this in the choice of details
TRUTH = "truth"


class WarpCase(NamedTuple):
    """A depth image, a view to warp it to, and the true view."""

    name: str
    source: Source
    equation: Equation
    target: ScoringTarget
    is_light: bool = True  # the source's values are linear light, else sRGB-encoded


@dataclass(frozen=True)
class DepthComparison:
    """Pictures of views by several methods, and their errors."""

    # One row for each view and method: `view`, `method`, the measures of `scoring.score` and `ms`.
    rows: list[Row]
    # Pictures as a screen shows them, by view and method; the truth comes first.
    pictures: dict[str, dict[str, Screen]]
    details: dict[str, tuple[slice, slice]]  # the part of each view to enlarge


def compare_scene(
    names: Sequence[str], size: int = 512, views: Sequence[str] = tuple(VIEWPOINTS)
) -> DepthComparison:
    """Compare methods in the generated scene.

    `size`: height and width of all frames, px.
    """
    methods = _built(names)
    check_views(views)
    scene = generated(size)
    with progress_bar("casting rays") as progress:
        source = prepare(scene.depth_image())
        cases = []
        for n, view in enumerate(views):
            if progress is not None:
                progress((n + 1) / (len(views) + 1))
            cases.append(scene_case(scene, view, source))
    return _compare(cases, methods)


def compare_view(
    source: Source,
    equation: Equation,
    truth: Floats,
    mask: Mask | None,
    names: Sequence[str],
) -> DepthComparison:
    """Compare methods with a true view.

    `source`: prepared depth image, linear light. `truth`: (H, W, C) gray or RGB, linear light; with
    opacity it is shown over black. `mask`: (H, W) pixels that both views see. None: the pixels
    where a sample of the source arrives; then surfaces hidden only in the true view are taken for
    visible.
    """
    shape = (truth.shape[0], truth.shape[1])
    if mask is None:
        mask = expected_nearness(source, equation, shape) > 0
    if mask.shape != shape:
        raise ValueError(
            f"a mask of {mask.shape[1]} × {mask.shape[0]} px does not fit a view of "
            f"{shape[1]} × {shape[0]} px"
        )
    if not mask.any():
        raise ValueError("no part of the true view is in the source; check poses and intrinsics")
    target = ScoringTarget(shown(truth), mask, edges_in_view(source, equation, shape))
    return _compare([WarpCase("view", source, equation, target)], _built(names))


def compare_cases(cases: Sequence[WarpCase], names: Sequence[str]) -> DepthComparison:
    """Compare methods in views with known truth; raises as `compare_view` does."""
    return _compare(cases, _built(names))


def scene_case(scene: ObjectScene, view: str, source: Source) -> WarpCase:
    """Return a view of a generated scene; pixels that the source sees fully count."""
    camera, shape = scene.views[view], scene.shape
    truth, _ = scene.render(camera, shape)
    fraction, nearest, farthest = scene.visible(camera, shape, scene.source, shape)
    target = ScoringTarget(shown(truth), fraction > WHOLE, near_steps(nearest, farthest))
    return WarpCase(view, source, between(scene.source, camera), target)


def check_views(views: Sequence[str]) -> None:
    """Reject views that the generated scene does not have."""
    for view in views:
        if view not in VIEWPOINTS:
            raise LookupError(f"unknown view {view!r}; known: {', '.join(VIEWPOINTS)}")
    if not views:
        raise ValueError(f"give views to compare, from {', '.join(VIEWPOINTS)}")


def sheet(comparison: DepthComparison, path: Path, zoom: int | None = None) -> None:
    """Write one PNG of all pictures and enlarged details, two rows per view.

    `zoom`: enlargement of pixels; None enlarges small pictures.
    """
    check_sheet(path)
    cells: dict[str, Screen] = {}
    captions: dict[str, str] = {}
    for view, pictures in comparison.pictures.items():
        for method, screen in pictures.items():
            title = f"{view}: {method}"
            cells[title] = screen
            captions[title] = note(comparison, view, method)
        for method, screen in pictures.items():
            title = f"{view}, detail: {method}"
            cells[title] = enlarged(screen[comparison.details[view]], min(screen.shape[:2]))
            captions[title] = ""
    light = {title: from_srgb(np.asarray(cell, np.float32)) for title, cell in cells.items()}
    columns = max(len(pictures) for pictures in comparison.pictures.values())
    contact_sheet(light, path, columns=columns, captions=captions, zoom=zoom)


def note(comparison: DepthComparison, view: str, method: str) -> str:
    """Return the caption of a picture: PSNR, holes and time; empty for the truth."""
    for row in comparison.rows:
        if (row["view"], row["method"]) == (view, method):
            return f"{row['psnr']:.2f} dB, {row['hole %']:.2f} % holes, {row['ms']:.0f} ms"
    return ""


def screen_of(case: WarpCase, rendered: Rendered) -> WarpedScreen:
    """Return the picture as a screen shows it."""
    color, covered = delivered(rendered.image, rendered.coverage)
    present = shown if case.is_light else _clipped
    return WarpedScreen(present(color), covered, present(rendered.image))


def _clipped(color: Floats) -> Screen:
    """Return encoded gray or RGB as (H, W, 3), 0..1."""
    return np.clip(color[..., [0, 0, 0]] if color.shape[2] == 1 else color, 0.0, 1.0)


def timed(method: Method, case: WarpCase) -> tuple[Rendered, float]:
    """Return a method's picture, and the median time of several warm runs in ms."""
    shape = (case.target.truth.shape[0], case.target.truth.shape[1])
    rendered = method(case.source, case.equation, shape)
    return rendered, milliseconds(lambda: method(case.source, case.equation, shape))


def busiest(
    errors: Sequence[Floats], target: ScoringTarget, side: int = CROP
) -> tuple[slice, slice]:
    """Return the square where methods err most, at depth edges if there are any.

    `errors`: (H, W) absolute differences to the truth, of one or more methods. `side`: side of the
    square, px; smaller in small pictures.
    """
    zone = target.mask & target.edge
    if not zone.any():
        zone = target.mask
    severe = np.mean([np.minimum(error, SEVERE) for error in errors], axis=0) * zone
    side = min(side, *zone.shape)
    worth = _sums(severe, side) * _sums(target.mask, side)
    row, column = np.unravel_index(int(np.argmax(worth)), worth.shape)
    return slice(int(row), int(row) + side), slice(int(column), int(column) + side)


def _sums(values: NDArray[Any], side: int) -> Doubles:
    """Return sums over all squares of a side, indexed by their upper left corners."""
    total = np.zeros((values.shape[0] + 1, values.shape[1] + 1))
    total[1:, 1:] = values.cumsum(axis=0, dtype=np.float64).cumsum(axis=1)
    below, above = total[side:], total[:-side]
    return np.asarray(below[:, side:] - below[:, :-side] - above[:, side:] + above[:, :-side])


def _built(names: Sequence[str]) -> Mapping[str, Method]:
    if not names:
        raise ValueError("give methods to compare, such as hybrid,mcmillan")
    return {name: registry.build("warps", name) for name in names}


def _compare(cases: Sequence[WarpCase], methods: Mapping[str, Method]) -> DepthComparison:
    rows: list[Row] = []
    pictures: dict[str, dict[str, Screen]] = {}
    details: dict[str, tuple[slice, slice]] = {}
    with progress_bar("warping") as progress:
        for case in cases:
            screens: dict[str, Screen] = {TRUTH: case.target.truth}
            for name, method in methods.items():
                rendered, milliseconds = timed(method, case)
                screen = screen_of(case, rendered)
                measures = score(screen, case.target)
                rows.append({"view": case.name, "method": name, **measures, "ms": milliseconds})
                screens[name] = screen.image
                if progress is not None:
                    progress(len(rows) / (len(cases) * len(methods)))
            pictures[case.name] = screens
            details[case.name] = busiest(_errors(screens), case.target)
    return DepthComparison(rows, pictures, details)


def _errors(screens: Mapping[str, Screen]) -> list[Floats]:
    """Return the differences to the truth, (H, W) for each method."""
    truth = screens[TRUTH]
    return [
        np.abs(screen - truth).mean(axis=2, dtype=np.float32)
        for name, screen in screens.items()
        if name != TRUTH
    ]
