"""Pictures painted record by record in NumPy: a plain way, the truth for what streams.

It shares with the engine what a sample's record says (`Resampler.footprints`), the tables, and how
fine tiles are. All else, tiles, runs, lanes, formulas and the order of work, is the engine's alone.
"""

from typing import NamedTuple

import numpy as np

from resample.engine.compositing import VISIBLE
from resample.engine.points.adding import MOST_TAPS
from resample.engine.subpixels import grid_of
from resample.painting.scenes.scene import check_samples, size_of_tiles, tiles_along
from resample.profiles.orders import sheets_of
from resample.types import AFFINE, DISC, EXACT, Frame, Statistics
from tests.samples import painter

TIES = ("y", "x", "a", "b", "c", "extinction", "red", "green", "blue")


class Canvas(NamedTuple):
    """Sub-pixels of a frame and of the margin that a pixel filter needs, n per side of a pixel."""

    light: np.ndarray  # (h, w, 3) premultiplied
    passes: np.ndarray  # (h, w) transmittance
    depth: np.ndarray  # (h, w) α × depth
    cover: np.ndarray  # (h, w)
    first: np.ndarray  # (h, w) depth of what is seen first
    sheet: np.ndarray  # (h, w, 6) sums of points: α, α × RGB, α × depth, area
    x: np.ndarray  # (w,) px
    y: np.ndarray  # (h,)
    n: int


def from_records(samples, camera, *, height, width, clip=None, **choices):
    """Frame of samples that are composited one by one, or as points in layers."""
    resample, checked = painter(**choices), check_samples(samples)
    scene = resample._scene(checked, camera.view(), (height, width), None, clip)
    record = _records(scene, checked)
    seen = record["left"] <= record["right"]
    key, sheet = sheets_of(scene.layers, scene.summing, checked.position, scene.view)
    order = np.lexsort([record[name] for name in reversed(TIES)] + [key])
    order = order[seen[order]]
    fineness = _fineness(scene, record[seen], height, width)
    arrays = [np.zeros((height, width, 4)), *np.zeros((3, height, width))]
    for n in np.unique(fineness):
        canvas = _canvas(scene, height, width, int(n))
        _paint(canvas, scene, record[order], sheet[order])
        for whole, part in zip(arrays, _developed(canvas, scene, height, width), strict=True):
            whole[fineness == n] = part[fineness == n]
    return Frame(
        *(array.astype(np.float32) for array in arrays), _counted(scene, record, seen, fineness)
    )


def _records(scene, samples):
    from resample.engine.ellipsoids.footprints import project
    from resample.types import FOOTPRINT

    record = np.zeros(samples.extinction.size, FOOTPRINT)
    project(record, samples, scene.view, scene.ellipsoid, scene.screen, scene.style)
    return record


def _fineness(scene, record, height, width):
    """Sub-pixels per side of every pixel (H, W): those of the tile that it lies in."""
    size = size_of_tiles(
        grid_of(record["spacing"].min(initial=np.inf), scene.style), scene.tables.pixel_margin
    )
    margin, fineness = scene.screen.margin, np.ones((height, width), int)
    rows, columns = tiles_along(scene.screen, size)
    for tile in range(rows * columns):
        top, left = tile // columns * size, tile % columns * size
        is_met = (record["left"] - margin < left + size) & (record["right"] + margin >= left)
        is_met &= (record["top"] - margin < top + size) & (record["bottom"] + margin >= top)
        finest = grid_of(float(record["spacing"][is_met].min(initial=np.inf)), scene.style)
        fineness[top : top + size, left : left + size] = finest
    return fineness


def _counted(scene, record, seen, fineness):
    height, width = fineness.shape
    column = np.clip(record["x"][seen], 0, width - 1).astype(int)
    row = np.clip(record["y"][seen], 0, height - 1).astype(int)
    is_point = record["spacing"][seen] * fineness[row, column] <= scene.style.threshold
    is_point &= record["cone"][seen] >= 0
    points = int(is_point.sum())
    return Statistics(seen.size, points, int(seen.sum()) - points, 0, int(fineness.max()), {})


def _canvas(scene, height, width, n):
    margin = scene.tables.pixel_margin
    h, w = (height + 2 * margin) * n, (width + 2 * margin) * n
    x, y = ((np.arange(count) + 0.5) / n - margin for count in (w, h))
    return Canvas(
        np.zeros((h, w, 3)),
        np.ones((h, w)),
        *np.zeros((2, h, w)),
        np.full((h, w), np.inf),
        np.zeros((h, w, 6)),
        x,
        y,
        n,
    )


def _paint(canvas, scene, record, sheet):
    """Paint records in their order, points sheet by sheet."""
    style, n, number = scene.style, canvas.n, None
    dirty = []
    for one, where in zip(record, sheet, strict=True):
        if where != number:
            _close_sheet(canvas, dirty, style)
            number = where
        if one["cone"] >= 0 and one["spacing"] * n <= style.threshold:
            dirty.append(_add_point(canvas, scene, one))
            continue
        box = _box(canvas, one)
        if canvas.passes[box].size == 0:
            continue
        integral = (_cut if one["cone"] < 0 else _splat)(canvas, box, scene, one)
        integral[(integral < 0) | (canvas.passes[box] <= style.opaque)] = 0
        alpha = -np.expm1(-one["extinction"] * integral)
        if style.linear_opacity:
            of_layer = -np.expm1(-one["extinction"] * style.layer)
            alpha = np.minimum(1, of_layer * integral / style.layer)
        canvas.cover[box] += integral / style.layer
        _put_behind(canvas, box, alpha, _light(one, style), one["depth"])
    _close_sheet(canvas, dirty, style)


def _light(one, style):
    light = np.array([one["red"], one["green"], one["blue"]])
    if style.tint_red >= 0:
        light = light.max() * np.array([style.tint_red, style.tint_green, style.tint_blue])
    return light


def _put_behind(canvas, box, alpha, light, depth):
    share = canvas.passes[box] * alpha
    canvas.light[box] += share[..., None] * light
    canvas.depth[box] += share * depth
    canvas.passes[box] -= share
    is_first = np.isinf(canvas.first[box]) & (share > 0) & (1 - canvas.passes[box] > VISIBLE)
    canvas.first[box] = np.where(is_first, depth, canvas.first[box])


def _box(canvas, one):
    """Rows and columns of sub-pixels whose centers lie within a record's bounds."""
    top, bottom = np.searchsorted(canvas.y, [one["top"], np.nextafter(one["bottom"], np.inf)])
    left, right = np.searchsorted(canvas.x, [one["left"], np.nextafter(one["right"], np.inf)])
    return slice(top, bottom), slice(left, right)


def _rays(canvas, box, view):
    """Where rays of sub-pixels are at depth 1 (or anywhere, where they are parallel)."""
    x = (canvas.x[box[1]] - view.principal[0]) / view.focal[0]
    y = (canvas.y[box[0]] - view.principal[1]) / view.focal[1]
    return np.broadcast_arrays(x[None, :], y[:, None])


def _directions(x, y, scene):
    """Rays' steps of depth 1 in radii (h, w, 3), and their lengths in scene units (h, w)."""
    if not scene.view.perspective:
        x = y = np.zeros_like(x)
    step = np.stack([x, y, np.ones_like(x)], axis=-1)
    return step @ scene.ellipsoid.to_unit.T, np.sqrt((step**2).sum(-1))


def _splat(canvas, box, scene, one):
    """Line integrals (h, w) of a sample's kernel by the model of its footprint."""
    dx, dy = canvas.x[box[1]] - one["form_x"], (canvas.y[box[0]] - one["form_y"])[:, None]
    squared = np.maximum(0, one["a"] * dx * dx + 2 * one["b"] * dx * dy + one["c"] * dy * dy)
    model, amplitude = scene.style.model, one["amplitude"]
    if model in (EXACT, DISC):
        unit, length = _directions(*_rays(canvas, box, scene.view), scene)
        per_radius = (unit**2).sum(-1)
        squared = squared / per_radius
        if model == EXACT:
            amplitude = scene.ellipsoid.scale * length / np.sqrt(per_radius)
        else:
            squared = squared / (1 - squared * np.sin(one["cone"]) ** 2)
    elif model != AFFINE and one["cone"] > 1e-9:
        flat = np.arctan(np.sqrt(squared) * np.tan(one["cone"]))
        squared = (np.sin(flat) / np.sin(one["cone"])) ** 2
    table = scene.tables.footprint
    return amplitude * np.interp(squared, np.linspace(0, 1, table.size), table, right=0)


def _cut(canvas, box, scene, one):
    """Line integrals (h, w) of a sphere that a plane cuts; a, b, c are its center, in radii."""
    x, y = _rays(canvas, box, scene.view)
    start, end = _seen(x, y, scene)
    step, length = _directions(x, y, scene)
    origin = np.zeros((*x.shape, 3))
    if not scene.view.perspective:
        origin = np.stack([x, y, np.zeros_like(x)], axis=-1) @ scene.ellipsoid.to_unit.T
    way = np.array([one["a"], one["b"], one["c"]]) - origin
    per_depth = np.sqrt((step**2).sum(-1))
    foot = (way * step).sum(-1) / per_depth**2
    squared = ((way - foot[..., None] * step) ** 2).sum(-1)
    low, high = (np.clip((z - foot) * per_depth, -1, 1) for z in (start, end))
    share = _partial(scene.tables.partial, squared, high)
    share -= _partial(scene.tables.partial, squared, low)
    return scene.ellipsoid.scale * length / per_depth * np.where(squared < 1, share, 0)


def _seen(x, y, scene):
    """Depths (h, w) between which rays are seen."""
    start, end = np.full(x.shape, scene.view.near), np.full(x.shape, np.inf)
    for a, b, rise, offset in scene.screen.planes[:, :4]:
        across = a * x + b * y
        slope = rise + (across if scene.view.perspective else 0 * x)
        place = offset + (0 * x if scene.view.perspective else across)
        with np.errstate(divide="ignore", invalid="ignore"):
            start = np.where(slope > 0, np.maximum(start, -place / slope), start)
            end = np.where(slope < 0, np.minimum(end, -place / slope), end)
        end = np.where((slope == 0) & (place < 0), -np.inf, end)
    return start, np.maximum(start, end)


def _partial(table, squared, place):
    """Bilinear entries of a table over the squared distance, 0..1, and the place, -1..1."""
    from scipy.ndimage import map_coordinates

    rows, columns = table.shape
    at = [np.clip(squared, 0, 1) * (rows - 1), (place + 1) / 2 * (columns - 1)]
    return map_coordinates(table.astype(float), at, order=1, mode="nearest")


def _add_point(canvas, scene, one):
    """Add a point to the open sheet; gives what it touched."""
    style, n = scene.style, canvas.n
    path = style.layer * one["obliquity"]
    area = one["mass"] / path * n * n
    alpha = area * -np.expm1(-one["extinction"] * path)
    width = np.sqrt(style.variance * (one["spacing"] * n) ** 2 + 1 / 12) if style.variance else n
    reach = min(width * style.point_extent, (MOST_TAPS - 2) / 2)
    margin = scene.tables.pixel_margin
    rows, down = _weights((one["y"] + margin) * n, reach, scene.tables.point, len(canvas.y))
    columns, across = _weights((one["x"] + margin) * n, reach, scene.tables.point, len(canvas.x))
    amount = [alpha, *(alpha * one[name] for name in ("red", "green", "blue", "depth")), area]
    canvas.sheet[rows, columns] += (down[:, None] * across)[..., None] * amount
    return rows, columns


def _weights(center, reach, profile, count):
    """Sub-pixels within reach of a place along an axis, and weights that sum to 1."""
    first, last = int(np.floor(center - reach + 0.5)), int(np.floor(center + reach - 0.5)) + 1
    distance = np.abs(np.arange(first, last) + 0.5 - center) / reach
    weight = np.interp(distance, np.linspace(0, 1, profile.size), profile, right=0)
    if not weight.any():
        first = int(np.floor(center))
        last, weight = first + 1, np.ones(1)
    weight = weight / weight.sum()
    low, high = max(first, 0), max(min(last, count), 0)
    return slice(low, max(low, high)), weight[low - first : max(low, high) - first]


def _close_sheet(canvas, dirty, style):
    """Put the open sheet behind what is painted, and empty it."""
    if not dirty:
        return
    rows, columns = (
        slice(min(box[n].start for box in dirty), max(box[n].stop for box in dirty))
        for n in range(2)
    )
    dirty.clear()
    box, total = (rows, columns), canvas.sheet[rows, columns, 0]
    is_open = (total > 0) & (canvas.passes[box] > style.opaque)
    mean = canvas.sheet[box][..., 1:5] / np.where(total > 0, total, 1)[..., None]
    alpha = np.where(is_open, np.minimum(total, 1), 0)
    _put_behind(canvas, box, alpha, np.maximum(mean[..., :3], 0), mean[..., 3])
    canvas.cover[box] += np.where(is_open, canvas.sheet[box][..., 5], 0)
    canvas.sheet[box] = 0


def _developed(canvas, scene, height, width):
    """Color, depth, first depth and coverage of pixels from sub-pixels, under the pixel filter."""
    n, tables = canvas.n, scene.tables
    margin = tables.pixel_margin
    tap = np.abs((np.arange((2 * margin + 1) * n) + 0.5) / n - margin - 0.5) / tables.pixel_extent
    weight = np.interp(tap, np.linspace(0, 1, tables.pixel.size), tables.pixel, right=0)
    weight = weight / weight.sum()
    alpha = 1 - canvas.passes
    covered = np.maximum(alpha, np.minimum(1, canvas.cover))
    planes = [*np.moveaxis(canvas.light, -1, 0), alpha, canvas.depth, covered]
    red, green, blue, alpha, depth, covered = (
        _filtered(_filtered(plane, weight, n, height).T, weight, n, width).T for plane in planes
    )
    rgba = np.stack([*np.maximum([red, green, blue], 0), np.clip(alpha, 0, 1)], axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(alpha > 0, depth / alpha, np.inf)
    inner = canvas.first[margin * n : (margin + height) * n, margin * n : (margin + width) * n]
    first = inner.reshape(height, n, width, n).min(axis=(1, 3))
    return rgba, depth, first, np.clip(covered, 0, 1)


def _filtered(plane, weight, n, count):
    return np.stack([weight @ plane[n * k : n * k + weight.size] for k in range(count)])
