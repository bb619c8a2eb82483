"""The tables of notes/quality.md on 3D warping: `python -m tests.benchmarks.warp3d_table`.

`--only synthetic,pairs` prints some of them, `--methods hybrid,mesh` of some methods, and
`--reference FILE.npz` keeps the ray-traced views of the first ones from run to run. The workload is
the scene of `shared/bench/warp_scene.py` with its views and score; the real pairs are those of
`shared/data/depth`. A table whose workload is absent says so.

Values are warped and compared as they are encoded, but those of our generated scene, which are
linear light. Times are CPU time on one thread, median of 5 warm runs, without the preparation of
the source, which is shown beside them.
"""

import argparse
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from importlib import import_module
from inspect import cleandoc
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import minimum_filter

from resample import registry
from resample.cameras.models import Camera
from resample.engine.jit import threads
from resample.measuring.quality import psnr
from resample.profiles.filters import PixelFilter
from resample_warp3d.depth.equation import between
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.figures.compare import WarpCase, scene_case, screen_of
from resample_warp3d.figures.pairs import load_pairs
from resample_warp3d.figures.scenes import VIEWPOINTS, generated
from resample_warp3d.figures.scoring import (
    ScoringTarget,
    WarpedScreen,
    delivered,
    flicker,
    hole_percent,
    inpainted,
    iv_psnr,
    score,
)
from resample_warp3d.methods.filtering import filtered
from resample_warp3d.types import DepthImage, Source

BENCH = Path(__file__).parents[2] / "../shared/bench"
DATA = Path(__file__).parents[2] / "../shared/data/depth"
RUNS = 5
FRAMES = 10  # of a dolly
FLICKER_SIZE = 512
FILTER_SIZE = 256
FINE, AROUND = 16, 3  # rays per side of a pixel under a filter; px around it that any reads

# Share of the way from the source to the view, its last part, that a dolly covers: steps as large
# as those that the goals were set with, where cv2.warpFrame flickered by 44.5, 30.8 and 69.0.
DOLLIES = {"side": 0.1, "back4": 0.1, "in3": 0.025}
SEEN = 0.999  # share of a pixel's rays

Row = dict[str, str]


@dataclass(frozen=True)
class Run:
    """What is measured."""

    methods: Sequence[str]
    size: int
    reference: Path | None


class View(NamedTuple):
    """One of the workload's views."""

    camera: Camera
    target: ScoringTarget


class Workload(NamedTuple):
    """The workload's source and views."""

    color: Any  # (H, W, 3) encoded
    depth: Any  # (H, W)
    camera: Camera
    views: dict[str, View]


@cache
def bench() -> Any:
    sys.path.insert(0, str(BENCH.resolve()))
    return import_module("warp_scene")


def camera_of(matrix: Any, pose: Any) -> Camera:
    """Camera of the workload, whose pixel centers are whole numbers."""
    fx, fy, cx, cy = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
    return Camera.from_intrinsics(fx, fy, cx, cy, world_to_camera=pose, convention="opencv")


@cache
def workload(size: int, file: Path | None) -> Workload:
    """The ray-traced views, read from a file if there is one, and else kept in it."""
    if file is not None and file.is_file():
        arrays = dict(np.load(file))
    else:
        arrays = flat(bench().reference(size))
        if file is not None:
            np.savez(file, **arrays)
    if arrays["A"].shape[0] != size:
        raise ValueError(f"{file} holds views of {arrays['A'].shape[0]} px, not {size}")
    views = {}
    for name in bench().CASES:
        case = {key: arrays[f"{name}/{key}"] for key in ("T", "B", "visible", "edge")}
        target = ScoringTarget(case["B"], case["visible"] > SEEN, case["edge"])
        views[name] = View(camera_of(arrays["K"], case["T"]), target)
    return Workload(arrays["A"], arrays["z"], camera_of(arrays["K"], np.eye(4)), views)


def flat(reference: Any) -> dict[str, Any]:
    """Arrays of the workload by name."""
    arrays = {key: reference[key] for key in ("A", "z", "K")}
    for name, case in reference["cases"].items():
        arrays |= {f"{name}/{key}": value for key, value in case.items()}
    return arrays


def source_of(color: Any, depth: Any) -> Source:
    nearness = (1.0 / depth).astype(np.float32)
    return prepare(DepthImage(np.asarray(color, np.float32), nearness, np.empty((0, 0, 2))))


def case_of(work: Workload, name: str, source: Source) -> WarpCase:
    view = work.views[name]
    return WarpCase(name, source, between(work.camera, view.camera), view.target, is_light=False)


def warped(case: WarpCase, method: str) -> WarpedScreen:
    shape = case.target.mask.shape
    rendered = registry.build("warps", method)(case.source, case.equation, shape)
    return screen_of(case, rendered)


def milliseconds(run: Callable[[], object]) -> float:
    """CPU time on one thread, median of warm runs."""
    times = []
    with threads(1):
        run()
        for _ in range(RUNS):
            start = time.process_time()
            run()
            times.append(1000.0 * (time.process_time() - start))
    return statistics.median(times)


def measured(case: WarpCase, method: str) -> tuple[str, str]:
    """PSNR / over black / edge PSNR / holes, and CPU milliseconds."""
    measures = score(warped(case, method), case.target)
    shape, build = case.target.mask.shape, registry.build("warps", method)
    duration = milliseconds(lambda: build(case.source, case.equation, shape))
    edge = measures["edge psnr"]
    both = f"{measures['psnr']:.2f} / {measures['black psnr']:.2f}"
    numbers = f"{both} / {edge:.1f} / {measures['hole %']:.2f}"
    return numbers, f"{duration:.0f}"


def one_view_each(cases: Sequence[WarpCase], methods: Sequence[str]) -> Iterator[Row]:
    for method in methods:
        results = {case.name: measured(case, method) for case in cases}
        row = {"method": method} | {name: numbers for name, (numbers, _) in results.items()}
        yield row | {"CPU ms": ", ".join(duration for _, duration in results.values())}


def synthetic(run: Run) -> Iterator[Row]:
    """PSNR / over black / edge PSNR (dB) / holes (%), shared scene, and CPU time on one thread."""
    work = workload(run.size, run.reference)
    source = source_of(work.color, work.depth)
    cases = [case_of(work, name, source) for name in work.views]
    duration = milliseconds(lambda: source_of(work.color, work.depth))
    yield from one_view_each(cases, run.methods)
    yield {"method": f"(preparation: {duration:.0f} ms)"}


def own_scene(run: Run) -> Iterator[Row]:
    """PSNR / over black / edge PSNR (dB) / holes (%), generated scene, warped in linear light."""
    scene = generated(run.size)
    source = prepare(scene.depth_image())
    yield from one_view_each([scene_case(scene, view, source) for view in VIEWPOINTS], run.methods)


def stored(run: Run) -> Iterator[Row]:
    """PSNR / over black (dB) / holes (%) with depth as files and sensors have it, in3 and back4."""
    work = workload(run.size, run.reference)
    for method in run.methods:
        row = {"method": method}
        for kind, depth in depths(work.depth).items():
            source = source_of(work.color, depth)
            for name in ("in3", "back4"):
                case = case_of(work, name, source)
                row[f"{name}, {kind}"] = both_of(warped(case, method), case.target)
        yield row


def both_of(screen: WarpedScreen, target: ScoringTarget) -> str:
    """PSNR of colors divided by their coverage, and over black, dB; holes, percent."""
    quality, over_black = (
        psnr(image, target.truth, mask=target.mask)
        for image in (screen.with_holes, screen.over_black)
    )
    return f"{quality:.2f} / {over_black:.2f} / {hole_percent(screen.covered, target.mask):.2f}"


def depths(depth: Any) -> dict[str, Any]:
    """Exact depth; uint16 mm; 8-bit inverse depth over its range; with noise of 0.2 %."""
    inverse = 1.0 / depth
    low, high = inverse.min(), inverse.max()
    levels = np.round(255.0 * (inverse - low) / (high - low))
    noise = np.random.default_rng(7).standard_normal(depth.shape)
    return {
        "exact": depth,
        "mm": np.round(1000.0 * depth) / 1000.0,
        "8-bit 1/z": 1.0 / (low + levels / 255.0 * (high - low)),
        "0.2 % noise": depth * (1.0 + 0.002 * noise),
    }


def identity(run: Run) -> Iterator[Row]:
    """A view from where the source stands: equal values, and the largest difference."""
    work = workload(run.size, run.reference)
    source = source_of(work.color, work.depth)
    whole = np.ones(work.depth.shape, np.bool_)
    equation = between(work.camera, work.camera)
    for method in run.methods:
        case = WarpCase(
            "identity", source, equation, ScoringTarget(work.color, whole, whole), is_light=False
        )
        rendered = registry.build("warps", method)(source, equation, work.depth.shape)
        image, covered = delivered(rendered.image, rendered.coverage)
        yield {
            "method": method,
            "bit-exact": "yes" if np.array_equal(image, case.source.color) else "no",
            "equal values, %": f"{100.0 * np.mean(image == case.source.color):.2f}",
            "largest difference": f"{np.abs(image - case.source.color).max():.2g}",
            "PSNR, dB": f"{psnr(image, case.source.color):.1f}",
            "holes, %": f"{hole_percent(covered, whole):.3f}",
        }


def flickering(run: Run) -> Iterator[Row]:
    """RMS of the errors' change from frame to frame × 255, 512², 10 frames before each view.

    Eye and angles move evenly over the last tenth of the way from the source to side and back4, and
    over the last fortieth to in3.
    """
    source = None
    dollies = {}
    for name in DOLLIES:
        dollies[name], source = dolly(name)
    for method in run.methods:
        row = {"method": method}
        for name, views in dollies.items():
            errors, masks = [], []
            for view in views:
                equation = between(dolly_camera(0.0, name), view.camera)
                case = WarpCase(name, source, equation, view.target, is_light=False)
                errors.append(warped(case, method).with_holes - view.target.truth)
                masks.append(view.target.mask)
            row[name] = f"{flicker(errors, masks):.1f}"
        yield row


def filters(run: Run) -> Iterator[Row]:
    """PSNR (dB) against the shared scene's views on 16 × 16 rays per pixel, under each filter.

    At 256², over pixels all of whose surroundings that a filter reads are seen by the source: views
    side / back4 / in3 / oblique; and CPU time of the first one on one thread.
    """
    scene, size = bench().Scene(), (FILTER_SIZE, FILTER_SIZE)
    matrix = bench().K_for(*size)
    color, depth, _ = scene.render(matrix, np.eye(4), size)
    source = source_of(color, depth)
    truths = {name: fine_truth(scene, matrix, name) for name in bench().CASES}
    for method in run.methods:
        chosen = registry.build("warps", method)
        if getattr(chosen, "is_per_pixel", False):
            continue
        row = {"method": method}
        for name in ("area", *(n for n in registry.names("filters") if n not in ("area", "box"))):
            pixel_filter = registry.build("filters", name)
            found, spent = [], ""
            for truth in truths.values():
                equation = between(camera_of(matrix, np.eye(4)), truth.camera)
                warp = partial(filtered, chosen, pixel_filter, source, equation, size)
                found.append(f"{truth.score(warp().image, pixel_filter):.1f}")
                spent = spent or f"{milliseconds(warp):.0f}"
            row[name] = f"{' / '.join(found)}; {spent} ms"
        yield row


class FineTruth(NamedTuple):
    """A view by 16 × 16 rays per pixel, some pixels around it, and where the source sees it."""

    camera: Camera
    rays: Any  # ((H + 2 AROUND) FINE, (W + 2 AROUND) FINE, 3)
    visible: Any  # (H, W)

    def score(self, image: Any, pixel_filter: PixelFilter) -> float:
        """PSNR of a picture (H, W, 3) against the rays under a filter."""
        parts = (np.arange((2 * AROUND + 1) * FINE) + 0.5) / FINE - AROUND - 0.5
        distance, radius = np.abs(parts), pixel_filter.radius
        weight = np.where(distance <= radius, pixel_filter(np.minimum(distance, radius)), 0.0)
        weight /= weight.sum()
        height, width = self.visible.shape
        down = sum(w * self.rays[k : k + FINE * height : FINE] for k, w in enumerate(weight))
        truth = sum(w * down[:, k : k + FINE * width : FINE] for k, w in enumerate(weight))
        mask = minimum_filter(self.visible, 2 * AROUND + 1, mode="constant") > SEEN
        return psnr(image, truth.astype(np.float32), mask=mask)


def fine_truth(scene: Any, matrix: Any, name: str) -> FineTruth:
    eye, yaw, pitch = bench().CASES[name]
    pose, size = bench().look(eye, yaw, pitch), (FILTER_SIZE, FILTER_SIZE)
    visible, _, _ = scene.visible(matrix, pose, matrix, np.eye(4), size, size)
    # Its pixel centers are whole numbers, on the fine grid, too.
    shift = FINE * (AROUND + 0.5) - 0.5
    fine = np.array([[FINE, 0, shift], [0, FINE, shift], [0, 0, 1.0]]) @ matrix
    side = (FILTER_SIZE + 2 * AROUND) * FINE
    rays, _, _ = scene.render(fine, pose, (side, side), 1)
    return FineTruth(camera_of(matrix, pose), rays, visible)


def dolly(name: str) -> tuple[list[View], Source]:
    """Views on the way to one of the workload, and their source."""
    scene, size = bench().Scene(), (FLICKER_SIZE, FLICKER_SIZE)
    matrix = bench().K_for(*size)
    color, depth, _ = scene.render(matrix, np.eye(4), size)
    views = []
    for share in np.linspace(1.0 - DOLLIES[name], 1.0, FRAMES):
        pose = dolly_pose(share, name)
        truth, _, _ = scene.render(matrix, pose, size)
        visible, _, _ = scene.visible(matrix, pose, matrix, np.eye(4), size, size)
        mask = visible > SEEN
        views.append(View(camera_of(matrix, pose), ScoringTarget(truth, mask, mask)))
    return views, source_of(color, depth)


def dolly_pose(share: float, name: str) -> Any:
    eye, yaw, pitch = bench().CASES[name]
    return bench().look(tuple(share * n for n in eye), share * yaw, share * pitch)


def dolly_camera(share: float, name: str) -> Camera:
    return camera_of(bench().K_for(FLICKER_SIZE, FLICKER_SIZE), dolly_pose(share, name))


def pairs(run: Run) -> Iterator[Row]:
    """Real pairs: PSNR (dB) as delivered / over black / holes filled alike, holes (%), IV-PSNR.

    IV-PSNR, which forgives shifts of 2 px and an even offset of color, is of the picture as
    delivered, holes black; `showing.scoring.iv_psnr` says by which definition.
    """
    loaded = load_pairs(DATA)
    sources = [prepare(pair.image) for pair in loaded]
    for method in run.methods:
        numbers = []
        for pair, source in zip(loaded, sources, strict=True):
            target = ScoringTarget(pair.truth, pair.mask, pair.mask)
            case = WarpCase(pair.name, source, pair.equation, target, is_light=False)
            screen = warped(case, method)
            image, filled = screen.with_holes, inpainted(screen.image, screen.covered)
            pictures = (image, screen.over_black, filled)
            numbers.append(
                [psnr(picture, pair.truth, mask=pair.mask) for picture in pictures]
                + [hole_percent(screen.covered, pair.mask), iv_psnr(image, pair.truth, pair.mask)]
            )
        row = {"method": method, "mean": slashed(np.mean(numbers, axis=0))}
        yield row | {pair.name: slashed(each) for pair, each in zip(loaded, numbers, strict=True)}


def slashed(numbers: Any) -> str:
    return " / ".join(f"{number:.2f}" for number in numbers)


TABLES: dict[str, tuple[Callable[[Run], Iterator[Row]], Path | None]] = {
    "synthetic": (synthetic, BENCH),
    "flicker": (flickering, BENCH),
    "stored": (stored, BENCH),
    "filters": (filters, BENCH),
    "identity": (identity, BENCH),
    "generated": (own_scene, None),
    "pairs": (pairs, DATA),
}


def markdown(rows: Sequence[Row]) -> str:
    """Table of rows; the first has all columns."""
    names = list(rows[0])
    lines = [names, ["---"] * len(names), *([row.get(name, "") for name in names] for row in rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default=",".join(TABLES), help="tables, of " + ", ".join(TABLES))
    parser.add_argument("--methods", default=",".join(registry.names("warps")))
    parser.add_argument("--size", type=int, default=1024, help="px, of synthetic scenes")
    parser.add_argument("--reference", type=Path, help="file of ray-traced views, .npz")
    choices = parser.parse_args()
    run = Run(choices.methods.split(","), choices.size, choices.reference)
    for name in choices.only.split(","):
        table, needed = TABLES[name]
        if needed is not None and not needed.is_dir():
            sys.stdout.write(f"\n{name}: skipped, there is no {needed}\n")
            continue
        sys.stdout.write(
            f"\n{name}: {cleandoc(table.__doc__ or '')}\n\n{markdown(list(table(run)))}"
        )
        sys.stdout.flush()


if __name__ == "__main__":
    main()
