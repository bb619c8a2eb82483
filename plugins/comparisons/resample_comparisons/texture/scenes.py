"""Test views for comparing methods, their ray-cast truth, and generated pictures."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles, Floats
from resample_texture.geometry.mappings import Homography, source_coordinates
from resample_texture.geometry.matrices import from_corners, page_corners

Mask = NDArray[np.bool_]

SMALLEST_SIDE = 1024  # texels; smaller pictures are tiled with their mirror images
LARGEST_SIDE = 4096  # texels; the truth of larger pictures takes minutes
RAYS = 16  # per side of a pixel
FINER = 2  # times the resolution of a generated picture, used for its truth
BLOCK = 32  # target rows per pass
FRAME = 6  # px around the target that are not measured
REACH = 3.0  # target px that filters may extend around a pixel
MARGIN = 2.0  # texels at the source's edges that are not measured
NEAR = {"floor": 8, "floor-yaw": 8, "floor-close": 16}  # the near edge shows 1 / n of the width
NAMES = (*NEAR, "zoom", "shrink")


class ComparedView(NamedTuple):
    """A picture, the view and the size of the target."""

    source: Floats  # (H, W, C)
    geometry: Homography
    shape: tuple[int, int]  # of the target, px
    fine: Floats | None = None  # (n H, n W, C), the source's texels are means of its texels


def scene_of(
    picture: Floats,
    name: str,
    size: tuple[int, int] | None = None,
    fine: Floats | None = None,
) -> ComparedView:
    """Return a view of a picture, by name or by matrix.

    Parameters
    ----------
    picture
        (H, W, C). Named scenes tile a small one with its mirror images until a side has
        `SMALLEST_SIDE` texels.
    name
        `floor`: from 4 × 4 px per texel nearby to 1/2 × 1/16 far away; `floor-yaw`: the same, with
        the picture rotated by 30 degrees; `floor-close`: from 8 × 8 px to 1/2 × 1/32; `zoom`:
        enlarged 3 times and rotated by 15 degrees; `shrink`: scaled by 0.3 and rotated by 15
        degrees; or a matrix, see `parse_matrix`.
    """
    if max(picture.shape[:2]) > LARGEST_SIDE:
        raise ValueError(
            f"a picture of {picture.shape[1]} x {picture.shape[0]} pixels; scenes take "
            f"{LARGEST_SIDE} along a side at most"
        )
    if name not in NAMES:
        shape = size or (picture.shape[0], picture.shape[1])
        return ComparedView(picture, _matrix(name), shape, fine)
    source = picture if fine is not None else tiled(picture)
    height, width = source.shape[:2]
    shape = size or (max(1, height // 2), max(1, width // 2))
    matrix = _view(name, (height, width))
    scale = np.diag([2.0 * shape[1] / width, 2.0 * shape[0] / height, 1.0])
    return ComparedView(source, Homography(scale @ matrix), shape, fine)


def check_scene(name: str) -> None:
    """Reject a name that `scene_of` would refuse, before any work is done."""
    if name not in NAMES:
        _matrix(name)


def tiled(picture: Floats) -> Floats:
    """Tile a picture with its mirror images to `SMALLEST_SIDE` texels along a side."""
    while max(picture.shape[:2]) < SMALLEST_SIDE:
        picture = np.concatenate([picture, picture[:, ::-1]], axis=1)
        picture = np.concatenate([picture, picture[::-1]], axis=0)
    return np.ascontiguousarray(picture)


def truth(
    scene: ComparedView, kind: str = "box", progress: Callable[[float], None] | None = None
) -> Floats:
    """Render a scene by 16 × 16 rays per pixel, in float64.

    Rays hit the texels of the fine picture, or those of the source, which are their means, where
    rays would skip fine texels. Without a fine picture the source is interpolated by a spline whose
    means over texels are the texels.

    `kind`: pixel filter: `box`, the pixel's area; or `gaussian` of σ 0.5 px, cut at 2 px.
    `progress`: called with the share that is done. Result: (H, W, C) float32.
    """
    tap = _taps(kind)
    if scene.fine is None:
        return _cast(scene, _coefficients(scene.source), 5, tap, progress)
    coarse = _cast(scene, scene.source, 1, tap, None)
    fine = _cast(scene, scene.fine, 1, tap, progress)
    step = scene.fine.shape[0] / scene.source.shape[0]
    skips = _scales(scene)[0] * RAYS < step
    return np.where(skips[..., None], coarse, fine)


def _coefficients(source: Floats) -> Floats:
    """Return coefficients of a spline of degree 4 with the source as texel means."""
    from scipy.ndimage import spline_filter1d

    for axis in (0, 1):  # means of degree 4 are values of degree 5
        source = spline_filter1d(source, 5, axis, np.float32, "reflect")
    return source


def _cast(
    scene: ComparedView,
    texels: Floats,
    count: int,
    tap: Doubles,
    progress: Callable[[float], None] | None,
) -> Floats:
    """Cast rays into texels that stand for the source, `count` texels per ray."""
    from resample.engine.jit import threads
    from resample_comparisons.texture.kernels.truth import cast_rows

    source = np.ascontiguousarray(texels, np.float32)
    matrix = scene.geometry.oriented((scene.source.shape[0], scene.source.shape[1]))
    finer = [source.shape[1] / scene.source.shape[1], source.shape[0] / scene.source.shape[0], 1.0]
    inverse = np.diag(finer) @ np.linalg.inv(matrix)
    height, width = scene.shape
    before = (tap.size - RAYS) // 2
    picture = np.empty((height, width, source.shape[2]), np.float32)
    for top in range(0, height, BLOCK):
        lines = min(BLOCK, height - top)
        y = top + (np.arange(-before, lines * RAYS + before) + 0.5) / RAYS
        rows = np.zeros((y.size, width, source.shape[2]))
        with threads(None):
            cast_rows(source, count, inverse, y, tap, RAYS, rows)
        part = sum(tap[n] * rows[n : n + lines * RAYS : RAYS][:lines] for n in range(tap.size))
        picture[top : top + lines] = part
        if progress is not None:
            progress((top + lines) / height)
    return picture


def zones(scene: ComparedView) -> dict[str, Mask]:
    """Classify pixels (H, W) by the scale of texels there; all lie well inside the source.

    Result: `whole`, and the zones that are not empty: `minified` (texels shrink along both axes),
    `magnified` (texels grow along both axes) and `mixed`.
    """
    is_inside = _inside(scene)
    if not is_inside.any():
        raise ValueError("no pixel of the scene looks into the picture; give another matrix")
    least, most = _scales(scene)
    masks = {
        "whole": is_inside,
        "minified": is_inside & (most < 1.0),
        "mixed": is_inside & (most >= 1.0) & (least < 1.0),
        "magnified": is_inside & (least >= 1.0),
    }
    return {name: mask for name, mask in masks.items() if mask.any()}


def checker(side: int = 1024, square: int = 8) -> Floats:
    """Make a black and white checkerboard (side, side, 1), linear light."""
    line = np.arange(side) // square
    return ((line[:, None] + line) % 2)[..., None].astype(np.float32)


def means(fine: Floats, step: int = FINER) -> Floats:
    """Average step × step texels of a fine picture, as a camera would; (H, W, C)."""
    height, width, channels = fine.shape
    split = fine.reshape(height // step, step, width // step, step, channels)
    return np.asarray(split.mean(axis=(1, 3)), np.float32)


def bricks(side: int = 1024) -> Floats:
    """Make a brick wall (side, side, 3), linear light, with grain at all scales."""
    rng = np.random.default_rng(2003)
    row, column = np.mgrid[0:side, 0:side] / side
    course = np.floor(row * 16).astype(np.int64)
    along = column * 8 + 0.5 * (course % 2)
    brick = np.floor(along).astype(np.int64) % 8
    tone = rng.uniform(0.6, 1.3, (16, 8))[course, brick]
    edge = np.minimum(np.minimum(row * 16 % 1, 1 - row * 16 % 1) / 2, along % 1)
    edge = np.minimum(edge, 1 - along % 1)
    grain = _grain(side, rng)
    is_mortar = edge + 0.02 * (grain - 0.5) < 0.035
    red = np.array([0.36, 0.12, 0.07]) * tone[..., None] * (0.55 + 0.9 * grain[..., None])
    gray = np.array([0.52, 0.50, 0.45]) * (0.7 + 0.6 * grain[..., None])
    return np.clip(np.where(is_mortar[..., None], gray, red), 0.0, 1.0).astype(np.float32)


def _grain(side: int, rng: np.random.Generator) -> Doubles:
    """Make noise of many scales, 0..1, (side, side)."""
    total = np.zeros((side, side))
    size = 4
    while size <= side:
        cells = rng.random((size, size))
        count = -(-side // size)
        total += np.repeat(np.repeat(cells, count, 0), count, 1)[:side, :side]
        size *= 2
    low, high = total.min(), total.max()
    return np.asarray((total - low) / (high - low))


def _matrix(name: str) -> Homography:
    from resample_texture.geometry.matrices import homography, parse_matrix

    if not Path(name).exists() and any(letter.isalpha() for letter in name.replace("e", "")):
        raise ValueError(f"unknown scene {name!r}; known: {', '.join(NAMES)}, or give a matrix")
    return homography(parse_matrix(name))


def _view(name: str, shape: tuple[int, int]) -> Doubles:
    """Return a named scene's matrix from a source to a target of half its size."""
    height, width = shape
    half = height / 2, width / 2
    if name in NEAR:
        near = (1 + 1 / NEAR[name]) / 2 * width, (1 - 1 / NEAR[name]) / 2 * width
        ends = np.array([[0, 0], [width, 0], [near[0], height], [near[1], height]])
        floor = from_corners(ends, page_corners((1, 1)) * half[::-1]).matrix
        pivot = width / 2, height * 700 / 1024
        return floor @ _turned(30.0, pivot, pivot) if name == "floor-yaw" else floor
    scale = 3.0 if name == "zoom" else 0.3
    return _turned(15.0, (width / 2, height / 2), (half[1] / 2, half[0] / 2), scale)


def _turned(
    degrees: float, center: tuple[float, float], goal: tuple[float, float], scale: float = 1.0
) -> Doubles:
    """Return the matrix that rotates and scales about a point and moves it to a goal."""
    angle = np.radians(degrees)
    cosine, sine = scale * np.cos(angle), scale * np.sin(angle)
    (x, y), (goal_x, goal_y) = center, goal
    return np.array(
        [
            [cosine, -sine, goal_x - cosine * x + sine * y],
            [sine, cosine, goal_y - sine * x - cosine * y],
            [0.0, 0.0, 1.0],
        ]
    )


def _taps(kind: str) -> Doubles:
    """Return the weights of the rays across a pixel filter, with sum 1."""
    if kind == "box":
        return np.full(RAYS, 1.0 / RAYS)
    if kind != "gaussian":
        raise ValueError(f"truth {kind!r}; known: box, gaussian")
    distance = (np.arange(-2 * RAYS, 2 * RAYS) + 0.5) / RAYS
    weight = np.exp(-0.5 * (distance / 0.5) ** 2)
    return np.asarray(weight / weight.sum())


def _inside(scene: ComparedView) -> Mask:
    """Return the pixels with filters within the source."""
    height, width = scene.source.shape[:2]
    mask = np.ones(scene.shape, np.bool_)
    for right in (-REACH, 0.0, REACH):
        for down in (-REACH, 0.0, REACH):
            shift = np.array([[1, 0, -right], [0, 1, -down], [0, 0, 1.0]])
            moved = Homography(shift @ scene.geometry.oriented((height, width)), is_signed=True)
            x, y = source_coordinates(moved, scene.shape)
            mask &= (x > MARGIN) & (x < width - MARGIN) & (y > MARGIN) & (y < height - MARGIN)
    frame = np.zeros(scene.shape, np.bool_)
    frame[FRAME:-FRAME, FRAME:-FRAME] = True
    return np.asarray(mask & frame)


def _scales(scene: ComparedView) -> tuple[Doubles, Doubles]:
    """Return least and largest texel scale per pixel: singular values of ∂(x, y)/∂(u, v)."""
    size = scene.source.shape[0], scene.source.shape[1]
    h = scene.geometry.oriented(size)
    u, v = source_coordinates(scene.geometry, scene.shape, size)
    d = h[2, 0] * u + h[2, 1] * v + h[2, 2]
    x = (h[0, 0] * u + h[0, 1] * v + h[0, 2]) / d
    y = (h[1, 0] * u + h[1, 1] * v + h[1, 2]) / d
    xu, xv = (h[0, 0] - x * h[2, 0]) / d, (h[0, 1] - x * h[2, 1]) / d
    yu, yv = (h[1, 0] - y * h[2, 0]) / d, (h[1, 1] - y * h[2, 1]) / d
    total = xu**2 + xv**2 + yu**2 + yv**2
    root = np.sqrt(np.maximum(total**2 - 4.0 * (xu * yv - xv * yu) ** 2, 0.0))
    return np.sqrt(np.maximum(total - root, 0.0) / 2), np.sqrt((total + root) / 2)
