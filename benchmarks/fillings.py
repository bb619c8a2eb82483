"""Quality of disocclusion filling over a film: `python -m benchmarks.fillings`.

A camera sways over 12 frames around the source's viewpoint, as in `animate`, past scenes with exact
depth. Only empty pixels of disocclusions count; RMS against the true picture, in levels of 255:

* *error* of a frame;
* *at a pixel*, change of the error between frames at pixels filled in both. Fillings move with the
  scene, so this is not 0 even without flicker: *nothing*, black, has some;
* *along the scene*, change of the error at a point of the true scene: actual flicker.

`layer covers` is the fraction of these pixels that the layer reaches; the filling of the picture
covers the others. Values are compared as encoded for the shared scene, in linear light for our own.
"""

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import map_coordinates

from resample.cameras.models import Camera
from resample_warp3d.command.animation import NearbyPath, Range
from resample_warp3d.depth.equation import between, warp_places
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.figures.scenes import generated
from resample_warp3d.sheet.filling import fill
from resample_warp3d.sheet.sheets import background, behind
from resample_warp3d.types import DepthImage, Hole, Source, Warped
from resample_warp3d.warping import render
from tests.benchmarks.warp3d_table import BENCH, bench, camera_of, markdown

FRAMES, PART = 12, 4  # of a sway, a quarter
EMPTY = 0.05  # coverage

Row = dict[str, str]
Trace = Callable[[Camera], tuple[Any, Any]]


class Frame(NamedTuple):
    """A frame of a film."""

    camera: Camera
    truth: Any  # (H, W, 3)
    depth: Any  # (H, W)
    seen: Warped
    layer: Warped | None

    @property
    def mask(self) -> Any:
        """Pixels (H, W) that are measured."""
        return (self.seen.holes == Hole.DISOCCLUDED) & (self.seen.coverage < EMPTY)


def traced(scene: str, size: int) -> tuple[Camera, Trace]:
    """Camera of a scene's source, and a function that ray traces it."""
    if scene == "generated":
        room = generated(size)
        return room.source, lambda camera: room.render(camera, (size, size))
    kit = bench()
    shared, matrix = kit.Scene(), kit.K_for(size, size)
    return camera_of(matrix, np.eye(4)), lambda camera: shared.render(
        matrix, camera.world_to_camera, (size, size)
    )[:2]


def film(scene: str, size: int) -> list[Frame]:
    """Frames of a scene."""
    start, trace = traced(scene, size)
    color, depth = trace(start)
    nearness = (1.0 / depth).astype(np.float32)
    source = prepare(DepthImage(np.asarray(color, np.float32), nearness, np.empty((0, 0, 2))))
    layer = background(source)
    distance, path = Range.of(source.nearness), NearbyPath("sway", PART * FRAMES)
    frames = []
    for n in range(1, FRAMES + 1):
        camera = start.moved(path.pose(n, start.world_to_camera, distance))
        frames.append(Frame(camera, *trace(camera), *_seen(source, layer, start, camera)))
    return frames


def _seen(
    source: Source, layer: Source | None, start: Camera, camera: Camera
) -> tuple[Warped, Warped | None]:
    shape, equation = source.nearness.shape, between(start, camera)
    size = shape[0], shape[1]
    hidden = None if layer is None else render(layer, equation, size, "hybrid")
    return render(source, equation, size, "hybrid"), hidden


def measured(frames: Sequence[Frame], pictures: Sequence[Any]) -> Row:
    """RMS of errors and of their changes, in levels."""
    errors = [picture - frame.truth for frame, picture in zip(frames, pictures, strict=True)]
    masks = [frame.mask for frame in frames]
    there: dict[str, list[Any]] = {"error": [], "at a pixel": [], "along the scene": []}
    for n, (frame, error, mask) in enumerate(zip(frames, errors, masks, strict=True)):
        there["error"].append(error[mask].ravel())
        if n == 0:
            continue
        both = mask & masks[n - 1]
        there["at a pixel"].append((error - errors[n - 1])[both].ravel())
        row, column = np.nonzero(mask)
        point = np.stack([column + 0.5, row + 0.5], axis=1)
        back = between(frame.camera, frames[n - 1].camera)
        place = warp_places(back, point, 1.0 / frame.depth[mask])[0][:, ::-1].T - 0.5
        was = [map_coordinates(errors[n - 1][..., c], place, order=1) for c in range(3)]
        is_filled = map_coordinates(masks[n - 1].astype(float), place, order=1) > 0.999
        there["along the scene"].append((error[mask] - np.stack(was, 1))[is_filled].ravel())
    return {name: f"{255 * _rms(values):.2f}" for name, values in there.items()}


def _rms(values: Sequence[Any]) -> float:
    return float(np.sqrt(np.mean(np.square(np.concatenate(values), dtype=np.float64))))


def rows(scene: str, size: int) -> Iterator[Row]:
    """Measure each way of filling."""
    frames = film(scene, size)
    layered = [
        each.seen if each.layer is None else behind(each.seen, each.layer) for each in frames
    ]
    left = [
        (each.coverage[frame.mask] < 0.5).mean()
        for each, frame in zip(layered, frames, strict=True)
    ]
    ways = {
        "nothing": [each.seen for each in frames],
        "picture": [fill(each.seen) for each in frames],
        "layer": [fill(each) for each in layered],
    }
    for way, pictures in ways.items():
        row = {"scene": scene, "--fill-by": way}
        row |= measured(frames, [each.image for each in pictures])
        yield row | {"layer covers": f"{1 - np.mean(left):.1%}" if way == "layer" else ""}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scene", default="kit,generated")
    parser.add_argument("--size", type=int, default=512, help="px")
    choices = parser.parse_args()
    for scene in choices.scene.split(","):
        if scene == "kit" and not BENCH.is_dir():
            sys.stdout.write(f"\nkit: skipped, there is no {BENCH}\n")
            continue
        sys.stdout.write(f"\n{markdown(list(rows(scene, choices.size)))}")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
