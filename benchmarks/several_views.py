"""Several views of a scene merged into one picture: `python -m benchmarks.several_views`.

Two to four cameras view a scene with exact depth; their pictures are merged in a view between them
and compared with the true view where any camera sees it unoccluded, holes counting as black. Then
their brightness differs by 6 % (gains of 0.97 to 1.03), or their depths by 1 % (0.995 to 1.005),
evenly over the cameras; `outliers` displaces 1 % of each camera's samples to 0.7 of their depth;
`one wrong` applies the whole deviation to one camera only. Nothing is matched to the truth
afterwards.

`--scene kit` is that of `shared/bench/warp_scene.py`, compared as encoded; `generated` is our own,
merged in linear light and compared as displayed. Real frames are a Kinect's, merged in the view of
a frame between them; *seams* is the RMS of changes of the error across borders of views, in levels
of 255, followed by that of all other pixels.
"""

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from resample.cameras.files import read_poses
from resample.cameras.models import Camera
from resample.colors import to_srgb
from resample.files.images import read_image
from resample.measuring.quality import psnr
from resample_warp3d.depth.files import read_depth
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.figures.scenes import SceneViewpoint, generated, pose_of
from resample_warp3d.figures.scoring import near_steps, widened
from resample_warp3d.types import DepthImage
from resample_warp3d.views.together import PLAIN, Joining, PosedSource, agreed, render_together
from tests.benchmarks.warp3d_table import BENCH, DATA, SEEN, bench, camera_of, markdown

KINECT = DATA / "open3d_rgbd"
EYES = {
    2: [(-1.0, 0.0, 0.0), (1.0, 0.0, 0.0)],
    3: [(-1.0, 0.3, 0.0), (1.0, 0.3, 0.0), (0.0, -0.9, 0.6)],
    4: [(-1.0, -0.6, 0.0), (1.0, -0.6, 0.0), (-1.0, 0.6, 0.0), (1.0, 0.6, 0.0)],
}
BETWEEN = SceneViewpoint((0.2, -0.14, 0.3), 0.02, 0.01)
BRIGHTNESS, DEPTH = 0.03, 0.005
OUTLIERS, NEARER = 0.01, 0.7  # fraction of outliers, and their relative depth
FRAMES = {"frames 0, 4 in 2": (0, 4), "frames 0, 1, 3, 4 in 2": (0, 1, 3, 4)}
WAYS = {"plain": PLAIN, "joined": Joining()}

Row = dict[str, str]
Trace = Callable[[Camera], tuple[Any, Any]]


class Seen(NamedTuple):
    """A view of a camera."""

    camera: Camera
    color: Any  # (H, W, 3)
    depth: Any  # (H, W)


class Rig(NamedTuple):
    """Views of several cameras, and the true view between them."""

    views: list[Seen]
    target: Seen
    mask: Any  # (H, W) pixels to measure
    edge: Any  # (H, W) near a step in depth
    is_light: bool


def rig_of_kit(count: int, size: int, reach: float) -> Rig:
    """Views of the shared scene."""
    kit = bench()
    scene, matrix = kit.Scene(), kit.K_for(size, size)

    def camera(stand: SceneViewpoint) -> Camera:
        return camera_of(matrix, kit.look(stand.eye, stand.yaw, stand.pitch))

    def trace(eye: Camera) -> tuple[Any, Any]:
        color, depth, _ = scene.render(matrix, eye.world_to_camera, (size, size))
        return color, depth

    def sight(eye: Camera, other: Camera) -> Any:
        poses = eye.world_to_camera, other.world_to_camera
        return scene.visible(matrix, poses[0], matrix, poses[1], (size, size), (size, size))

    return _rig(_cameras(count, reach, camera), trace, sight, is_light=False)


def rig_of_generated(count: int, size: int, reach: float) -> Rig:
    """Views of our own scene."""
    scene = generated(size)
    shape = size, size

    def camera(stand: SceneViewpoint) -> Camera:
        return scene.source.moved(pose_of(stand))

    def sight(eye: Camera, other: Camera) -> Any:
        return scene.visible(eye, shape, other, shape)

    trace = partial(scene.render, shape=shape)
    return _rig(_cameras(count, reach, camera), trace, sight, is_light=True)


def _cameras(count: int, reach: float, camera: Callable[[SceneViewpoint], Camera]) -> list[Camera]:
    stands = [SceneViewpoint((reach * x, reach * y, reach * z)) for x, y, z in EYES[count]]
    x, y, z = BETWEEN.eye
    return [
        camera(each) for each in (*stands, BETWEEN._replace(eye=(reach * x, reach * y, reach * z)))
    ]


def _rig(cameras: Sequence[Camera], trace: Trace, sight: Any, *, is_light: bool) -> Rig:
    *eyes, between = cameras
    views = [Seen(eye, *trace(eye)) for eye in eyes]
    looks = [sight(between, eye) for eye in eyes]
    mask = np.max([look[0] for look in looks], axis=0) > SEEN
    return Rig(views, Seen(between, *trace(between)), mask, near_steps(*looks[0][1:]), is_light)


def cases(count: int, shape: tuple[int, int]) -> dict[str, tuple[Any, Any]]:
    """Gains of colors and factors of depths by name."""
    even, alone = np.linspace(-1.0, 1.0, count), np.eye(count)[-1]
    one, rng = np.ones(count), np.random.default_rng(7)
    flying = [np.where(rng.random(shape) < OUTLIERS, NEARER, 1.0) for _ in range(count)]
    return {
        "exact": (one, one),
        "6 % brightness": (1.0 + BRIGHTNESS * even, one),
        "1 % depth": (one, 1.0 + DEPTH * even),
        "both": (1.0 + BRIGHTNESS * even, 1.0 - DEPTH * even),
        "outliers": (one, flying),
        "one wrong": (1.0 + 2 * BRIGHTNESS * alone, 1.0 + 2 * DEPTH * alone),
    }


def standing(views: Sequence[Seen], gains: Any, factors: Any) -> list[PosedSource]:
    """Views with applied errors, prepared."""
    made = []
    for view, gain, factor in zip(views, gains, factors, strict=True):
        color = np.asarray(view.color * gain, np.float32)
        depth = np.asarray(view.depth, np.float64) * factor
        nearness = np.divide(1.0, depth, out=np.zeros(depth.shape), where=depth > 0)
        image = DepthImage(color, nearness.astype(np.float32), np.empty((0, 0, 2)))
        made.append(PosedSource(prepare(image), view.camera))
    return made


def joined(
    given: Sequence[PosedSource], target: Camera, shape: Any, way: Joining
) -> tuple[Any, Any]:
    """Colors (H, W, 3) over black, and coverage (H, W)."""
    seen = render_together(agreed(given, way), target, shape, "hybrid", way).warped
    return seen.image, seen.coverage


def traced(rig: Rig, ways: dict[str, Joining], title: str) -> Iterator[Row]:
    """PSNR (dB) of each case, with and without pixels near edges."""
    encode = _encoded if rig.is_light else np.asarray
    truth = encode(rig.target.color)
    for name, (gains, factors) in cases(len(rig.views), rig.mask.shape).items():
        row = {"cameras": title, "case": name}
        given = standing(rig.views, gains, factors)
        for way, joining in ways.items():
            image, _ = joined(given, rig.target.camera, rig.mask.shape, joining)
            whole, inside = (
                psnr(encode(image), truth, mask=mask) for mask in (rig.mask, rig.mask & ~rig.edge)
            )
            row[way] = f"{whole:.2f} ({inside:.2f})"
        yield row


def kinect(ways: dict[str, Joining]) -> Iterator[Row]:
    """PSNR (dB), seams and other pixels (levels) of real frames, unchanged and with 6 % errors."""
    poses = read_poses(KINECT / "trajectory.log")
    views = [
        Seen(
            Camera.from_intrinsics(
                *(525, 525, 319.5, 239.5), world_to_camera=pose, convention="opencv"
            ),
            read_image(str(KINECT / f"color/{n:05}.jpg"))[..., :3],
            read_depth(str(KINECT / f"depth/{n:05}.png")) / 1000.0,
        )
        for n, pose in enumerate(poses)
    ]
    target, truth = views[2].camera, _encoded(views[2].color)
    for name, frames in FRAMES.items():
        chosen = [views[n] for n in frames]
        for apart in (0.0, BRIGHTNESS):
            gains = 1.0 + apart * np.linspace(-1.0, 1.0, len(chosen))
            given = standing(chosen, gains, np.ones(len(chosen)))
            border = borders(given, target, truth.shape[:2])
            row = {"cameras": name, "case": f"{2 * apart:.0%} brightness"}
            pictures = {
                way: joined(given, target, truth.shape[:2], joining)
                for way, joining in ways.items()
            }
            mask = np.min([coverage for _, coverage in pictures.values()], axis=0) > 0.99
            for way, (image, _) in pictures.items():
                row[way] = seams(_encoded(image) - truth, mask, border)
            yield row


def borders(given: Sequence[PosedSource], target: Camera, shape: Any) -> Any:
    """Pixels (H, W) at borders of any view."""
    found = np.zeros(shape, np.bool_)
    for each in given:
        _, coverage = joined([each], target, shape, PLAIN)
        shown = coverage >= 0.5
        found |= widened(shown, 1) & widened(~shown, 1)
    return found


def seams(error: Any, mask: Any, border: Any) -> str:
    """PSNR (dB), and changes of the error across borders and elsewhere (levels)."""
    inside = ~widened(~mask, 2)
    change = np.stack([np.diff(error, axis=n, prepend=0) for n in (0, 1)])
    size = np.square(255.0 * change.mean(axis=3)).sum(axis=0)
    there, elsewhere = (np.sqrt(size[inside & m].mean()) for m in (border, ~border))
    quality = -10.0 * np.log10(np.square(error[mask]).mean())
    return f"{quality:.2f}, {there:.2f} / {elsewhere:.2f}"


def _encoded(color: Any) -> Any:
    return to_srgb(np.clip(color, 0.0, 1.0))


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scene", default="kit,generated,kinect")
    parser.add_argument("--size", type=int, default=512, help="px, of traced scenes")
    parser.add_argument("--reach", type=float, default=0.175, help="half the cameras' distance")
    parser.add_argument("--cameras", default="2,3,4")
    parser.add_argument("--stages", action="store_true", help="what each step brings, too")
    choices = parser.parse_args()
    ways = dict(WAYS)
    if choices.stages:
        ways |= {
            "only feathered": replace(PLAIN, blend="feathered"),
            "and depths": Joining(colors="none", votes="none"),
            "and colors": Joining(votes="none"),
            "gain and bias": Joining(colors="gain-bias"),
        }
    for scene in choices.scene.split(","):
        needed = {"kit": BENCH, "kinect": KINECT}.get(scene, Path())
        if not needed.is_dir():
            sys.stdout.write(f"\n{scene}: skipped, there is no {needed}\n")
            continue
        rows = list(_rows(scene, choices, ways))
        sys.stdout.write(f"\n{scene}\n\n{markdown(rows)}")
        sys.stdout.flush()


def _rows(scene: str, choices: Any, ways: dict[str, Joining]) -> Iterator[Row]:
    if scene == "kinect":
        yield from kinect(ways)
        return
    trace = {"kit": rig_of_kit, "generated": rig_of_generated}[scene]
    for count in map(int, choices.cameras.split(",")):
        yield from traced(trace(count, choices.size, choices.reach), ways, str(count))


if __name__ == "__main__":
    main()
