"""Warps with realistic depth: the shared scene with its depth degraded in twelve ways.

`python -m benchmarks.degraded --size 700 --only exact,blur-2` prints PSNR / PSNR over black
(dB) / holes (%) of pixels that the source sees unoccluded (holes count as black) for each view,
degradation and method: hybrid with given and with refined depth, a mesh cut at steps of 3 %,
triangles by RVS's rule, and softmax splatting. `--reference FILE.npz` caches the ray-traced views.
"""

import argparse
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.tables import Row, table
from resample import registry
from resample.colors import from_srgb
from resample.measuring.compare import contact_sheet
from resample.types import Doubles
from resample_warp3d.baselines.mcmillan import blank
from resample_warp3d.baselines.meshing import orientation_of
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.depth.refining.conditioning import Refine
from resample_warp3d.figures.compare import screen_of
from resample_warp3d.figures.scoring import WarpedScreen
from resample_warp3d.types import DepthImage, Equation, Rendered, Source
from tests.benchmarks import warp3d_table as scene

SHARPNESS = 5.0  # of softmax splatting: the best of 1 to 160, averaged over views and degradations
JPEG_QUALITY = 75
BASELINE, SUBPIXELS = 0.075, 8  # m and sub-pixel steps of disparity, of the simulated sensor
UNSURE = 0.5  # standard deviation of its error, in steps
JITTER = 0.7  # standard deviation of edge positions, px
WINDOW, RIM = 2, 0.05  # px around a depth step of this size where it may fail

DETAIL = 132  # px, of the picture's side
PICTURED = (  # view, degradation, and start of a detail, fractions of the side
    ("side", "blur-2", (0.43, 0.35)),
    ("side", "shift-2", (0.43, 0.35)),
    ("side", "kinect", (0.5, 0.63)),
)

Spoil = Callable[[Doubles, float], Doubles]


def _inverse(change: Callable[[Doubles], Doubles]) -> Spoil:
    """Apply a change to the inverse depth."""
    return lambda depth, focal: 1.0 / change(1.0 / depth)  # noqa: ARG005


def _blurred(sigma: float) -> Spoil:
    return lambda depth, focal: np.asarray(cv2.GaussianBlur(depth, (0, 0), sigma))  # noqa: ARG005


def _shifted(depth: Doubles, focal: float) -> Doubles:  # noqa: ARG001 - as all others
    return np.concatenate([depth[:, :1], depth[:, :1], depth[:, :-2]], axis=1)


def _square(reach: int) -> Any:
    return np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)


def _upsampled(kind: int) -> Spoil:
    def spoil(depth: Doubles, focal: float) -> Doubles:  # noqa: ARG001 - as all others
        height, width = depth.shape
        small = cv2.resize(depth, (width // 4, height // 4), interpolation=cv2.INTER_AREA)
        if kind == cv2.INTER_NEAREST:  # the center sample, as a sensor takes it
            small = depth[2 : 4 * (height // 4) : 4, 2 : 4 * (width // 4) : 4]
        return np.asarray(cv2.resize(small, (width, height), interpolation=kind))

    return spoil


def _levels(bits: int) -> Spoil:
    def spoil(inverse: Doubles) -> Doubles:
        low, high = float(inverse.min()), float(inverse.max())
        most = 2**bits - 1
        levels: Doubles = np.round(most * (inverse - low) / (high - low))
        return np.asarray(low + levels / most * (high - low))

    return _inverse(spoil)


def _noisy(share: float) -> Spoil:
    def spoil(depth: Doubles, focal: float) -> Doubles:  # noqa: ARG001 - as all others
        return depth * (1.0 + share * np.random.default_rng(7).standard_normal(depth.shape))

    return spoil


def _sensed(depth: Doubles, focal: float) -> Doubles:
    """Depth by structured light with the projector on the right, as in the first Kinect.

    Edges are displaced at random, disparity has noisy steps, and half of the pixels around
    silhouettes are unknown, as is what the projector does not light.
    """
    random = np.random.default_rng(7)
    row, column = np.indices(depth.shape, np.float32)
    moves = [cv2.GaussianBlur(random.standard_normal(depth.shape), (0, 0), 1.5) for _ in range(2)]
    right, down = (np.asarray(JITTER / move.std() * move, np.float32) for move in moves)
    moved = cv2.remap(
        depth, column + right, row + down, cv2.INTER_NEAREST, None, cv2.BORDER_REPLICATE
    )
    disparity = focal * BASELINE / moved
    place = column - disparity
    first = np.minimum.accumulate(place[:, ::-1], axis=1)[:, ::-1]
    is_hidden = np.zeros(depth.shape, np.bool_)
    is_hidden[:, :-1] = place[:, :-1] > first[:, 1:]
    window = _square(WINDOW)
    is_rim = cv2.dilate(moved, window) > (1.0 + RIM) * cv2.erode(moved, window)
    is_lost = is_rim & (random.random(depth.shape) < 0.5)
    steps = np.round(SUBPIXELS * disparity + UNSURE * random.standard_normal(depth.shape))
    found = focal * BASELINE * SUBPIXELS / np.maximum(steps, 1.0)
    return np.asarray(np.where(is_hidden | is_lost, 0.0, found))


SPOILS: Mapping[str, Spoil] = {
    "exact": lambda depth, focal: depth,  # noqa: ARG005
    "blur-1": _blurred(1.0),
    "blur-2": _blurred(2.0),
    "shift-2": _shifted,
    "dilate-3": lambda depth, focal: cv2.erode(depth, _square(3)),  # noqa: ARG005
    "erode-3": lambda depth, focal: cv2.dilate(depth, _square(3)),  # noqa: ARG005
    "bilinear-4": _upsampled(cv2.INTER_LINEAR),
    "nearest-4": _upsampled(cv2.INTER_NEAREST),
    "8-bit": _levels(8),
    "6-bit": _levels(6),
    "noise-0.2": _noisy(0.002),
    "noise-1": _noisy(0.01),
    "kinect": _sensed,
    "jpeg": lambda depth, focal: depth,  # noqa: ARG005
}


def source_image(work: scene.Workload, name: str) -> DepthImage:
    """Source of the workload, degraded."""
    focal = float(work.camera.matrix[0, 0])
    depth: Any = SPOILS[name](np.asarray(work.depth, np.float64), focal)
    nearness = np.divide(1.0, depth, out=np.zeros_like(depth), where=depth > 0)
    color = np.asarray(work.color, np.float32)
    if name == "jpeg":
        levels = np.floor(np.clip(color[..., ::-1], 0, 1) * 255 + 0.5).astype(np.uint8)
        _, stored = cv2.imencode(".jpg", levels, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        read: Any = cv2.imdecode(stored, cv2.IMREAD_COLOR)
        color = read[..., ::-1] / np.float32(255)
    image = np.ascontiguousarray(color, np.float32)
    return DepthImage(image, nearness.astype(np.float32), np.empty((0, 0, 2)))


def by_rvs(source: Source, equation: Equation, shape: tuple[int, int]) -> Rendered:
    """Warp by RVS's rule; see `benchmarks.kernels.rivals.draw_triangles`."""
    from benchmarks.kernels.rivals import draw_triangles

    worth, image = np.zeros(shape), np.zeros((*shape, source.color.shape[2]), np.float32)
    draw_triangles(source.color, _seen(source, equation), orientation_of(equation), worth, image)
    rendered = blank(source, shape)
    return rendered._replace(image=image, coverage=(worth > 0).astype(np.float32))


def by_softmax(source: Source, equation: Equation, shape: tuple[int, int]) -> Rendered:
    """Warp by softmax splatting; see `benchmarks.kernels.rivals.add_splats`."""
    from benchmarks.kernels.rivals import add_splats

    total, image = np.zeros(shape), np.zeros((*shape, source.color.shape[2]))
    add_splats(source.color, _seen(source, equation), SHARPNESS, total, image)
    np.divide(image, total[..., None], out=image, where=total[..., None] > 0)
    rendered, covered = blank(source, shape), (total > 0).astype(np.float32)
    return rendered._replace(image=image.astype(np.float32), coverage=covered)


def _seen(source: Source, equation: Equation) -> Doubles:
    from benchmarks.kernels.rivals import project

    vertex = np.zeros((*source.nearness.shape, 3))
    project(source, equation, vertex)
    return vertex


METHODS: Mapping[str, tuple[Refine, Any]] = {  # refinement of the depth, and warp
    "hybrid, refine none": ("none", registry.build("warps", "hybrid")),
    "hybrid": ("auto", registry.build("warps", "hybrid")),
    "mesh": ("none", registry.build("warps", "mesh:cut=0.03")),
    "RVS": ("none", by_rvs),
    "softmax": ("none", by_softmax),
}
BESIDE = {"as given": "hybrid, refine none", "refined": "hybrid", "RVS": "RVS"}


def rows(work: scene.Workload, names: Sequence[str], methods: Sequence[str]) -> Iterator[Row]:
    """Measure each degradation with each method."""
    for name in names:
        image = source_image(work, name)
        sources: dict[str, Source] = {}
        for method in methods:
            refine, warp = METHODS[method]
            if refine not in sources:
                sources[refine] = prepare(image, refine=refine)
            source = sources[refine]
            row: Row = {"depth": name, "method": method}
            for view in work.views:
                screen, target = shown(work, view, source, warp), work.views[view].target
                row[view] = scene.both_of(screen, target)
            yield row


def shown(work: scene.Workload, view: str, source: Source, warp: Any) -> WarpedScreen:
    """Picture of a view."""
    case = scene.case_of(work, view, source)
    return screen_of(case, warp(source, case.equation, case.target.mask.shape))


def write_picture(path: Path, work: scene.Workload) -> None:
    """Write details of warps with degraded depth beside the truth, as one PNG."""
    cells = {}
    side = work.depth.shape[0]
    for view, name, (top, left) in PICTURED:
        rows, columns = (slice(int(at * side), int(at * side) + DETAIL) for at in (top, left))
        image = source_image(work, name)
        cells[f"{name}: truth"] = work.views[view].target.truth[rows, columns]
        for title, method in BESIDE.items():
            refine, warp = METHODS[method]
            found = shown(work, view, prepare(image, refine=refine), warp)
            cells[f"{name}: {title}"] = found.with_holes[rows, columns]
    light = {title: from_srgb(np.asarray(cell, np.float32)) for title, cell in cells.items()}
    contact_sheet(light, path, columns=4, zoom=1)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--size", type=int, default=700, help="px")
    parser.add_argument("--only", default=",".join(SPOILS), help="of " + ", ".join(SPOILS))
    parser.add_argument("--methods", default=";".join(METHODS), help="separated by semicolons")
    parser.add_argument("--reference", type=Path, help="file of ray-traced views, .npz")
    parser.add_argument("--picture", type=Path, help="write details as a PNG, and no table")
    choices = parser.parse_args()
    names, methods = choices.only.split(","), choices.methods.split(";")
    for given, known in ((names, SPOILS), (methods, METHODS)):
        unknown = [name for name in given if name not in known]
        if unknown:
            parser.error(f"unknown {unknown[0]!r}; known: {', '.join(known)}")
    if not scene.BENCH.is_dir():
        sys.stdout.write(f"skipped, there is no {scene.BENCH.resolve()}\n")
        return
    work = scene.workload(choices.size, choices.reference)
    if choices.picture is not None:
        write_picture(choices.picture, work)
        return
    sys.stdout.write(table(list(rows(work, names, methods))))


if __name__ == "__main__":
    main()
