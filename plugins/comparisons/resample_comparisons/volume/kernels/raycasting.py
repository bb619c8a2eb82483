"""Ray casting through a reconstructed field: the obvious loops, in float64.

Shares nothing with the splatting that it judges, neither footprints nor their tables. Rays are in
lattice coordinates, in which samples stand on whole numbers and kernels are balls.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.engine.vectors import Vector, combine, dot, matrix_of, multiply
from resample.types import Doubles, Floats, View

LEAST_TRANSMITTANCE = 1e-7  # transmittance at which a ray ends

Indices = NDArray[np.int32]
Flags = NDArray[np.bool_]
Sums = tuple[float, float, float, float, float]  # of k, then of k times each of four properties
Light = tuple[float, float, float, float]  # straight RGB and extinction per scene unit
Result = tuple[float, float, float, float, float]  # RGBA, and α × depth


class Grid(NamedTuple):
    """Samples on their lattice; coordinates count from its first node."""

    node: Indices  # (Z, Y, X) which sample stands here, -1: none
    properties: Floats  # (N, 4) extinction and its products with RGB
    occupied: Flags  # (z, y, x) bricks of `brick`³ nodes in which something may be visible
    density: Doubles  # (K + 1,) kernel over the squared distance in radii; a constant field gives 1
    radius: float  # voxels
    brick: int  # voxels; the first one's corner is `radius` before the first node
    lattice: Doubles  # (3, 3) columns are steps, scene units
    origin: Doubles  # (3,) scene position of the first node
    start: Doubles  # (3,) of the camera, in sample coordinates
    turn: Doubles  # (3, 3) from camera axes to sample coordinates


class CastingOptions(NamedTuple):
    """Choices as numbers."""

    rays: int  # per side of a pixel
    step: float  # scene units, at most
    clip: Doubles  # (M, 4) planes in camera axes


class ReferenceRay(NamedTuple):
    """Part of a ray that may hit something; all depths are along the view axis."""

    start: Vector  # at depth 0, sample coordinates
    way: Vector  # per unit of depth
    length: float  # scene units per unit of depth
    enter: float
    leave: float
    steps: int  # 0: it hits nothing
    thickness: float  # depth of a step


@kernel
def _cut(part: tuple[float, float], here: float, slope: float) -> tuple[float, float]:
    """Clip a ray to the half-space where here + slope × depth is at least 0."""
    enter, leave = part
    if slope > 0.0:
        return max(enter, -here / slope), leave
    if slope < 0.0:
        return enter, min(leave, -here / slope)
    return (enter, leave) if here >= 0.0 else (enter, -np.inf)


@kernel
def _new_ray(x: float, y: float, grid: Grid, view: View, plan: CastingOptions) -> ReferenceRay:
    """Ray through a point of the screen, px, clipped to all bounds.

    That is the samples' box, the near plane and the clip planes.
    """
    # Set up the ray in camera axes; x and y are its direction, or its start if parallel.
    x, y = (x - view.principal[0]) / view.focal[0], (y - view.principal[1]) / view.focal[1]
    here, way = (0.0, 0.0, 0.0), (x, y, 1.0)
    if not view.perspective:
        here, way = (x, y, 0.0), (0.0, 0.0, 1.0)
    # Clip at the near plane and the clip planes.
    part = (view.near, np.inf)
    for n in range(len(plan.clip)):
        plane = (plan.clip[n, 0], plan.clip[n, 1], plan.clip[n, 2])
        part = _cut(part, dot(plane, here) + plan.clip[n, 3], dot(plane, way))
    # Transform to sample coordinates.
    turn = matrix_of(grid.turn)
    origin = (grid.start[0], grid.start[1], grid.start[2])
    start = combine(origin, 1.0, multiply(turn, here))
    along = multiply(turn, way)
    # Clip to the samples' box, a kernel's radius wider on all sides.
    for axis in range(3):
        last = grid.node.shape[2 - axis] - 1.0
        part = _cut(part, start[axis] + grid.radius, along[axis])
        part = _cut(part, last + grid.radius - start[axis], -along[axis])
    # Divide the rest into equal steps.
    length = math.sqrt(dot(way, way))
    enter, leave = part
    if not leave > enter:
        return ReferenceRay(start, along, length, 0.0, 0.0, 0, 0.0)
    steps = max(1, math.ceil((leave - enter) * length / plan.step))
    return ReferenceRay(start, along, length, enter, leave, steps, (leave - enter) / steps)


@kernel
def _kernel_at(density: Doubles, squared: float) -> float:
    """Kernel at a squared distance below 1, linear between table entries."""
    place = squared * (density.size - 1)
    entry = min(int(place), density.size - 2)
    return float(density[entry] + (place - entry) * (density[entry + 1] - density[entry]))


@kernel
def _gather(place: Vector, radius: float, node: Indices, matter: Floats, density: Doubles) -> Sums:
    """Sum all kernels at a point."""
    total = first = second = third = fourth = 0.0
    x, y, z = place
    depth, height, width = node.shape
    # Visit the lattice nodes within the ball, plane by plane and line by line.
    for k in range(max(0, math.ceil(z - radius)), min(depth - 1, math.floor(z + radius)) + 1):
        in_plane = radius * radius - (z - k) * (z - k)
        reach = math.sqrt(max(0.0, in_plane))
        for j in range(max(0, math.ceil(y - reach)), min(height - 1, math.floor(y + reach)) + 1):
            in_line = in_plane - (y - j) * (y - j)
            half = math.sqrt(max(0.0, in_line))
            for i in range(max(0, math.ceil(x - half)), min(width - 1, math.floor(x + half)) + 1):
                # Skip empty nodes and those outside by rounding.
                sample = node[k, j, i]
                squared = 1.0 - (in_line - (x - i) * (x - i)) / (radius * radius)
                if sample < 0 or squared >= 1.0:
                    continue
                # Add the sample by its kernel's value.
                weight = _kernel_at(density, squared)
                total += weight
                first += weight * matter[sample, 0]
                second += weight * matter[sample, 1]
                third += weight * matter[sample, 2]
                fourth += weight * matter[sample, 3]
    return (total, first, second, third, fourth)


@kernel
def _sums(ray: ReferenceRay, depth: float, grid: Grid) -> Sums:
    """Sum all kernels at a depth of a ray."""
    place = combine(ray.start, depth, ray.way)
    return _gather(place, grid.radius, grid.node, grid.properties, grid.density)


@kernel
def _next_step(ray: ReferenceRay, step: int, grid: Grid) -> int:
    """First step from this one on in a brick that is not empty (empty space skipping)."""
    depth, height, width = grid.occupied.shape
    while step < ray.steps:
        # Find the brick of the step's middle.
        x, y, z = combine(ray.start, ray.enter + (step + 0.5) * ray.thickness, ray.way)
        i = _brick(x, grid, width)
        j = _brick(y, grid, height)
        k = _brick(z, grid, depth)
        if grid.occupied[k, j, i]:
            return step
        # Skip to the nearest wall of an empty brick.
        out = min(_wall(ray, 0, i, grid), _wall(ray, 1, j, grid), _wall(ray, 2, k, grid))
        if not out < ray.leave:
            return ray.steps
        step = max(step + 1, math.ceil((out - ray.enter) / ray.thickness - 0.5))
    return step


@kernel
def _brick(place: float, grid: Grid, count: int) -> int:
    """Brick that a coordinate lies in, of `count` along that axis."""
    return max(0, min(count - 1, math.floor((place + grid.radius) / grid.brick)))


@kernel
def _wall(ray: ReferenceRay, axis: int, brick: int, grid: Grid) -> float:
    """Depth at which a ray leaves a brick along one axis."""
    way = ray.way[axis]
    if way == 0.0:
        return np.inf
    wall = (brick + 1 if way > 0.0 else brick) * grid.brick - grid.radius
    return (wall - ray.start[axis]) / way


@kernel
def _sample_light(sums: Sums) -> Light:
    """Color and extinction of samples that were classified before interpolation."""
    total = sums[1]
    if total <= 0.0:
        return (0.0, 0.0, 0.0, 0.0)
    return (sums[2] / total, sums[3] / total, sums[4] / total, total)


@kernel
def _composite(ray: ReferenceRay, grid: Grid) -> Result:
    """Composite front to back, with a step's opacity by its middle's extinction."""
    red = green = blue = deep = 0.0
    passed = 1.0
    # Step through occupied bricks until the ray leaves or is opaque.
    step = _next_step(ray, 0, grid)
    while step < ray.steps and passed > LEAST_TRANSMITTANCE:
        depth = ray.enter + (step + 0.5) * ray.thickness
        sums = _sums(ray, depth, grid)
        if sums[0] > 0.0:
            light = _sample_light(sums)
            # Composite under what lies in front: expm1 stays exact for thin steps.
            share = -passed * math.expm1(-light[3] * ray.thickness * ray.length)
            red += share * light[0]
            green += share * light[1]
            blue += share * light[2]
            deep += share * depth
            passed -= share
        step = _next_step(ray, step + 1, grid)
    return (red, green, blue, 1.0 - passed, deep)


@kernel
def _cast_row(row: int, view: View, grid: Grid, plan: CastingOptions, picture: Doubles) -> None:
    """Average over the rays of every pixel in a row."""
    share = 1.0 / (plan.rays * plan.rays)
    for column in range(picture.shape[1]):
        for channel in range(5):
            picture[row, column, channel] = 0.0
        # Cast a regular grid of rays through the pixel.
        for down in range(plan.rays):
            for right in range(plan.rays):
                x, y = column + (right + 0.5) / plan.rays, row + (down + 0.5) / plan.rays
                ray = _new_ray(x, y, grid, view, plan)
                seen = _composite(ray, grid)
                for channel in range(5):
                    picture[row, column, channel] += share * seen[channel]


@parallel_kernel
def cast_rows(
    counter: Counter,
    first: int,
    count: int,
    view: View,
    grid: Grid,
    plan: CastingOptions,
    picture: Doubles,
) -> None:
    """Fill `count` rows of a picture (H, W, 5) from row `first` on; see `Result`."""
    for row in tasks(counter, count):
        _cast_row(first + row, view, grid, plan, picture)
