"""Pictures with fine structure, which reveal resampling errors."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.samples import DefaultOptions, SampleFiles
from resample.types import Doubles

Levels = NDArray[np.uint8]
SMALLEST, LARGEST = 16, 4096  # px of a side
TEXT = (
    "An image that is seen from elsewhere has to",
    "be sampled anew. Where its samples come to",
    "lie close to each other, they are points that",
    "add up in a pixel; where they move apart, the",
    "gaps between them are closed by splats.",
    "",
    "What is small on the screen is many, and what",
    "is large is few. So it pays to treat the two",
    "by different means: the many cheaply, and the",
    "few with care. A letter of this page that has",
    "become as small as a pixel is then still gray",
    "by the right amount, and one that has become",
    "large has a smooth outline.",
    "",
    "0 1 2 3 4 5 6 7 8 9   + - * / = ( ) < > % &",
    "The quick brown fox jumps over the lazy dog.",
)
CORNERS = ((133.0, 47.0), (517.0, 82.0), (596.0, 422.0), (57.0, 448.0))  # of the page, px


def mixed(x: NDArray[np.int64], y: NDArray[np.int64], seed: int = 0) -> Doubles:
    """Pseudo-random number from 0 to 1 for every pair of integers."""
    state = x.astype(np.uint32) * np.uint32(0x9E3779B1) + y.astype(np.uint32) * np.uint32(
        0x85EBCA77
    )
    state = state + np.uint32(seed * 0x27D4EB2F & 0xFFFFFFFF)
    for shift, factor in ((15, 0x2C1B3C6D), (12, 0x297A2D39), (15, 0x1)):
        state = (state ^ (state >> np.uint32(shift))) * np.uint32(factor)
    return np.asarray(state / np.float64(2**32))


def smooth(x: Doubles, y: Doubles, seed: int = 0) -> Doubles:
    """Smooth noise from 0 to 1 with features about 1 wide."""
    left, top = np.floor(x), np.floor(y)
    across, down = x - left, y - top
    across, down = across * across * (3 - 2 * across), down * down * (3 - 2 * down)
    column, row = left.astype(np.int64), top.astype(np.int64)
    upper = mixed(column, row, seed) * (1 - across) + mixed(column + 1, row, seed) * across
    lower = mixed(column, row + 1, seed) * (1 - across) + mixed(column + 1, row + 1, seed) * across
    return np.asarray(upper * (1 - down) + lower * down)


def rough(x: Doubles, y: Doubles, octaves: int = 4, seed: int = 0) -> Doubles:
    """Sum of noise at several octaves, from 0 to 1."""
    total = sum(smooth(x * 2**n, y * 2**n, seed + n) / 2**n for n in range(octaves))
    return np.asarray(total / (2 - 2 ** (1 - octaves)))


def grain(height: int, width: int, seed: int = 0) -> Doubles:
    """White noise (height, width) from 0 to 1."""
    rows, columns = np.mgrid[:height, :width]
    return mixed(columns, rows, seed)


class Photo(NamedTuple):
    """A photo of a flat object, and the positions of its corners."""

    color: Levels  # (H, W, 3) sRGB
    corners: tuple[tuple[float, float], ...]  # x, y in px, clockwise from the top left

    def stored(self, folder: Path, name: str) -> SampleFiles:
        from resample.samples.writing import write_png

        write_png(folder / f"{name}.png", self.color)
        corners = " ".join(f"{x:g},{y:g}" for x, y in self.corners)
        options = DefaultOptions(["rectify"], ["--corners", corners], ["--corners", "--settings"])
        return SampleFiles([f"{name}.png"], [options])


def bricks(size: int = 512) -> Levels:
    """A brick wall with thin mortar, which flickers when minified."""
    _check("bricks", size)
    y, x = (np.mgrid[:size, :size] + 0.5) / size
    row = np.floor(y * 16)
    along = x * 8 + 0.5 * (row % 2)
    number = np.floor(along)
    ripple = 0.05 * (rough(x * 40, y * 40, 2, 3) - 0.5)
    beside = np.minimum(along - number, number + 1 - along) / 8
    above = np.minimum(y * 16 - row, row + 1 - y * 16) / 16
    rim = np.minimum(beside, above) * 16 + ripple
    brick = np.clip((rim - 0.07) * 14, 0, 1)[..., None]
    kind = mixed((number % 8).astype(np.int64), row.astype(np.int64), 5)[..., None]
    pale = mixed((number % 8).astype(np.int64), row.astype(np.int64), 9)[..., None]
    fired = np.array([0.60, 0.27, 0.19]) * (1 - kind) + np.array([0.74, 0.42, 0.29]) * kind
    fired = np.where(pale > 0.9, 0.62 * fired + np.array([0.06, 0.04, 0.05]), fired)
    stains = rough(x * 22, y * 22, 5, 11)[..., None]
    fired = fired * (0.72 + 0.45 * stains) * (0.93 + 0.14 * grain(size, size, 2)[..., None])
    mortar = np.array([0.77, 0.74, 0.68]) * (0.78 + 0.3 * rough(x * 90, y * 90, 3, 21)[..., None])
    edge = np.clip((rim - 0.07) * 5, 0, 1)[..., None]  # bricks are rounded at their edges
    return _levels(brick * fired * (0.8 + 0.2 * edge) + (1 - brick) * mortar * 0.94)


def zone_plate(size: int = 512) -> Levels:
    """Rings that get finer down to 2 px: they show every error of a filter."""
    _check("zone-plate", size)
    y, x = np.mgrid[:size, :size] + 0.5 - size / 2
    wave = 0.5 + 0.5 * np.cos(np.pi / size * (x * x + y * y))  # half a cycle per px at the sides
    return _levels(np.repeat(_encoded(wave)[..., None], 3, axis=2))


def card(size: int = 512) -> Levels:
    """Test card: star, wedges, color bars and grays."""
    _check("test-card", size)
    fine = 2
    y, x = ((np.mgrid[: size * fine, : size * fine] + 0.5) / (size * fine)).astype(np.float32)
    seen = np.full((*x.shape, 3), 0.216, np.float32)
    lines = np.minimum((x * 16) % 1, (y * 16) % 1) < 0.045
    seen[lines] = 0.75
    # Add color bars at the top and grays at the bottom, in light.
    bars = np.array(
        [(1, 1, 1), (1, 1, 0), (0, 1, 1), (0, 1, 0), (1, 0, 1), (1, 0, 0), (0, 0, 1), (0, 0, 0)]
    )
    between = (x > 0.25) & (x < 0.75)
    number = np.clip((x - 0.25) * 16, 0, 7).astype(int)
    top, foot = between & (y > 0.0625) & (y < 0.1875), between & (y > 0.8125) & (y < 0.9375)
    seen[top] = 0.02 + 0.73 * bars[number[top]]
    seen[foot] = (number[foot, None] / 7.0) ** 2.2
    across, down = x - 0.5, y - 0.5
    radius, angle = np.hypot(across, down), np.arctan2(down, across)
    star = np.where(np.sin(36 * angle) > 0, 0.95, 0.02)
    star = np.where(radius < 0.02, 0.5, star)
    inside = radius < 0.235
    seen[inside] = star[inside, None]
    seen[(radius > 0.235) & (radius < 0.245)] = 0.95
    for corner_x in (0.125, 0.875):
        for corner_y in (0.125, 0.875):
            near = np.hypot(x - corner_x, y - corner_y)
            ring = 0.5 + 0.5 * np.cos(np.pi * size / 0.19 * near * near)
            disc = near < 0.095
            seen[disc] = ring[disc, None]
    few = seen.reshape(size, fine, size, fine, 3).mean(axis=(1, 3))
    return _levels(_encoded(few))


def page() -> Photo:
    """A printed page on a desk, photographed obliquely."""
    import cv2

    fine, height, width = 3, 480, 640
    sheet = _sheet()
    flat = np.array([(0, 0), (sheet.shape[1], 0), sheet.shape[1::-1], (0, sheet.shape[0])])
    where = (np.array(CORNERS) * fine - 0.5).astype(np.float32)
    place = cv2.getPerspectiveTransform((flat - 0.5).astype(np.float32), where)
    ink, cover = (
        cv2.resize(
            cv2.warpPerspective(each, place, (width * fine, height * fine)),
            (width, height),
            interpolation=cv2.INTER_AREA,
        )
        for each in (sheet, np.ones_like(sheet))
    )
    shadow = np.roll(cover, (5, 4), axis=(0, 1))
    shade = 1 - 0.5 * cv2.GaussianBlur(shadow, (0, 0), 6)
    y, x = np.mgrid[:height, :width] + 0.5
    lamp = 1.08 - 0.32 * np.hypot(x / width - 0.3, y / height - 0.2)
    paper = ink[..., None] * np.array([0.93, 0.90, 0.84])
    # Light of a wooden desk, (H, W, 3).
    board = np.floor(y / 96)
    fiber = rough(x / 190 + 7 * board, y / 5, 4, 41)
    ring = 0.5 + 0.5 * np.sin(26 * rough(x / 420 + 3 * board, y / 60, 2, 47))
    tone = (0.55 + 0.35 * fiber + 0.14 * ring)[..., None]
    gap = np.clip((np.abs(y - 96 * np.round(y / 96)) - 0.6) / 1.2, 0.25, 1)[..., None]
    desk = np.asarray(np.array([0.36, 0.19, 0.085]) * tone * gap) * shade[..., None]
    light = (paper + (1 - cover[..., None]) * desk) * lamp[..., None]
    noise = 0.012 * (grain(height, width, 31)[..., None] - 0.5)
    return Photo(_levels(_encoded(light) + noise), CORNERS)


def _sheet() -> Any:
    """The page in front view, (H, W) float32 light."""
    import cv2

    sheet = np.full((1360, 1000), 255, np.uint8)
    cv2.putText(sheet, "Points and Splats", (120, 150), cv2.FONT_HERSHEY_TRIPLEX, 2.1, 20, 4, 16)
    cv2.line(sheet, (120, 190), (880, 190), 60, 3, cv2.LINE_AA)
    for number, line in enumerate(TEXT):
        base = (120, 265 + 44 * number)
        cv2.putText(sheet, line, base, cv2.FONT_HERSHEY_COMPLEX, 0.98, 25, 2, cv2.LINE_AA)
    for number in range(64):  # lines that converge
        across = 120 + round(760 * (1 - (1 - number / 64) ** 1.8))
        cv2.line(sheet, (across, 1010), (across, 1150), 20, 3, cv2.LINE_AA)
    for ring in range(10):
        cv2.circle(sheet, (250, 1240), 8 + 6 * ring, 20, 2, cv2.LINE_AA)
    sheet[1180:1300, 380:880] = np.linspace(0, 255, 11)[None, np.arange(500) // 46]
    cv2.rectangle(sheet, (380, 1180), (879, 1299), 20, 2)
    return (0.03 + 0.97 * (sheet / 255.0) ** 2.2).astype(np.float32)


def _encoded(light: Doubles) -> Doubles:
    """Convert to sRGB levels 0..1."""
    from resample.colors import to_srgb

    return np.asarray(to_srgb(np.clip(light, 0, 1).astype(np.float32)))


def _levels(color: Doubles) -> Levels:
    return np.asarray(np.clip(color * 255 + 0.5, 0, 255).astype(np.uint8))


def _check(name: str, size: int) -> None:
    if not SMALLEST <= size <= LARGEST:
        raise ValueError(f"{name}: size is {SMALLEST} to {LARGEST} px, not {size}")
