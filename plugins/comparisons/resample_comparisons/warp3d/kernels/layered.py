"""Layered depth images: samples of several views in the pixels of one."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Floats
from resample_comparisons.warp3d.kernels.mcmillan import (
    Homogeneous,
    Pair,
    Walks,
    changed,
    expansion,
    projected,
    tangents,
)
from resample_warp3d.types import Equation, Rendered, Source

NEARNESS, SLOPE_X, SLOPE_Y = range(3)  # columns of a sample that has been moved

SINGLE = 1.05  # px per side up to which a sample is drawn one pixel wide; then 3, 5, …
STEEPEST = 0.1  # of the nearness: largest change within a pixel; steeper slopes are ignored


class LayeredImage(NamedTuple):
    """A layered depth image: any number of samples in every pixel, at its center."""

    start: NDArray[np.int64]  # (H × W + 1,) where the samples of a pixel begin
    color: Floats  # (N, C)
    nearness: Floats  # (N,) ascending in every pixel: back to front
    slope: Floats  # (N, 2) change of nearness to the next column and row, on the surface
    width: int  # px


@kernel
def _slope_in_target(
    point: Homogeneous, across: Homogeneous, down: Homogeneous, nearness: float, slope: Pair
) -> Pair:
    """Change of nearness per px to the right and downward in the target.

    `slope` is the change of δ to the next column and row of the source; `nearness` is the target's.
    """
    # Differentiate the warp's division: the Jacobian of the target place.
    inverse = 1.0 / point[2]
    x, y = point[0] * inverse, point[1] * inverse
    xu, yu = across[0] - x * across[2], across[1] - y * across[2]
    xv, yv = down[0] - x * down[2], down[1] - y * down[2]
    # Differentiate the nearness along the source's axes.
    to_next, downward = slope[0] - nearness * across[2], slope[1] - nearness * down[2]
    # Solve for the change along the target's axes.
    area = xu * yv - xv * yu
    return (to_next * yv - downward * yu) / area, (downward * xu - to_next * xv) / area


@kernel
def _move_row(
    source: Source,
    equation: Equation,
    shape: tuple[int, int],
    row: int,
    pixel: NDArray[np.int64],
    moved: Floats,
) -> None:
    """Move a row of samples; see `move_rows`."""
    for column in range(source.nearness.shape[1]):
        pixel[row, column] = -1
        # Warp the sample, and skip it behind the camera or outside the view.
        point, across, down = tangents(source, equation, row, column)
        if source.nearness[row, column] <= 0.0 or point[2] <= 0.0:
            continue
        x, y = point[0] / point[2], point[1] / point[2]
        if not (0.0 <= x < shape[1] and 0.0 <= y < shape[0]):
            continue
        # Extrapolate the nearness to the pixel's center, unless the surface is too steep.
        nearness = source.nearness[row, column] / point[2]
        slope = np.float64(source.slope[row, column, 0]), np.float64(source.slope[row, column, 1])
        slope_x, slope_y = _slope_in_target(point, across, down, nearness, slope)
        change = slope_x * (int(x) + 0.5 - x) + slope_y * (int(y) + 0.5 - y)
        if not abs(change) < STEEPEST * nearness:
            slope_x, slope_y, change = 0.0, 0.0, 0.0
        # Store the sample.
        pixel[row, column] = int(y) * shape[1] + int(x)
        moved[row, column, NEARNESS] = nearness + change
        moved[row, column, SLOPE_X], moved[row, column, SLOPE_Y] = slope_x, slope_y


@parallel_kernel
def move_rows(
    counter: Counter,
    source: Source,
    equation: Equation,
    shape: tuple[int, int],
    pixel: NDArray[np.int64],
    moved: Floats,
) -> None:
    """Move samples to the centers of their nearest pixels in another view.

    `shape`: (height, width) of that view, px. `pixel`: (H, W) filled: row × width + column of the
    pixel; −1 if there is none. `moved`: (H, W, 3) filled, where there is one: NEARNESS at the
    pixel's center, SLOPE_X and SLOPE_Y.
    """
    for row in tasks(counter, pixel.shape[0]):
        _move_row(source, equation, shape, row, pixel, moved)


@kernel
def merge(
    pixel: NDArray[np.int64], moved: Floats, color: Floats, tolerance: float, layers: LayeredImage
) -> int:
    """Merge sorted samples into layers; return their number.

    Parameters
    ----------
    pixel, moved, color
        (N,), (N, 3) and (N, C) of samples, by pixel and then by nearness.
    tolerance
        Samples of a pixel whose nearness is larger than a layer's first by up to this share of it
        belong to that layer, which is their mean.
    layers
        Filled; room for N layers.
    """
    start, total, count, n, home = layers.start, layers.color, 0, 0, 0
    while n < len(pixel):
        # Close the pixels before this one, empty ones included.
        while home <= pixel[n]:
            start[home] = count
            home += 1
        # Start a layer at the farthest sample left in the pixel.
        first, limit = n, moved[n, NEARNESS] * (1.0 + tolerance)
        nearness, slope_x, slope_y = 0.0, 0.0, 0.0
        total[count] = 0.0
        # Add all samples within the tolerance.
        while n < len(pixel) and pixel[n] == pixel[first] and moved[n, NEARNESS] <= limit:
            nearness += moved[n, NEARNESS]
            slope_x, slope_y = slope_x + moved[n, SLOPE_X], slope_y + moved[n, SLOPE_Y]
            for channel in range(color.shape[1]):
                total[count, channel] += color[n, channel]
            n += 1
        # Store their mean.
        share = 1.0 / (n - first)
        layers.nearness[count] = share * nearness
        layers.slope[count, 0], layers.slope[count, 1] = share * slope_x, share * slope_y
        for channel in range(color.shape[1]):
            total[count, channel] *= np.float32(share)
        count += 1

    # Close the last pixels.
    start[home:] = count
    return count


@kernel
def _put_splat(
    layers: LayeredImage, n: int, place: Pair, patch: Floats, values: Pair, rendered: Rendered
) -> None:
    """Composite a sample over a picture; `values` are its depth and magnification.

    `patch` (K, K) are the splat's opacities, `place` is its center, px.
    """
    image, reach = rendered.image, patch.shape[0] // 2
    height, width, channels = image.shape
    # Visit the splat's pixels within the picture.
    top, left = math.floor(place[1]) - reach, math.floor(place[0]) - reach
    for row in range(max(top, 0), min(top + patch.shape[0], height)):
        for column in range(max(left, 0), min(left + patch.shape[1], width)):
            # Composite color and coverage over what lies behind.
            alpha = patch[row - top, column - left]
            rest = np.float32(1) - alpha
            for channel in range(channels):
                image[row, column, channel] = (
                    alpha * layers.color[n, channel] + rest * image[row, column, channel]
                )
            rendered.coverage[row, column] = alpha + rest * rendered.coverage[row, column]
            # Take the depth of splats that cover most of the pixel.
            if alpha >= 0.5 or rendered.nearness[row, column] == 0.0:
                rendered.nearness[row, column] = values[0]
                rendered.magnification[row, column] = values[1]


@kernel
def _splat_row(
    layers: LayeredImage,
    equation: Equation,
    row: int,
    walk: NDArray[np.int64],
    patches: Floats,
    rendered: Rendered,
) -> None:
    """Composite the samples of a row along one walk; see `splat_in_order`."""
    m, e, step = equation.matrix, equation.epipole, walk[2]
    reach, largest = patches.shape[1] // 2, patches.shape[0] - 1
    height, width = rendered.coverage.shape

    # Walk along the row: the warp is linear before the division, so that additions move it.
    x, y, w = projected(equation, (walk[0] + 0.5, row + 0.5), 0.0)
    for column in range(walk[0], walk[1], step):
        pixel = row * layers.width + column
        # Draw the pixel's samples back to front.
        for n in range(layers.start[pixel], layers.start[pixel + 1]):
            nearness = np.float64(layers.nearness[n])
            point = x + nearness * e[0], y + nearness * e[1], w + nearness * e[2]
            inverse = 1.0 / point[2] if point[2] > 0.0 else np.nan
            place = point[0] * inverse, point[1] * inverse
            # Cull splats outside the picture.
            if not (-reach <= place[0] < width + reach and -reach <= place[1] < height + reach):
                continue
            # Size the splat by the magnification of the sample.
            across = changed(equation, (1.0, 0.0), layers.slope[n, 0])
            down = changed(equation, (0.0, 1.0), layers.slope[n, 1])
            area = abs(expansion(point, across, down))
            area = area if area < np.inf else 0.0
            size = math.ceil(min(max(math.sqrt(area) - SINGLE, 0.0), float(largest)))
            side = 2 * size + 1
            values = nearness * inverse, area
            _put_splat(layers, n, place, patches[size, :side, :side], values, rendered)
        x, y, w = x + step * m[0, 0], y + step * m[1, 0], w + step * m[2, 0]


@kernel
def splat_in_order(
    layers: LayeredImage, equation: Equation, walks: Walks, patches: Floats, rendered: Rendered
) -> None:
    """Composite all samples, back to front, in McMillan's occlusion-compatible order.

    `walks`: (2, 2, 3) as in `mcmillan.place_samples`. `patches`: (S, 2 S − 1, 2 S − 1) opacities of
    splats 1, 3, 5 … px wide, each in the upper left corner. `rendered`: zeros, filled.
    """
    for upper in range(2):
        for left in range(2):
            for row in range(walks[0, upper, 0], walks[0, upper, 1], walks[0, upper, 2]):
                _splat_row(layers, equation, row, walks[1, left], patches, rendered)
