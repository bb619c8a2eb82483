"""Paint targets of any camera model by the hybrid method, and classify their holes."""

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import Camera
from resample.cameras.panoramic import Equirectangular, check_panorama, rays_at, turn
from resample.cameras.pixels import pixel_centers
from resample.profiles.filters import PixelFilter
from resample.types import Doubles, Floats
from resample_warp3d.methods.filtering import filtered
from resample_warp3d.methods.hybrid import Hybrid, empty
from resample_warp3d.projection_models import (
    MERGED,
    Passage,
    Shape,
    StereoPanorama,
    on_lattice,
    poles_rows,
)
from resample_warp3d.sheet.filling import farthest_of_rows
from resample_warp3d.types import Hole, Method, Rendered, Source

MARGIN = 8  # px that the halves of a panorama overlap, on each side
LEAST_ROWS = 3  # of a panorama, beside each pole, taken from a picture of the pole
MOST_ROWS = 0.15  # of its height: most such rows
REACHES = 3  # times the extent of the cells over the pole
FINE = 4  # px of the picture per row of the panorama
SAMPLES = 8, 4  # of the picture, down and across, per pixel of the panorama

PassageMethod = Callable[[Source, Passage, Shape], Rendered]


def painted(
    method: Method, pixel: PixelFilter | None, source: Source, passage: Passage, shape: Shape
) -> Rendered:
    """Paint a source for a target of any camera model."""
    if not isinstance(method, Hybrid):
        raise ValueError(
            f"{type(method).__name__} warps from pinhole to pinhole; for lenses, panoramas and"
            " parallel rays use the method hybrid"
        )
    look: PassageMethod = method if pixel is None else partial(filtered, method, pixel)
    if not isinstance(passage.target, Equirectangular):
        return look(source, passage, shape)
    check_panorama(shape)
    whole = _halves(look, source, passage, shape)
    reaches = poles_rows(passage, method.sheet(source))
    most = MOST_ROWS if not isinstance(passage.target, StereoPanorama) else 0.5 - MERGED[1] / 180.0
    for reach, is_upper in zip(reaches, (True, False), strict=True):
        wanted = max(LEAST_ROWS, REACHES * reach)
        rows = max(1, min(wanted, int(most * shape[0])))
        _cap(method, source, passage, whole, rows if is_upper else -rows)
    return whole


def explained(rendered: Rendered, source: Source, passage: Passage) -> NDArray[np.uint8]:
    """Classify each pixel, (H, W) values of `Hole`.

    A hole is assumed to be as far as the farther of its two sides in its row, an empty row as far
    as the farthest point of the nearest row that is not empty.
    """
    shape = rendered.coverage.shape[0], rendered.coverage.shape[1]
    holes = np.zeros(shape, np.uint8)
    is_empty = np.logical_not(rendered.coverage > 0)
    nearness = np.where(is_empty, np.float32(np.inf), rendered.nearness)
    sides: Floats = np.minimum(_last_known(nearness), _last_known(nearness[:, ::-1])[:, ::-1])
    near = np.where(np.isfinite(sides), sides, farthest_of_rows(rendered)[:, None])[is_empty]
    place, _ = passage.back(pixel_centers(shape)[is_empty], near.astype(np.float64))
    is_seen = np.asarray(np.isfinite(place).all(axis=1))
    place = np.where(is_seen[:, None], place, -1.0)
    if source.place.size:
        place[is_seen] = on_lattice(source.place, place[is_seen])
    height, width = source.nearness.shape
    is_inside = (place >= 0).all(axis=1) & (place[:, 0] < width) & (place[:, 1] < height)
    column, row = np.where(is_inside[:, None], place, 0.0).astype(np.int64).T
    is_known = source.nearness[row, column] > 0
    inside = np.where(is_known, Hole.DISOCCLUDED, Hole.NO_DEPTH)
    holes[is_empty] = np.where(is_inside, inside, Hole.OUTSIDE)
    holes[rendered.bridged] = Hole.CRACK
    return holes


def trusted(rendered: Rendered, source: Source, passage: Passage) -> Floats:
    """Return the trust of the pixels' depth (H, W), as `sheet.holes.trusted` does."""
    sure = np.ones(rendered.nearness.shape, np.float32)
    if not source.trust.size:
        return sure
    is_seen = np.asarray(rendered.nearness > 0)
    near = rendered.nearness[is_seen].astype(np.float64)
    rows, columns = rendered.nearness.shape[:2]
    place, _ = passage.back(pixel_centers((rows, columns))[is_seen], near)
    is_found = np.isfinite(place).all(axis=1)
    if source.place.size:
        place[is_found] = on_lattice(source.place, place[is_found])
    height, width = source.trust.shape
    column, row = np.floor(np.clip(place[is_found], 0, (width - 1, height - 1))).astype(int).T
    found = np.zeros(len(place), np.float32)
    found[is_found] = source.trust[row, column]
    sure[:] = 0.0
    sure[is_seen] = found
    return sure


def _last_known(nearness: Floats) -> Floats:
    """Return the last finite number to the left of each pixel, or inf."""
    width = nearness.shape[1]
    at = np.where(np.isfinite(nearness), np.arange(width), 0)
    return np.take_along_axis(nearness, np.maximum.accumulate(at, axis=1), axis=1)


def _halves(look: PassageMethod, source: Source, passage: Passage, shape: Shape) -> Rendered:
    """Paint a panorama in two halves, so that no cell is cut by the seam."""
    height, width = shape
    first, half = width // 4, width // 2
    whole = empty(shape, source.color.shape[2])
    target = passage.target
    for turned in (0, 1):
        if not isinstance(target, Equirectangular):
            raise TypeError("only panoramas are turned")
        way = Passage(passage.source, target.turned(turned * math.pi), shape)
        shifted = np.eye(3)
        shifted[0, 2] = MARGIN - first
        part = look(source, way.in_frame(shifted), (height, half + 2 * MARGIN))
        columns = (np.arange(first, first + half) + turned * half) % width
        for into, each in zip(whole, part, strict=True):
            into[:, columns] = each[:, MARGIN:-MARGIN]
    return whole


def _cap(method: Hybrid, source: Source, passage: Passage, whole: Rendered, rows: int) -> None:
    """Fill rows beside a pole (negative: the lower one) from a picture of the pole.

    Cells there are too distorted, and one of them contains the pole. Each pixel is the mean over
    its square, whatever the filter.
    """
    height, width = whole.coverage.shape
    focal = FINE * height / math.pi
    half = math.ceil(focal * math.tan((abs(rows) + 1) * math.pi / height)) + 2
    pose = turn(0.0, math.copysign(0.5 * math.pi, rows)) @ passage.target.world_to_camera
    camera = Camera.from_intrinsics(focal, focal, half, half, pose)
    side = 2 * half
    fine = method(source, Passage(passage.source, camera, (side, side)), (side, side))
    upper = np.arange(abs(rows)) if rows > 0 else height - np.arange(abs(rows), 0, -1)
    down, across = SAMPLES
    y = (upper[:, None] + (np.arange(down) + 0.5) / down).ravel()
    x = (np.arange(width)[:, None] + (np.arange(across) + 0.5) / across).ravel()
    place = np.stack(np.broadcast_arrays(x, y[:, None]), axis=2)
    ray = rays_at(place, (height, width)) @ turn(0.0, math.copysign(0.5 * math.pi, rows))[:3, :3].T
    at = focal * ray[..., :2] / ray[..., 2:] + half
    _resampled(method, fine, at, ray[..., 2], whole, upper)


def _resampled(
    method: Hybrid, fine: Rendered, at: Doubles, cosine: Doubles, whole: Rendered,
    rows: NDArray[np.int64],
) -> None:  # fmt: skip
    """Fill rows of a panorama from a pinhole's picture, sampled at `at`, px."""
    height, width = whole.coverage.shape
    shape = rows.size, SAMPLES[0], width, SAMPLES[1]
    column, row = (
        np.floor(at).astype(np.int64).reshape(*shape, 2)[..., ::1].transpose(4, 0, 1, 2, 3)
    )
    middle = np.s_[:, SAMPLES[0] // 2, :, SAMPLES[1] // 2]
    chosen = (row[middle], column[middle]) if method.labels else (row, column)

    def mean(of: Floats) -> Floats:
        there = of[chosen]
        found = there if method.labels else there.mean(axis=(1, 3), dtype=np.float64)
        return np.asarray(found, np.float32)

    whole.image[rows], whole.coverage[rows] = mean(fine.image), mean(fine.coverage)
    flat = cosine.reshape(shape)
    near = fine.nearness[row, column] * flat
    whole.nearness[rows] = np.where(whole.coverage[rows] > 0, near.max(axis=(1, 3)), 0.0)
    # Magnification in pixels of the panorama, by solid angles.
    sine = np.sqrt(np.maximum(1.0 - flat * flat, 0.0))
    pixel = (math.pi / height) ** 2 * sine * (FINE * height / math.pi) ** 2 / flat**3
    finely = fine.magnification[row, column]
    grown = (finely > 0).sum(axis=(1, 3))
    total = np.where(finely > 0, finely / pixel, 0.0).sum(axis=(1, 3))
    whole.magnification[rows] = np.where(whole.coverage[rows] > 0, total / np.maximum(grown, 1), 0)
    whole.bridged[rows] = fine.bridged[row, column].mean(axis=(1, 3)) >= 0.5
