"""Load real depth images with a true picture of another view.

A data folder contains a folder for each set, in which `calib.json` describes the files: rectified
pairs with one or two disparity maps, or frames with depth and poses.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from resample.cameras.files import left_out, read_poses
from resample.cameras.models import Camera
from resample.colors import to_srgb
from resample.files.images import read_image
from resample.reading.limits import neighbour
from resample.reading.texts import json_of, text_of
from resample.types import Doubles, Floats
from resample_warp3d.depth.encodings import BareDisparity, PlanarDepth
from resample_warp3d.depth.equation import between, inverse, of_rectified, places, warp_places
from resample_warp3d.depth.files import read_depth
from resample_warp3d.figures.scoring import NEAR_EDGE, Mask, ScoringTarget, Screen, widened
from resample_warp3d.types import DepthImage, Equation, Source

SAME_PX = 1.0  # px, tolerance between two disparity maps
SAME_DEPTH = 0.05  # relative tolerance between depths of two frames, as poses are not exact
FAR_OFF = 1e6  # px: positions farther out are dropped
CUT = 0.03  # of the nearness: larger steps between neighbours are edges

# Frames whose poses and depths agree, by file name; other sets use consecutive frames.
FRAMES: Mapping[str, Sequence[tuple[int, int]]] = {
    "iclnuim_livingroom": ((4, 1), (5, 1), (4, 5), (5, 4)),
    "open3d_rgbd": ((0, 2), (0, 4)),
}


class PicturePair(NamedTuple):
    """A depth image, and the true picture of a view to warp it to.

    Colors are sRGB-encoded, as in the files; they are warped and compared as such.
    """

    name: str
    image: DepthImage
    equation: Equation  # from the depth image to the picture
    truth: Screen  # (H, W, 3)
    mask: Mask  # (H, W) pixels of the picture that the depth image also shows

    def target(self) -> ScoringTarget:
        """Return the target for scores, with the depth image's edges in the picture's view."""
        shape = (self.truth.shape[0], self.truth.shape[1])
        return ScoringTarget(self.truth, self.mask, edges_in_view(self.image, self.equation, shape))


class PairView(NamedTuple):
    """A picture and the nearness of its pixels, if it has depth."""

    color: Floats  # (H, W, 3) sRGB-encoded
    nearness: Floats  # (H, W), or (0, 0)


def load_pairs(folder: str | Path) -> list[PicturePair]:
    """Load all pairs of a data folder, ordered by name."""
    found = sorted([*Path(folder).glob("calib.json"), *Path(folder).glob("*/calib.json")])
    if not found:
        raise ValueError(f"{folder} has no subfolder with a calib.json")
    return [pair for path in found for pair in _pairs_of(path)]


def expected_nearness(
    image: DepthImage | Source, equation: Equation, shape: tuple[int, int]
) -> Doubles:
    """Return the nearness in another view that a depth image predicts.

    `image`: depth image; each sample is spread over the 2 × 2 pixels around its position, or fewer
    if it hits pixel centers. `shape`: height and width of the view, px. Result: (H, W) of the
    nearest sample; 0 where none arrives: hidden, outside, or where neighbours are more than about 2
    pixels apart.
    """
    place, nearness = _warped(image, equation)
    found = np.zeros(shape)
    before, after = (rounded(place - 0.5).astype(np.int64) for rounded in (np.floor, np.ceil))
    for column in (before[:, 0], after[:, 0]):
        for row in (before[:, 1], after[:, 1]):
            inside = (column >= 0) & (row >= 0) & (column < shape[1]) & (row < shape[0])
            np.maximum.at(found, (row[inside], column[inside]), nearness[inside])
    return found


def edges_in_view(image: DepthImage | Source, equation: Equation, shape: tuple[int, int]) -> Mask:
    """Return the pixels of a view within 2 px of the near side of a depth edge."""
    nearness = np.where(_is_border(image.nearness), image.nearness, np.float32(0))
    rims = DepthImage(image.color, np.asarray(nearness, np.float32), image.place)
    return widened(expected_nearness(rims, equation, shape) > 0, NEAR_EDGE)


def _is_border(nearness: Floats) -> Mask:
    """Return the samples that are clearly nearer than one of their four neighbours."""
    around = np.pad(nearness, 1, mode="edge")
    farther = np.minimum(
        np.minimum(around[:-2, 1:-1], around[2:, 1:-1]),
        np.minimum(around[1:-1, :-2], around[1:-1, 2:]),
    )
    return np.asarray(farther < (1.0 - CUT) * nearness)


def _warped(image: DepthImage | Source, equation: Equation) -> tuple[Doubles, Doubles]:
    """Warp the samples with depth; return px (N, 2) and nearness (N,)."""
    where = places(DepthImage(image.color, image.nearness, image.place)).reshape(-1, 2)
    nearness = image.nearness.reshape(-1).astype(np.float64)
    known = nearness > 0
    place, there = warp_places(equation, where[known], nearness[known])
    valid = (np.abs(place) < FAR_OFF).all(axis=1)
    return place[valid], there[valid]


def _pairs_of(path: Path) -> Iterator[PicturePair]:
    """Yield the pairs that a `calib.json` describes."""
    facts = json_of(text_of(path))
    if "disp_left" in facts:
        return _stereo_pairs(path, facts)
    if "pose" in facts:
        return _frame_pairs(path, facts)
    raise ValueError(f"{path} names neither disparity maps (disp_left) nor poses (pose)")


def _stereo_pairs(path: Path, facts: Mapping[str, Any]) -> Iterator[PicturePair]:
    """Yield left to right, and right to left if the right view has a map."""
    left, right = (_stereo_frame(path, facts, side) for side in ("left", "right"))
    for name, source, target, fraction in (
        ("left to right", left, right, 1.0),
        ("right to left", right, left, -1.0),
    ):
        if source.nearness.size:
            title = f"{path.parent.name}: {name}"
            yield _pair(title, source, target, of_rectified(fraction), _same_disparity)


def _stereo_frame(path: Path, facts: Mapping[str, Any], side: str) -> PairView:
    """Read one view of a rectified pair; its nearness is the disparity in px."""
    color = _encoded(neighbour(path, str(facts[side])))
    stored = facts.get(f"disp_{side}")
    if stored is None:
        return PairView(color, np.empty((0, 0), np.float32))
    raw = read_depth(neighbour(path, str(stored).split()[0]))
    return PairView(color, BareDisparity(facts["disparity_scale"]).nearness(raw))


def _frame_pairs(path: Path, facts: Mapping[str, Any]) -> Iterator[PicturePair]:
    """Yield pairs of frames of a moving camera."""
    colors, depths = (
        sorted(file for file in neighbour(path, str(facts[kind]).partition("/")[0]).iterdir())
        for kind in ("color", "depth")
    )
    file = neighbour(path, str(facts["pose"]).split()[0].rstrip(":"))
    complaint = left_out(file, poses=True)
    if complaint is not None:
        raise ValueError(f"each picture needs its pose; {complaint}")
    numbers = [int(file.stem) for file in colors]
    cameras = [
        Camera.from_intrinsics(
            facts["fx"], facts["fy"], facts["cx"], facts["cy"], pose, convention="opencv"
        )
        for pose in read_poses(file)
    ]
    encoding = PlanarDepth(facts["depth_scale"])
    for first, second in FRAMES.get(path.parent.name) or itertools.pairwise(numbers):
        a, b = numbers.index(first), numbers.index(second)
        source, target = (
            PairView(_encoded(colors[n]), encoding.nearness(read_depth(depths[n]))) for n in (a, b)
        )
        equation = between(cameras[a], cameras[b])
        yield _pair(
            f"{path.parent.name}: {first} to {second}", source, target, equation, _same_depth
        )


def _pair(
    name: str, source: PairView, target: PairView, equation: Equation, same: Any
) -> PicturePair:
    """Make a pair whose mask holds the pixels that the source sees."""
    image = DepthImage(source.color, source.nearness, np.empty((0, 0, 2)))
    height, width = target.color.shape[:2]
    if target.nearness.size:
        mask = _cross_checked(image, target, equation, same)
    else:
        mask = expected_nearness(image, equation, (height, width)) > 0
    return PicturePair(name, image, equation, target.color, mask)


def _cross_checked(image: DepthImage, target: PairView, equation: Equation, same: Any) -> Mask:
    """Return the target's pixels whose points the source sees at the same nearness."""
    back = inverse(equation)
    start = places(DepthImage(target.color, target.nearness, np.empty((0, 0, 2))))
    place, expected = warp_places(back, start, target.nearness.astype(np.float64))
    height, width = image.nearness.shape
    known = (target.nearness > 0) & np.isfinite(place).all(axis=2)
    inside = known & ((place >= 0) & (place < (width, height))).all(axis=2)
    column, row = np.where(inside[..., None], place, 0.0).astype(np.int64).transpose(2, 0, 1)
    found = image.nearness[row, column]
    return np.asarray(inside & (found > 0) & same(found, expected))


def _same_disparity(a: Doubles, b: Doubles) -> Mask:
    return np.asarray(np.abs(a - b) <= SAME_PX)


def _same_depth(a: Doubles, b: Doubles) -> Mask:
    return np.asarray(np.abs(a - b) <= SAME_DEPTH * np.maximum(a, b))


def _encoded(path: Path) -> Floats:
    """Read a picture (H, W, 3) as stored, 0..1."""
    return np.ascontiguousarray(to_srgb(read_image(path))[..., :3], np.float32)
