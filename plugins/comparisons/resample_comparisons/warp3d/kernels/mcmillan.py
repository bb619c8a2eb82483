"""McMillan's warping equation: places, Jacobians and nearest pixels of samples."""

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Doubles, Floats
from resample_warp3d.types import Equation, Rendered, Source

Pair = tuple[float, float]
Homogeneous = tuple[float, float, float]  # x₂ before the division by its third coordinate
Walks = NDArray[np.int64]  # (2, 2, 3) of rows and of columns, two walks each: from, up to, step


@kernel
def projected(equation: Equation, place: Pair, nearness: float) -> Homogeneous:
    """Place of a source point in the target, homogeneous."""
    m, e = equation.matrix, equation.epipole
    return (
        m[0, 0] * place[0] + m[0, 1] * place[1] + m[0, 2] + nearness * e[0],
        m[1, 0] * place[0] + m[1, 1] * place[1] + m[1, 2] + nearness * e[1],
        m[2, 0] * place[0] + m[2, 1] * place[1] + m[2, 2] + nearness * e[2],
    )


@kernel
def changed(equation: Equation, step: Pair, change: float) -> Homogeneous:
    """Derivative of a target point by a step in the source that changes the nearness."""
    m, e = equation.matrix, equation.epipole
    return (
        m[0, 0] * step[0] + m[0, 1] * step[1] + change * e[0],
        m[1, 0] * step[0] + m[1, 1] * step[1] + change * e[1],
        m[2, 0] * step[0] + m[2, 1] * step[1] + change * e[2],
    )


@kernel
def place_of(place: Doubles, row: int, column: int) -> Pair:
    """Place of a sample, px, without distortion; its center if the array is empty."""
    if place.shape[0] == 0:
        return column + 0.5, row + 0.5
    return place[row, column, 0], place[row, column, 1]


@kernel
def _step_of(place: Doubles, row: int, column: int, down: int, across: int) -> Pair:
    """Change of the place to the next column (`across` 1) or row (`down` 1), px."""
    # Take central differences, one-sided at the border.
    height, width = place.shape[:2]
    first_row, first_column = max(row - down, 0), max(column - across, 0)
    last_row, last_column = min(row + down, height - 1), min(column + across, width - 1)
    count = last_row - first_row + last_column - first_column
    if height == 0 or count == 0:
        return float(across), float(down)
    return (
        (place[last_row, last_column, 0] - place[first_row, first_column, 0]) / count,
        (place[last_row, last_column, 1] - place[first_row, first_column, 1]) / count,
    )


@kernel
def tangents(
    source: Source, equation: Equation, row: int, column: int
) -> tuple[Homogeneous, Homogeneous, Homogeneous]:
    """A sample in the target, and its derivatives along the source's columns and rows.

    The analytic Jacobian of the warp before the division; it includes the surface's slope.
    """
    place, slope = source.place, source.slope
    across = _step_of(place, row, column, 0, 1)
    down = _step_of(place, row, column, 1, 0)
    return (
        projected(equation, place_of(place, row, column), source.nearness[row, column]),
        changed(equation, across, slope[row, column, 0]),
        changed(equation, down, slope[row, column, 1]),
    )


@kernel
def expansion(point: Homogeneous, across: Homogeneous, down: Homogeneous) -> float:
    """Factor by which the warp enlarges an area; negative where it is mirrored."""
    # Take the Jacobian's determinant in homogeneous form; the division contributes w³.
    determinant = (
        across[0] * (down[1] * point[2] - down[2] * point[1])
        - across[1] * (down[0] * point[2] - down[2] * point[0])
        + across[2] * (down[0] * point[1] - down[1] * point[0])
    )
    return determinant / (point[2] * point[2] * point[2])


@kernel
def magnification_of(source: Source, equation: Equation, row: int, column: int) -> float:
    """Magnification of areas at a sample; 0 if it is not finite."""
    point, across, down = tangents(source, equation, row, column)
    area = abs(expansion(point, across, down))
    return area if area < np.inf else 0.0


@kernel
def _place_row(
    source: Source,
    equation: Equation,
    row: int,
    walk: NDArray[np.int64],
    owner: NDArray[np.int32],
    nearest: Floats,
) -> None:
    """Write a walk of samples along a row to their nearest pixels.

    A sample costs additions and one division. Where `nearest` is empty, later samples replace
    earlier ones, else nearer ones farther ones.
    """
    values, place = source.nearness, source.place
    m, e = equation.matrix, equation.epipole
    height, width = owner.shape
    step = walk[2]
    is_regular, is_ordered = place.shape[0] == 0, nearest.shape[0] == 0

    # Start at the first sample; on a regular lattice additions move the warp along the row.
    x, y, w = projected(equation, (walk[0] + 0.5, row + 0.5), 0.0)
    for column in range(walk[0], walk[1], step):
        nearness = np.float64(values[row, column])
        if not is_regular:
            x, y, w = projected(equation, place_of(place, row, column), 0.0)
        # Skip samples without depth or behind the camera.
        scale = w + nearness * e[2]
        if nearness > 0.0 and scale > 0.0:
            inverse = 1.0 / scale
            u, v = (x + nearness * e[0]) * inverse, (y + nearness * e[1]) * inverse
            # Write the sample to the pixel that it falls in.
            if 0.0 <= u < width and 0.0 <= v < height:
                i, j = int(v), int(u)
                # In occlusion-compatible order, overwriting is enough; otherwise test the depth.
                if is_ordered:
                    owner[i, j] = row * values.shape[1] + column
                elif np.float32(nearness * inverse) > nearest[i, j]:
                    owner[i, j] = row * values.shape[1] + column
                    nearest[i, j] = np.float32(nearness * inverse)
        x, y, w = x + step * m[0, 0], y + step * m[1, 0], w + step * m[2, 0]


@kernel
def place_samples(
    source: Source,
    equation: Equation,
    walks: Walks,
    owner: NDArray[np.int32],
    nearest: Floats,
) -> None:
    """Find the sample that each pixel of the target shows.

    `source`, `equation`: the samples and their warp. `walks`: (2, 2, 3) of rows, then of columns:
    the four sheets and their directions. `owner`: (H, W) of the target, filled where a sample
    lands: row × width + column of it. `nearest`: (H, W) zeros, filled with the nearness; or (0, 0),
    and later samples replace earlier ones.
    """
    for upper in range(2):
        for left in range(2):
            for row in range(walks[0, upper, 0], walks[0, upper, 1], walks[0, upper, 2]):
                _place_row(source, equation, row, walks[1, left], owner, nearest)


@kernel
def _copy_row(
    source: Source, equation: Equation, owner: NDArray[np.int32], row: int, rendered: Rendered
) -> None:
    """Fill a row of the picture; see `copy_rows`."""
    image, color = rendered.image, source.color
    for column in range(owner.shape[1]):
        # Copy the color of the pixel's sample, or clear the pixel.
        number = owner[row, column]
        is_seen = number >= 0
        r, c = divmod(number if is_seen else 0, color.shape[1])
        for channel in range(color.shape[2]):
            image[row, column, channel] = color[r, c, channel] if is_seen else np.float32(0)
        rendered.coverage[row, column] = 1.0 if is_seen else 0.0
        rendered.bridged[row, column] = False
        rendered.nearness[row, column], rendered.magnification[row, column] = 0.0, 0.0
        # Compute depth and magnification of visible pixels.
        if is_seen:
            w = projected(equation, place_of(source.place, r, c), source.nearness[r, c])[2]
            rendered.nearness[row, column] = source.nearness[r, c] / w
            rendered.magnification[row, column] = magnification_of(source, equation, r, c)


@parallel_kernel
def copy_rows(
    counter: Counter,
    source: Source,
    equation: Equation,
    owner: NDArray[np.int32],
    rendered: Rendered,
) -> None:
    """Fill a picture with the samples that own its pixels (−1: none)."""
    for row in tasks(counter, owner.shape[0]):
        _copy_row(source, equation, owner, row, rendered)
