"""Pictures with depth in files, moved by `resample-warp3d`, against the ray-traced scene.

Color is an 8-bit PNG, depth a 16-bit one. Only px that the source sees whole are scored; holes
count as black. Peers are rewritten from their published rules: a mesh that is cut across steps,
with 4 x 4 samples or one, the triangles of RVS (quality by edge length, then depth), and softmax
splatting.
"""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from benchmarks.scores.depth_scene import Scene, Shot, by_peers, matrix_of, pose_of, projected
from benchmarks.scores.judging import Booleans, Call, Finding, Floats, Judge, db
from benchmarks.scores.pictures import rounded, shown, write_png

SIDE = 320  # px
UNIT = 5000  # values of a depth file per unit of length, as the TUM data sets have
PHOTO = "textures/skimage_astronaut.png"
VIEWS = {
    "side": pose_of((0.35, -0.08, 0.10), 0.045, 0.01),
    "back": pose_of((0.25, -0.10, -5.0), 0.015),
    "in": pose_of((0.05, 0.15, 2.6)),
    "oblique": pose_of((-2.0, -0.25, 0.9), 0.4),
}
QUICK = ("exact", "blurred by 3 px")
EYES = 0.06  # between the eyes


def kinect(depth: Floats, rng: np.random.Generator) -> Floats:
    """Depth as by structured light: steps and noise that grow with z², shadows beside edges."""
    strength = 580 * 0.075  # focal length x baseline
    noisy = np.maximum(depth + rng.normal(0, 0.0012, depth.shape) * depth**2, 0.3)
    found = strength / (np.round(strength / noisy * 8) / 8)
    step = np.abs(np.diff(depth, axis=1, prepend=depth[:, :1])) > 0.08 * depth
    shadow = cv2.dilate(step.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    found[shadow | (rng.random(depth.shape) < 0.003)] = 0
    return found


def damaged(depth: Floats) -> dict[str, Floats]:
    """Depth maps (0 unknown) as users have them, by name."""
    near, side = (1 / depth).astype(np.float32), depth.shape[0]

    def mean(small: int) -> Floats:
        return np.asarray(cv2.resize(near, (small, small), interpolation=cv2.INTER_AREA))

    def nearest(factor: float) -> Floats:
        small = round(side / factor)
        picked = ((np.arange(small) + 0.5) * side / small).astype(int)
        back = np.arange(side) * small // side
        return np.asarray(near[picked][:, picked][back][:, back])

    def bilinear(factor: float) -> Floats:
        small = mean(round(side / factor))
        return np.asarray(cv2.resize(small, (side, side), interpolation=cv2.INTER_LINEAR))

    def with_corners(factor: float) -> Floats:
        """Enlarge so that the outer samples coincide (align_corners)."""
        small = mean(round(side / factor))
        at = np.linspace(0, small.shape[0] - 1, side, dtype=np.float32)
        place = np.tile(at, (side, 1)), np.tile(at[:, None], (1, side))
        return np.asarray(cv2.remap(small, *place, cv2.INTER_LINEAR))

    return {
        "exact": depth,
        "blurred by 3 px": 1 / cv2.GaussianBlur(near, (0, 0), 3),
        "nearest, 3.70 x enlarged": 1 / nearest(3.70),
        "nearest, 8.04 x enlarged": 1 / nearest(8.04),
        "bilinear, 1.74 x enlarged": 1 / bilinear(1.74),
        "align_corners, 3.70 x enlarged": 1 / with_corners(3.70),
        "Kinect-like": kinect(depth, np.random.default_rng(4)),
    }


def write_depth(path: Path, depth: Floats, scale: float = UNIT) -> Floats:
    """Write depth of 16 bits; returns what the file holds."""
    numbers = np.rint(np.clip(depth * scale, 0, 65535))
    if not cv2.imwrite(str(path), numbers.astype(np.uint16)):
        raise OSError(f"{path} cannot be written")
    return np.asarray(numbers / scale)


def moved(judge: Judge, matrix: Floats, pose: Floats) -> tuple[Floats, Call]:
    """The command's picture over black."""
    np.savetxt(judge.folder / "pose.txt", pose)
    center = f"{matrix[0, 2] + 0.5},{matrix[1, 2] + 0.5}"
    words = ("--depth-scale", UNIT, f"--intrinsics={matrix[0, 0]},{matrix[1, 1]},{center}")
    files = ("color.png", "depth.png")
    output = ("--pose", "pose.txt", "-o", "out.png")
    call = judge.call("warp3d", "render", *files, *words, *output)
    return (np.array(np.nan) if np.isnan(call.cpu) else shown(judge.folder / "out.png")), call


def views(judge: Judge) -> None:
    """Exact and damaged depth, seen from four places."""
    scene, matrix, size = Scene(judge.file(PHOTO)), matrix_of(SIDE, SIDE), (SIDE, SIDE)
    home = Shot(matrix, np.eye(4), size)
    color, depth = scene.render(home)
    write_png(judge.folder / "color.png", color)
    truths = {}
    for name, pose in VIEWS.items():
        shot = Shot(matrix, pose, size)
        truths[name] = scene.render(shot)[0], scene.visible(shot, home) > 0.999
    for kind, given in damaged(depth).items():
        if judge.quick and kind not in QUICK:
            continue
        held = write_depth(judge.folder / "depth.png", given)
        for name, (true, seen) in truths.items():
            picture, call = moved(judge, matrix, VIEWS[name])
            peers = {
                peer: db(theirs, true, seen)
                for peer, theirs in by_peers(rounded(color), held, matrix, VIEWS[name])
            }
            ours = db(np.broadcast_to(picture, true.shape), true, seen)
            judge.add(f"depth {kind}, {name}", ours, peers, calls=[call], cpu=call.cpu)


class Ball:
    """A red ball before a green wall."""

    side = 400  # px
    center, radius, wall = np.array([0, 0, 4.0]), 1.0, 9.0

    def traced(self, eye: Floats, ways: Floats) -> tuple[Floats, Booleans]:
        """Lengths along rays, and which hit the ball."""
        a, b = (ways**2).sum(-1), ways @ (eye - self.center)
        inside = b * b - a * (((eye - self.center) ** 2).sum() - self.radius**2)
        length = (-b - np.sqrt(np.maximum(inside, 0))) / a
        hit = (inside > 0) & (length > 0)
        with np.errstate(divide="ignore"):
            return np.where(hit, length, (self.wall - eye[2]) / ways[..., 2]), hit

    def ways(self, rays: int) -> Floats:
        """Rays of a camera, whose z is 1."""
        x = ((np.arange(self.side * rays) + 0.5) / rays - self.side / 2) / self.side
        return np.stack(np.broadcast_arrays(x, x[:, None], 1.0), -1)

    def visible(self, pose: Floats) -> Booleans:
        """Which px of a new view show what the source, at the origin, sees of the ball."""
        eye = -pose[:3, :3].T @ pose[:3, 3]
        ways = self.ways(1) @ pose[:3, :3]
        length, hit = self.traced(eye, ways)
        place = eye + ways * length[..., None]
        facing = (place * (place - self.center)).sum(-1) < 0
        return np.asarray(hit & facing)


def leaks(judge: Judge) -> None:
    """The ball, turned about itself: px of it that show the wall or nothing, 1 px off its rim."""
    ball, n = Ball(), Ball.side
    matrix = np.array([[n, 0, (n - 1) / 2], [0, n, (n - 1) / 2], [0, 0, 1.0]])
    share = ball.traced(np.zeros(3), ball.ways(4))[1].reshape(n, 4, n, 4).mean((1, 3))
    color = np.stack([share, 1 - share, 0 * share], -1)
    write_png(judge.folder / "color.png", color)
    depth, _ = ball.traced(np.zeros(3), ball.ways(1))
    held = write_depth(judge.folder / "depth.png", depth)

    def wrong(picture: Floats) -> float:
        """Green px or dark ones, whichever are more."""
        if not np.isfinite(picture).all():
            return float("nan")
        return float(
            max(*(each[inner].sum() for each in (picture[..., 1] > 0.1, picture[..., 0] < 0.5)))
        )

    for degrees in (36,) if judge.quick else (20, 36, 45):
        turn, pose = np.radians(degrees), np.eye(4)
        pose[:3, :3] = [
            [np.cos(turn), 0, -np.sin(turn)],
            [0, 1, 0],
            [np.sin(turn), 0, np.cos(turn)],
        ]
        pose[:3, 3] = -pose[:3, :3] @ (ball.center - 4 * pose[2, :3])
        within = cv2.distanceTransform(ball.visible(pose).astype(np.uint8), cv2.DIST_L2, 5)
        inner = within > 1.5
        picture, call = moved(judge, matrix, pose)
        peers = {name: wrong(theirs) for name, theirs in by_peers(color, held, matrix, pose)}
        ours = wrong(np.broadcast_to(picture, (n, n, 3)))
        case = f"behind a ball turned by {degrees}: green or missing px"
        judge.add(case, ours, peers, calls=[call], unit="px", sign=-1, cpu=call.cpu)


def stereo(judge: Judge) -> None:
    """The right eye by a calibrated disparity file, and the left one from the right."""
    scene, size = Scene(judge.file(PHOTO)), (480, 270)
    matrix, right = matrix_of(*size), np.eye(4)
    right[0, 3] = -EYES
    eyes = {"left": Shot(matrix, np.eye(4), size), "right": Shot(matrix, right, size)}
    shots = {name: scene.render(eye) for name, eye in eyes.items()}
    for source, goal in (("left", "right"), ("right", "left")):
        color, depth = shots[source]
        write_png(judge.folder / "color.png", color)
        held = write_depth(judge.folder / "depth.png", matrix[0, 0] * EYES / depth, 256)
        eye = ("--eyes", "left") if source == "right" else ()
        words = ("--disparity-scale", 256, *eye, "-o", "out.png")
        call = judge.call("warp3d", "stereo", "color.png", "depth.png", *words)
        seen = scene.visible(eyes[goal], eyes[source]) > 0.999
        pose = eyes[goal].pose @ np.linalg.inv(eyes[source].pose)
        true, near = shots[goal][0], matrix[0, 0] * EYES / held
        peers = {
            name: db(theirs, true, seen)
            for name, theirs in by_peers(rounded(color), near, matrix, pose)
        }
        ours = np.nan if np.isnan(call.cpu) else db(shown(judge.folder / "out.png"), true, seen)
        judge.add(f"stereo, {source} to {goal}", ours, peers, calls=[call], cpu=call.cpu)


PARTS = (views, leaks, stereo)


def at_rest(scene: Scene, side: int) -> Iterator[Finding]:
    """Peers without motion give the picture back, but for px that a mesh has cut."""
    shot = Shot(matrix_of(side, side), np.eye(4), (side, side))
    color, depth = scene.render(shot)
    for name, picture in by_peers(color, depth, shot.matrix, np.eye(4)):
        if name != "mesh 4 x 4":  # whose samples lie between px centers
            drawn = np.asarray(picture.any(-1))
            drawn[[0, -1]] = drawn[:, [0, -1]] = False
            score = db(picture, color, drawn)
            text = f"{name} without motion: {score:.1f} dB in {100 * drawn.mean():.1f} % of the px"
            yield Finding(text, score > 100 and bool(drawn.mean() > 0.8))


def check(judge: Judge) -> Iterator[Finding]:
    """The projection against the scene's own depth, peers at rest, and rays doubled."""
    scene, side = Scene(judge.file(PHOTO)), 160
    home = Shot(matrix_of(side, side), np.eye(4), (side, side))
    aside = home._replace(pose=VIEWS["side"])
    (color, depth), (moved_color, moved_depth) = scene.render(home), scene.render(aside)
    u, v, ahead = projected(depth, home.matrix, aside.pose)
    row, column = (np.clip(np.floor(each), 0, side - 1).astype(int) for each in (v, u))
    seen = scene.visible(aside, home) > 0.999
    off = float(np.median(np.abs(ahead / moved_depth[row, column] - 1)[seen[row, column]]))
    text = f"projected depths and those of the new view: median difference {off:.1e}"
    yield Finding(text, off < 5e-3)
    yield from at_rest(scene, side)
    score = db(color, scene.render(home, 16)[0])
    yield Finding(f"8 rays to 16: {score:.1f} dB", score > 35)
    place = np.float32(u - 0.5), np.float32(v - 0.5)
    back = cv2.remap(np.float32(moved_color), *place, cv2.INTER_LINEAR)
    both = scene.visible(home, aside) > 0.999
    score, beside = db(back, color, both), db(np.roll(back, 1, 1), color, both)
    text = f"the new view, looked up at the projected places: {score:.1f} dB"
    yield Finding(f"{text}; a px beside: {beside:.1f} dB", score > beside + 3)
