"""Pictures of 8 bits, warped and resized by commands, against area means of a finer scene.

Scene: a photograph of 4 x 4 more pixels, in linear light, bilinear between its texels. Source: its
means over the source's pixels, rounded to 8 bits. Truth: its means over the target's pixels, never
rounded. Compared is what a screen shows (sRGB levels). Peers get the same 8 bits.
"""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from benchmarks.scores.judging import Booleans, Bytes, Call, Finding, Floats, Judge, db
from benchmarks.scores.pictures import eight_bits, read_png, to_levels, to_light, write_png

FACTOR = 4  # texels of the scene per source pixel and side
MARGIN = 8  # source px at the border that are not scored
PHOTOS = {  # side of the source, px; top and left of the scene, px
    "kodim19": (120, 260, 20),
    "kodim23": (120, 20, 60),
    "flower_foveon": (240, 0, 400),
    "skimage_astronaut": (120, 0, 20),
}
SIZES = {"larger 1.5": 1.5, "larger 3": 3.0, "smaller 1.5": 2 / 3, "smaller 3.75": 4 / 15}
FLAGS = {
    "cv2 linear": cv2.INTER_LINEAR,
    "cv2 cubic": cv2.INTER_CUBIC,
    "cv2 lanczos4": cv2.INTER_LANCZOS4,
}
CENTERS = np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1.0]])  # px corners to OpenCV's centers
IDENTICAL = ("identity warp", "resize to the same size", "rotate by 90 degrees")


def about(side: float, angle: float = 0, scale: float = 1, tilt: float = 0) -> Floats:
    """Source to target about the center; pixel (0, 0) covers [0, 1) x [0, 1)."""
    cos, sin = scale * np.cos(np.radians(angle)), scale * np.sin(np.radians(angle))
    turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, tilt, 1]])
    move = np.array([[1, 0, side / 2], [0, 1, side / 2], [0, 0, 1]])
    return np.asarray(move @ turn @ np.linalg.inv(move))


def means(
    scene: NDArray[np.float32], matrix: Floats, size: tuple[int, int], rays: int = 12
) -> tuple[Floats, Booleans]:
    """Means of the scene over target pixels, and where they are known.

    `size` is width and height. `rays` are those along a side of a pixel, two for each texel of the
    scene or more.
    """
    back, side = np.linalg.inv(matrix), scene.shape[0] / FACTOR
    total = np.zeros((size[1], size[0], scene.shape[2]))
    known = np.ones((size[1], size[0]), bool)
    rows, columns = np.mgrid[0 : size[1], 0 : size[0]].astype(float)
    for ray in range(rays * rays):
        x, y = columns + (ray % rays + 0.5) / rays, rows + (ray // rays + 0.5) / rays
        w = back[2, 0] * x + back[2, 1] * y + back[2, 2]
        u, v = ((back[r, 0] * x + back[r, 1] * y + back[r, 2]) / w for r in (0, 1))
        known &= (u > MARGIN) & (u < side - MARGIN) & (v > MARGIN) & (v < side - MARGIN) & (w > 0)
        place = np.float32(u * FACTOR - 0.5), np.float32(v * FACTOR - 0.5)
        total += cv2.remap(scene, *place, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    return total / rays**2, known


def read_scene(path: Path) -> tuple[NDArray[np.float32], int]:
    """A photograph's part in linear light, and the side of its source, px."""
    side, top, left = PHOTOS[path.stem]
    picture = np.asarray(Image.open(path).convert("RGB"), np.float32) / 255
    part = picture[top : top + FACTOR * side, left : left + FACTOR * side]
    return to_light(part).astype(np.float32), side


def warps(side: int) -> dict[str, Floats]:
    """Matrices, source to target, by name."""
    return {
        "shift 1/2": np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1.0]]),
        "rotate 7": about(side, 7),
        "perspective": about(side, 3, 0.95, 0.2 / side),
    }


def warped_by_peers(source: Bytes, matrix: Floats) -> dict[str, Bytes]:
    """Pictures of OpenCV and Pillow."""
    size = source.shape[1::-1]
    theirs = CENTERS @ matrix @ np.linalg.inv(CENTERS)
    made = {
        name: cv2.warpPerspective(source, theirs, size, flags=flag, borderMode=cv2.BORDER_REFLECT)
        for name, flag in FLAGS.items()
    }
    back = np.linalg.inv(matrix)
    numbers = (back / back[2, 2]).ravel()[:8].tolist()
    cubic = Image.Resampling.BICUBIC
    turned = Image.fromarray(source).transform(size, Image.Transform.PERSPECTIVE, numbers, cubic)
    return made | {"Pillow bicubic": np.asarray(turned)}


def resized_by_peers(source: Bytes, side: int) -> dict[str, Bytes]:
    """Pictures of OpenCV and Pillow."""
    made = {
        name: cv2.resize(source, (side, side), interpolation=flag)
        for name, flag in {**FLAGS, "cv2 area": cv2.INTER_AREA}.items()
    }
    picture = Image.fromarray(source)
    for name in ("BICUBIC", "LANCZOS", "BOX"):
        resized = picture.resize((side, side), Image.Resampling[name])
        made[f"Pillow {name.lower()}"] = np.asarray(resized)
    return made


def beads(picture: Bytes, source: Bytes) -> float:
    """Share of target px, %, more than 8 levels beyond the 5 x 5 source texels around."""
    times, window = picture.shape[0] // source.shape[0], np.ones((5, 5), np.uint8)
    beyond = np.zeros(picture.shape[:2], bool)
    for c in range(3):
        low, high = (
            around(source[..., c], window).repeat(times, 0).repeat(times, 1).astype(int)
            for around in (cv2.erode, cv2.dilate)
        )
        beyond |= (picture[..., c] < low - 8) | (picture[..., c] > high + 8)
    edge = MARGIN * times
    return float(100 * beyond[edge:-edge, edge:-edge].mean())


class Tally:
    """Scores of single photographs, by case."""

    def __init__(self) -> None:
        self.scores: dict[str, list[dict[str, float]]] = {}
        self.calls: dict[str, list[Call]] = {}

    def add(self, case: str, scores: dict[str, float], call: Call) -> None:
        """Keep the scores of one photograph, ours and peers'."""
        self.scores.setdefault(case, []).append(scores)
        self.calls.setdefault(case, []).append(call)

    def mean(self, case: str) -> tuple[float, dict[str, float]]:
        """Ours and peers' scores, means over the photographs."""
        found = self.scores[case]
        mean = {name: float(np.mean([one[name] for one in found])) for name in found[0]}
        return mean.pop("ours"), mean


def photographs(judge: Judge) -> None:
    """Warps, sizes, beads and identities of photographs."""
    tally, beaded, same = Tally(), Tally(), Tally()
    for name in list(PHOTOS)[:1] if judge.quick else PHOTOS:
        scene, side = read_scene(judge.file(f"textures/{name}.png"))
        source = eight_bits(to_levels(means(scene, np.eye(3), (side, side))[0]))
        write_png(judge.folder / "source.png", source)
        _score_warps(judge, scene, source, tally)
        _score_sizes(judge, scene, source, tally, beaded)
        _score_identities(judge, source, same)
    for case in tally.scores:
        count = len(tally.scores[case])
        ours, peers = tally.mean(case)
        judge.add(f"{case}, mean of {count} photographs", ours, peers, calls=tally.calls[case])
    single = [one for scores in tally.scores.values() for one in scores]
    lost = sum(
        one["ours"] < max(score for name, score in one.items() if name != "ours") - 0.005
        for one in single
    )
    calls = [call for case in tally.calls.values() for call in case]
    case = f"single cells below the best peer, of {len(single)}"
    judge.add(case, lost, {"asked": 0}, calls=calls, unit="cells", sign=-1)
    ours, peers = beaded.mean("beads")
    case = "beads, 3 x larger: px out of their surroundings"
    judge.add(case, ours, peers, calls=beaded.calls["beads"], unit="% px", sign=-1)
    for case in IDENTICAL:
        equal = [one["ours"] for one in same.scores[case]]
        case_of = f"{case}: photographs with equal bits"
        asked, calls = {"asked": len(equal)}, same.calls[case]
        judge.add(case_of, sum(equal), asked, calls=calls, unit="files", sign=0)


def _score_warps(judge: Judge, scene: NDArray[np.float32], source: Bytes, tally: Tally) -> None:
    side = source.shape[0]
    for case, matrix in warps(side).items():
        light, known = means(scene, matrix, (side, side))
        true, numbers = to_levels(light), ",".join(f"{v:.12g}" for v in matrix.ravel())
        size = f"{side}x{side}"
        call = judge.call(
            "texture", "warp", "source.png", f"--matrix={numbers}", "--size", size, "-o", "out.png"
        )
        ours = db(read_png(judge.folder / "out.png")[0], true, known)
        peers = warped_by_peers(source, matrix)
        scores = {name: db(picture / 255, true, known) for name, picture in peers.items()}
        tally.add(case, {"ours": ours, **scores}, call)


def _score_sizes(
    judge: Judge, scene: NDArray[np.float32], source: Bytes, tally: Tally, beaded: Tally
) -> None:
    for case, scale in SIZES.items():
        n = round(source.shape[0] * scale)
        rays = max(12, round(2 * FACTOR / scale))
        light, known = means(scene, np.diag([scale, scale, 1.0]), (n, n), rays)
        true = to_levels(light)
        call = judge.call("texture", "resize", "source.png", "out.png", "--size", f"{n}x{n}")
        made = {"ours": eight_bits(read_png(judge.folder / "out.png")[0])}
        made |= resized_by_peers(source, n)
        scores = {name: db(picture / 255, true, known) for name, picture in made.items()}
        tally.add(case, scores, call)
        if case == "larger 3":
            compared = ("ours", "cv2 lanczos4", "cv2 cubic")
            beaded.add("beads", {name: beads(made[name], source) for name in compared}, call)


def _score_identities(judge: Judge, source: Bytes, same: Tally) -> None:
    size = f"{source.shape[1]}x{source.shape[0]}"
    calls = (
        judge.call("texture", "warp", "source.png", "--matrix=1,0,0,0,1,0", "-o", "same.png"),
        judge.call("texture", "resize", "source.png", "size.png", "--size", size),
        judge.call("texture", "rotate", "source.png", "turned.png", "--degrees", 90),
    )
    wanted = {"same.png": source, "size.png": source, "turned.png": np.rot90(source)}
    for case, call, (name, want) in zip(IDENTICAL, calls, wanted.items(), strict=True):
        made = eight_bits(read_png(judge.folder / name)[0])
        same.add(case, {"ours": float(np.array_equal(made, want))}, call)


def thumbnail(judge: Judge) -> None:
    """A thumbnail of a JPEG of 12 Mpx: whole processes, start included."""
    photo = Image.open(judge.file("textures/flower_foveon.png")).convert("RGB")
    large = photo.resize((4000, 3000), Image.Resampling.BICUBIC)
    large.save(judge.folder / "large.jpg", quality=92)
    pillow = (
        "from PIL import Image; i = Image.open('large.jpg'); i.thumbnail((400, 400)); "
        "i.save('t.png')"
    )
    opencv = (
        "import cv2; i = cv2.imread('large.jpg'); "
        "cv2.imwrite('t.png', cv2.resize(i, (400, 300), interpolation=cv2.INTER_AREA))"
    )
    took: dict[str, list[float]] = {"ours": [], "Pillow thumbnail": [], "cv2 area": []}
    for _ in range(2 if judge.quick else 4):
        call = judge.call("texture", "resize", "large.jpg", "small.png", "--size", 400)
        took["ours"].append(call.cpu)
        took["Pillow thumbnail"].append(judge.python("-c", pillow)[0])
        took["cv2 area"].append(judge.python("-c", opencv)[0])
    peers = {name: float(np.median(times[1:])) for name, times in took.items()}
    case = "thumbnail of a 12 Mpx JPEG, whole process"
    judge.add(case, peers.pop("ours"), peers, calls=[call], unit="CPU s", sign=-1)


def fast_warp(judge: Judge) -> None:
    """`warp` of an array of 1 Mpx, as users write it, after the first call."""
    program, photo = Path(__file__).with_name("timed_warp.py"), judge.file("textures/kodim19.png")
    _, printed = judge.python("-P", program, photo, 5 if judge.quick else 9)
    ours, peer = (1000 * float(seconds) for seconds in printed.split())
    case = "warp of a 1 Mpx array of 8 bits, later calls"
    call = Call(f"python benchmarks/scores/timed_warp.py {photo.name}", ours)
    judge.add(case, ours, {"cv2 lanczos4": peer}, calls=[call], unit="CPU ms", sign=-1)


PARTS = (photographs, thumbnail, fast_warp)


def wave() -> Finding:
    """A scene of waves, whose means have a closed form."""
    side, rate = 60, (0.31, 0.17)
    y, x = np.mgrid[0 : FACTOR * side, 0 : FACTOR * side] / FACTOR + 0.5 / FACTOR
    scene = (0.5 + 0.4 * np.cos(rate[0] * x + rate[1] * y)).astype(np.float32)
    matrix = about(side, 7, 1.5)
    found, known = means(scene[..., None].repeat(3, 2), matrix, (side, side))
    back = np.linalg.inv(matrix)
    rows, columns = np.mgrid[0:side, 0:side] + 0.5
    u, v = (back[r, 0] * columns + back[r, 1] * rows + back[r, 2] for r in (0, 1))
    across, down = (rate[0] * back[0, n] + rate[1] * back[1, n] for n in (0, 1))
    sinc = np.sinc(np.array([*rate]) / FACTOR / 2 / np.pi)
    damped = 0.4 * np.prod(sinc**2)  # bilinear between texels
    damped *= np.sinc(across / 2 / np.pi) * np.sinc(down / 2 / np.pi)
    true = 0.5 + damped * np.cos(rate[0] * u + rate[1] * v)
    score = db(found[..., 0], true, known)
    text = f"wave, rotated and 1.5 x larger: {score:.1f} dB to the closed form"
    return Finding(text, score > 60)


def check(judge: Judge) -> Iterator[Finding]:
    """Means in closed form, and more rays."""
    yield wave()
    scene, side = read_scene(judge.file("textures/kodim19.png"))
    pictures = {
        rays: to_levels(means(scene, about(side, 7), (side, side), rays)[0])
        for rays in (12, 24, 40)
    }
    for rays in (12, 24):
        score = db(pictures[rays], pictures[40])
        yield Finding(f"{rays} rays to 40: {score:.1f} dB", score > 55)
