"""Project points to the screen, many at once, and bound runs of neighbours.

As `outlines` and `run_bounds` of `resample.engine.ellipsoids`, for samples that are points on any
grid that a tile may have.
"""

import math

import numpy as np
from numpy.typing import NDArray

from resample.engine.compositing import key_of, place_of
from resample.engine.ellipsoids.footprints import Eye, Shape, in_camera
from resample.engine.ellipsoids.outlines import (
    BATCH,
    BOTTOM,
    KEY,
    LEFT,
    NO_REACH,
    RIGHT,
    SCRATCH_SIZE,
    SPACING,
    TOP,
    OutlineSetup,
    outline_setup,
)
from resample.engine.ellipsoids.run_bounds import CHUNKS, sum_up
from resample.engine.ellipsoids.runs import finest_of, may_be_finer
from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.engine.subpixels import POINT_SPACING
from resample.engine.vectors import Vector, dot, vector_at
from resample.types import (
    Doubles,
    Floats,
    Layers,
    Records,
    Runs,
    Samples,
    Single,
    Stage,
    Style,
    Tiles,
)

TOO_WIDE = 1e30  # px, spacing of samples that the near plane cuts

Squares = tuple[tuple[Single, Single, Single], tuple[Single, Single, Single]]
Mixed = tuple[Single, Single, Single, Single]
Indices = NDArray[np.int64]


@kernel
def spacing_on_grid(eye: Eye, shape: Shape, n: float) -> tuple[Squares, Mixed, Single]:
    """Coefficients of the squared spacing in sub-pixels at depth 1, in a sample's x / z and y / z.

    Its parts xx and yy are quadratic in x and in y, with the middle coefficient negated; xy has the
    coefficients of 1, -x, -y and xy. All are near 1, as they are divided by the square of a power
    of two, which is returned last: float32 then suffices for scenes of any scale.
    """
    # Choose the power of two by the largest possible spacing.
    v = shape.covariance
    wide = max(eye.fx, eye.fy) * n / shape.radius * math.sqrt(v[0][0] + v[1][1] + v[2][2])
    unit = math.ldexp(1.0, math.frexp(wide)[1])
    fx, fy = n * eye.fx / shape.radius / unit, n * eye.fy / shape.radius / unit
    # Coefficients of the covariance J V Jᵀ on the screen.
    xx, yy, xy = fx * fx, fy * fy, fx * fy
    return (
        (
            (_three(xx * v[0][0], 2.0 * xx * v[0][2], xx * v[2][2])),
            (_three(yy * v[1][1], 2.0 * yy * v[1][2], yy * v[2][2])),
        ),
        (
            np.float32(xy * v[0][1]),
            np.float32(xy * v[1][2]),
            np.float32(xy * v[0][2]),
            np.float32(xy * v[2][2]),
        ),
        np.float32(unit),
    )


@kernel
def _three(first: float, second: float, third: float) -> tuple[Single, Single, Single]:
    return np.float32(first), np.float32(second), np.float32(third)


@kernel
def projected(
    position: Floats, sample: np.uint64, eye: Eye, layers: Layers
) -> tuple[Vector, Single, float, tuple[float, float]]:
    """Center of a sample in camera axes, its key, 1 / depth (1 if parallel), and position, px."""
    world = vector_at(position, sample)
    center = in_camera(eye, world)
    key = key_of(layers, place_of(layers, world, center))
    per_z = 1.0 / center[2] if eye.perspective else 1.0
    x, y = eye.fx * (center[0] * per_z) + eye.cx, eye.fy * (center[1] * per_z) + eye.cy
    return center, key, per_z, (x, y)


@kernel
def squared_spacing(
    center: Vector, per_z: float, eye: Eye, on_grid: tuple[Squares, Mixed, Single]
) -> tuple[Single, Single, Single]:
    """Squared spacing of a sample, and its x / z and y / z: 0 where rays are parallel.

    Float32 suffices, as the result need not be exact to the last bit.
    """
    (x0, x1, x2), (y0, y1, y2) = on_grid[0]
    m0, m1, m2, m3 = on_grid[1]
    # Direction to the sample.
    near, zero, half = np.float32(per_z), np.float32(0.0), np.float32(0.5)
    right = np.float32(center[0]) * near if eye.perspective else zero
    down = np.float32(center[1]) * near if eye.perspective else zero
    # Covariance on the screen, and its larger eigenvalue.
    xx, yy = x0 - right * (x1 - right * x2), y0 - down * (y1 - down * y2)
    xy = m0 - right * m1 - down * (m2 - right * m3)
    mean, apart, size = half * (xx + yy), half * (xx - yy), near * on_grid[2]
    return size * size * (mean + np.sqrt(apart * apart + xy * xy)), right, down


@kernel
def outline_points(
    room: Floats,
    position: Floats,
    extinction: Floats,
    begin: int,
    count: int,
    setup: OutlineSetup,
    style: Style,
) -> None:
    """Compute bounds in px, key and spacing of `count` samples; left > right: not visible."""
    # Constants of all samples.
    (eye, shape, area), layers, _, faintest = setup
    far, reach = eye.perspective, math.sqrt(shape.covariance[2][2])
    least = reach if far else -np.inf
    one, zero = np.float32(1.0), np.float32(0.0)
    extent, variance = np.float32(style.point_extent), np.float32(style.variance)
    for_splats, for_points = np.float32(style.most_for_splats), np.float32(style.most_for_points)
    fixed, thinnest = np.float32(style.subpixels), np.float32(1.0 / 12.0)
    closest = np.float32(min(style.threshold, POINT_SPACING))
    on_grid = spacing_on_grid(eye, shape, 1.0)
    low, high_x, high_y = -area.margin, area.width + area.margin, area.height + area.margin
    for n in range(count):
        k = np.uint64(n)
        sample = np.uint64(begin) + k
        # Project the center, and test it against the near plane.
        center, key, per_z, (x, y) = projected(position, sample, eye, layers)
        cz = center[2]
        is_cut = (cz - reach <= eye.near) | (cz <= least)
        is_seen = (cz + reach > eye.near) & (extinction[sample] > faintest)
        # Spacing, and the finest grid of a tile that holds the sample.
        squared, _, _ = squared_spacing(center, per_z, eye, on_grid)
        spacing = max(np.sqrt(squared), np.float32(1e-6))
        finest = min(for_points, np.floor(closest / spacing))
        finest = max(one, min(for_splats, np.ceil(one / spacing)), finest)
        finest = fixed if fixed > zero else finest
        # Margin of the point filter on that grid.
        width = np.sqrt(variance * squared + thinnest / (finest * finest))
        pad = extent * width
        # Cull by the frame, and write the columns.
        is_inside = (x + pad >= low) & (x - pad <= high_x) & (y + pad >= low) & (y - pad <= high_y)
        is_seen &= is_inside | is_cut
        room[k + LEFT] = np.float32(x - pad) if is_seen else np.float32(np.inf)
        room[k + RIGHT] = np.float32(x + pad) if is_seen else np.float32(-np.inf)
        room[k + TOP] = np.float32(y - pad)
        room[k + BOTTOM] = np.float32(y + pad)
        room[k + KEY] = key
        room[k + SPACING] = np.float32(TOO_WIDE) if is_cut else spacing


@kernel
def is_clipped(position: Floats, sample: int, eye: Eye, planes: Doubles) -> bool:
    """Whether a point's center lies beyond a clipping plane (M, 5)."""
    center = in_camera(eye, vector_at(position, np.uint64(sample)))
    for m in range(planes.shape[0]):
        if dot((planes[m, 0], planes[m, 1], planes[m, 2]), center) + planes[m, 3] <= 0.0:
            return True
    return False


@kernel
def _outline_batch(room: Floats, samples: Samples, begin: int, count: int, stage: Stage) -> None:
    """Bounds, key and spacing of a batch of points; those beyond a plane are hidden."""
    setup, planes = outline_setup(stage, NO_REACH), stage.screen.planes
    position, extinction = samples.position.reshape(-1), samples.extinction
    outline_points(room, position, extinction, begin, count, setup, stage.style)
    # Empty bounds hide a point.
    if planes.shape[0] > 0:
        for n in range(count):
            if is_clipped(position, begin + n, setup.optics.eye, planes):
                room[np.uint64(n) + LEFT], room[np.uint64(n) + RIGHT] = np.inf, -np.inf


@parallel_kernel
def outline_point_runs(
    counter: Counter, known: Records, start: Indices, samples: Samples, stage: Stage
) -> None:
    """Fill in records of runs (R,) of at most BATCH samples, which begin at `start` (R + 1,)."""
    room = np.empty(SCRATCH_SIZE, np.float32)
    for chunk in tasks(counter, CHUNKS):
        first, last = known.size * chunk // CHUNKS, known.size * (chunk + 1) // CHUNKS
        # Project short runs together, as many as fit in a batch.
        while first < last:
            begin, behind = start[first], first + 1
            while behind < last and start[behind + 1] - begin <= BATCH:
                behind += 1
            _outline_batch(room, samples, begin, start[behind] - begin, stage)
            # Reduce each run's samples to its record.
            for run in range(first, behind):
                sum_up(known[run], room, start[run] - begin, start[run + 1] - begin)
            first = behind


@parallel_kernel
def find_point_spacings(counter: Counter, tiles: Tiles, runs: Runs, stage: Stage) -> None:
    """Find each tile's smallest spacing of samples, as exactly as its grid depends on it."""
    room, start = np.empty(SCRATCH_SIZE, np.float32), runs.start
    for tile in tasks(counter, tiles.spacing.size):
        finest = np.inf
        # Project only runs that may make the grid finer.
        for run in tiles.member[tiles.start[tile] : tiles.start[tile + 1]]:
            if may_be_finer(runs.known[run], finest, stage.style):
                begin, count = start[run], start[run + 1] - start[run]
                _outline_batch(room, runs.samples, begin, count, stage)
                finest = min(finest, finest_of(room, count, tile, tiles, stage.screen.margin))
        tiles.spacing[tile] = finest
