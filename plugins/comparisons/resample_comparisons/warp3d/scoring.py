"""Quality measures of a warped depth image against the true view.

All pictures here are (H, W, 3) as a screen shows them: sRGB-encoded, 0..1. Only pixels of a mask
count, usually those that the source sees; holes among them count as black. Colors are scored twice:
divided by their coverage, as compositors get them, and over black, as films and JPEG show them.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.measuring.quality import psnr, ssim
from resample.types import Doubles, Floats

Mask = NDArray[np.bool_]  # (H, W)
Screen = NDArray[np.floating]  # (H, W, 3) sRGB-encoded, 0..1

STEP = 0.03  # of the depth: larger steps within a pixel, or to its neighbour, are edges
NEAR_EDGE = 2  # px
HIGHEST = 100.0  # dB of a component without error in IV-PSNR

# Y, Cb, Cr of encoded R, G, B (ITU-R BT.709), and their weights in IV-PSNR.
TO_YCBCR = np.array(
    [[0.2126, 0.7152, 0.0722], [-0.1146, -0.3854, 0.5], [0.5, -0.4542, -0.0458]], np.float32
)
COMPONENT_WEIGHT = np.array([4.0, 1.0, 1.0]) / 6.0
BLOCK = 2  # px, largest shift of a match
UNNOTICEABLE = 0.01  # invisible offset of a whole component


class ScoringTarget(NamedTuple):
    """True picture of a view, and the pixels that count."""

    truth: Screen  # (H, W, 3)
    mask: Mask  # (H, W) pixels that count: the source sees them fully
    edge: Mask  # (H, W) pixels near a step in depth


class WarpedScreen(NamedTuple):
    """A warped picture as a screen shows it."""

    image: Screen  # (H, W, 3) colors divided by their coverage; values in holes are ignored
    covered: Mask  # (H, W) pixels that are not holes
    over_black: Screen  # (H, W, 3)

    @property
    def with_holes(self) -> Screen:
        """Colors divided by their coverage; holes are black."""
        return np.where(self.covered[..., None], self.image, np.float32(0))


def score(screen: WarpedScreen, target: ScoringTarget) -> dict[str, float | None]:
    """Return all measures of one picture.

    Result: `psnr`, `black psnr` (over black) and `edge psnr` in dB, `ssim`, `iv-psnr` in dB and
    `hole %`; `edge psnr` is None if no pixel that counts is near an edge.
    """
    image = screen.with_holes
    at_edge = target.mask & target.edge
    return {
        "psnr": psnr(image, target.truth, mask=target.mask),
        "black psnr": psnr(screen.over_black, target.truth, mask=target.mask),
        "edge psnr": psnr(image, target.truth, mask=at_edge) if at_edge.any() else None,
        "ssim": masked_ssim(image, target.truth, target.mask),
        "iv-psnr": iv_psnr(image, target.truth, target.mask),
        "hole %": hole_percent(screen.covered, target.mask),
    }


def delivered(image: Floats, coverage: Floats) -> tuple[Floats, Mask]:
    """Divide colors by their coverage; also return the pixels that are not holes.

    `image`: (H, W, C) multiplied by the coverage. `coverage`: (H, W) 0..1. Result: colors (H, W,
    C), 0 in holes, and (H, W) true where there is coverage.
    """
    covered = coverage > 0
    share = np.where(covered, coverage, np.float32(1))[..., None]
    return np.where(covered[..., None], image / share, np.float32(0)), covered


def hole_percent(covered: Mask, mask: Mask) -> float:
    """Return the share of the mask's pixels that are holes, percent."""
    return 100.0 * float((mask & ~covered).sum() / mask.sum())


def masked_ssim(a: Screen, b: Screen, mask: Mask) -> float:
    """Return the SSIM of a mask's pixels; outside, the pictures count as equal."""
    alone = np.where(mask[..., None], a, b)
    return 1.0 - (1.0 - ssim(alone, b)) / float(mask.mean())


def iv_psnr(a: Screen, b: Screen, mask: Mask | None = None) -> float:
    """Return the PSNR, dB, ignoring shifts of 2 px and a uniform color offset; inf if equal.

    Dziembowski, Mieloch, Stankowski and Grzelka, IV-PSNR: The Objective Quality Metric for
    Immersive Video Applications, 2022. Every pixel of one picture is compared with the most similar
    of 5 × 5 pixels of the other, after removing the difference of the means, up to 1 % per
    component. Y, Cb and Cr weigh 4 : 1 : 1 in the search and in the result, which is the lower of
    both directions. Here YCbCr has full resolution instead of 4 : 2 : 0.

    `a`, `b`: (H, W, 3). `mask`: (H, W) pixels that count; matches may be anywhere. None: all.
    """
    if mask is None:
        mask = np.ones(a.shape[:2], np.bool_)
    if np.array_equal(a[mask], b[mask]):
        return math.inf
    first, second = (
        np.asarray(np.asarray(picture, np.float32) @ TO_YCBCR.T, np.float32) for picture in (a, b)
    )
    difference = np.mean(second[mask] - first[mask], axis=0)
    offset: Floats = np.clip(difference, -UNNOTICEABLE, UNNOTICEABLE)
    return min(_one_way(first + offset, second, mask), _one_way(second - offset, first, mask))


def _one_way(image: Floats, other: Floats, mask: Mask) -> float:
    """Return the quality, dB, with each pixel compared to the most similar nearby one."""
    weight = COMPONENT_WEIGHT.astype(np.float32)
    least = np.full(image.shape[:2], np.inf, np.float32)
    best = np.zeros_like(image)
    for moved in _shifted(other, BLOCK):
        square = np.square(image - moved)
        total = square @ weight
        is_better = total < least
        least = np.where(is_better, total, least)
        best[is_better] = square[is_better]
    error = np.maximum(best[mask].mean(axis=0, dtype=np.float64), 10.0 ** (-HIGHEST / 10.0))
    return float(-10.0 * np.log10(error) @ COMPONENT_WEIGHT)


def _shifted(picture: Floats, reach: int) -> Iterator[Floats]:
    """Yield a picture shifted by up to `reach` px, with edge pixels repeated."""
    height, width = picture.shape[:2]
    around = np.pad(picture, ((reach, reach), (reach, reach), (0, 0)), mode="edge")
    for row in range(2 * reach + 1):
        for column in range(2 * reach + 1):
            yield around[row : row + height, column : column + width]


def near_steps(nearest: Doubles, farthest: Doubles) -> Mask:
    """Return the pixels within 2 px of one with depths that differ by more than 3 %."""
    return widened(farthest > nearest * (1.0 + STEP), NEAR_EDGE)


def widened(mask: Mask, reach: int) -> Mask:
    """Dilate a mask by `reach` px in rows, columns and diagonals."""
    import cv2

    square = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    return np.asarray(cv2.dilate(mask.astype(np.uint8), square) > 0)
