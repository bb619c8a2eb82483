"""Ray casting of generated scenes: patterned rectangles and spheres.

A ray is a point plus t times a direction whose component along the camera's axis is 1, so that t is
the z-depth.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Doubles, Floats

PHOTO, CHECKER, STRIPES, TEXT, CLOTH = range(5)

NEAREST = 1e-6  # of a ray's length: nearer hits are the ray's own start
SAME = 1e-4  # of the distance: a point this close to a hit is the point that is hit
LIGHT = (-0.36, -0.72, -0.59)  # direction toward the light
AMBIENT = 0.62


class Objects(NamedTuple):
    """Objects of a scene."""

    is_sphere: NDArray[np.bool_]  # (N,) otherwise a rectangle
    place: Doubles  # (N, 3) a rectangle's corner, a sphere's center
    right: Doubles  # (N, 3) unit vector along a rectangle's first side
    down: Doubles  # (N, 3) unit vector along its second side, perpendicular to the first
    extent: Doubles  # (N, 2) lengths of its sides; a sphere's radius, twice
    pattern: NDArray[np.int64]  # (N,)
    scale: Doubles  # (N,) cells of the pattern per scene unit
    dark: Doubles  # (N, 3) linear light
    bright: Doubles  # (N, 3) linear light


class RayCamera(NamedTuple):
    """A camera and its frame."""

    place: Doubles  # (3,)
    ray: Doubles  # (3, 3) takes px (x, y, 1) to a direction in the scene
    matrix: Doubles  # (3, 4) takes points of the scene to px
    bounds: Doubles  # (N, 4) bounds of objects: left, top, right, bottom, px
    shape: NDArray[np.int64]  # (2,) height and width, px


class VisibleShare(NamedTuple):
    """Visibility of pixels in another camera."""

    fraction: Floats  # (H, W) of a pixel's rays, 0..1
    nearest: Doubles  # (H, W) z; inf where nothing is
    farthest: Doubles  # (H, W) z; inf where a ray hits nothing


@kernel
def _dot(a: Doubles, n: int, x: float, y: float, z: float) -> float:
    """Dot product of row n with a vector."""
    return float(a[n, 0] * x + a[n, 1] * y + a[n, 2] * z)


@kernel
def _sphere(objects: Objects, n: int, start: Doubles, x: float, y: float, z: float) -> float:
    """Intersect a ray with a sphere from outside: t, or inf."""
    px = start[0] - objects.place[n, 0]
    py = start[1] - objects.place[n, 1]
    pz = start[2] - objects.place[n, 2]
    # Solve the quadratic equation for the nearer intersection.
    square = x * x + y * y + z * z
    half = px * x + py * y + pz * z
    beyond = px * px + py * py + pz * pz - objects.extent[n, 0] ** 2
    discriminant = half * half - square * beyond
    if discriminant <= 0.0:
        return math.inf
    return float((-half - math.sqrt(discriminant)) / square)


@kernel
def _rectangle(objects: Objects, n: int, start: Doubles, x: float, y: float, z: float) -> float:
    """Intersect a ray with a rectangle: t, or inf."""
    # Intersect with the plane.
    ax, ay, az = objects.right[n, 0], objects.right[n, 1], objects.right[n, 2]
    bx, by, bz = objects.down[n, 0], objects.down[n, 1], objects.down[n, 2]
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    px = objects.place[n, 0] - start[0]
    py = objects.place[n, 1] - start[1]
    pz = objects.place[n, 2] - start[2]
    toward = nx * x + ny * y + nz * z
    if toward == 0.0:
        return math.inf
    t = (nx * px + ny * py + nz * pz) / toward
    if t <= NEAREST:
        return math.inf
    # Test the hit against both sides.
    u = ax * (t * x - px) + ay * (t * y - py) + az * (t * z - pz)
    v = bx * (t * x - px) + by * (t * y - py) + bz * (t * z - pz)
    if 0.0 <= u <= objects.extent[n, 0] and 0.0 <= v <= objects.extent[n, 1]:
        return float(t)
    return math.inf


@kernel
def _find_candidates(eye: RayCamera, row: int, column: int, candidates: NDArray[np.int64]) -> int:
    """List the objects that may be visible in a pixel; return how many."""
    bounds, count = eye.bounds, 0
    for n in range(bounds.shape[0]):
        if (
            bounds[n, 0] <= column + 1
            and bounds[n, 2] >= column
            and bounds[n, 1] <= row + 1
            and bounds[n, 3] >= row
        ):
            candidates[count] = n
            count += 1
    return count


@kernel
def _first_hit(
    objects: Objects,
    candidates: NDArray[np.int64],
    count: int,
    start: Doubles,
    x: float,
    y: float,
    z: float,
) -> tuple[float, int]:
    """First hit of a ray of direction (x, y, z): t and the object; or inf, −1."""
    nearest, found = math.inf, -1
    for k in range(count):
        n = candidates[k]
        if objects.is_sphere[n]:
            t = _sphere(objects, n, start, x, y, z)
        else:
            t = _rectangle(objects, n, start, x, y, z)
        if NEAREST < t < nearest:
            nearest, found = t, n
    return nearest, found


@kernel
def _random(x: int, y: int, seed: int) -> float:
    """Random number in 0..1 of a lattice cell: a hash of its indices."""
    mixed = (x * 0x1B873593 ^ y * 0x2545F491 ^ seed * 0x3C6EF372) & 0xFFFFFFFF
    mixed = ((mixed ^ (mixed >> 15)) * 0x2C1B3C6D) & 0xFFFFFFFF
    mixed = ((mixed ^ (mixed >> 12)) * 0x297A2D39) & 0xFFFFFFFF
    return float(mixed ^ (mixed >> 15)) / 4294967295.0


@kernel
def _noise(u: float, v: float, seed: int) -> float:
    """Value noise of one octave, 0..1."""
    # Interpolate the cells' numbers with a smoothstep.
    column, row = math.floor(u), math.floor(v)
    x, y = u - column, v - row
    x, y = x * x * (3.0 - 2.0 * x), y * y * (3.0 - 2.0 * y)
    above = _random(column, row, seed) * (1.0 - x) + _random(column + 1, row, seed) * x
    below = _random(column, row + 1, seed) * (1.0 - x) + _random(column + 1, row + 1, seed) * x
    return above * (1.0 - y) + below * y


@kernel
def _octaves(u: float, v: float, count: int, seed: int) -> float:
    """Fractal noise with contrast that falls with frequency as in photographs; 0..1."""
    total, weight, share = 0.0, 0.0, 1.0
    for n in range(count):
        total += share * _noise(u, v, seed + n)
        weight += share
        u, v, share = 2.03 * u + 17.3, 2.03 * v - 9.7, 0.62 * share
    return total / weight


@kernel
def _letters(u: float, v: float) -> float:
    """Lines of random glyphs: 0 is ink, 1 paper.

    A letter is one cell wide and two high.
    """
    column, line = math.floor(u), math.floor(0.5 * v)
    # Draw a glyph of 5 × 7 dots, with gaps between letters, words and lines.
    x, y = int(6.0 * (u - column)), int(10.0 * (0.5 * v - line))
    if x > 4 or y > 6 or _random(column, line, 51) > 0.83:
        return 1.0
    return 0.0 if _random(8 * column + x, 8 * line + y, 53) > 0.52 else 1.0


@kernel
def _blend(pattern: int, u: float, v: float) -> tuple[float, float]:
    """Evaluate a pattern: share of the bright color, and change of hue, in 0..1."""
    if pattern == CHECKER:
        return float((math.floor(u) + math.floor(v)) & 1), 0.5
    if pattern == STRIPES:
        return float(math.floor(u + 0.4 * v) & 1), 0.5
    if pattern == TEXT:
        return _letters(u, v), 0.5
    # Cloth: threads over noise.
    if pattern == CLOTH:
        thread = 0.5 + 0.25 * (math.sin(9.0 * u) + math.sin(9.0 * v))
        return 0.6 * _octaves(u, v, 3, 31) + 0.4 * thread, _noise(0.4 * u, 0.4 * v, 41)
    # Photograph: noise with contours.
    share = _octaves(u, v, 4, 11)
    contour = min(1.0, max(0.0, 14.0 * (_octaves(0.7 * u, 0.7 * v, 3, 23) - 0.47)))
    return min(1.0, max(0.0, 1.5 * share - 0.6 + 0.35 * contour)), _noise(0.3 * u, 0.3 * v, 29)


@kernel
def _add_color(objects: Objects, n: int, x: float, y: float, z: float, sums: Doubles) -> None:
    """Add the light from a point of an object."""
    # Find texture coordinates and the angle to the light.
    if objects.is_sphere[n]:
        radius = objects.extent[n, 0]
        nx = (x - objects.place[n, 0]) / radius
        ny = (y - objects.place[n, 1]) / radius
        nz = (z - objects.place[n, 2]) / radius
        u = radius * math.atan2(nx, -nz)
        v = radius * math.asin(min(1.0, max(-1.0, ny)))
        facing = max(0.0, nx * LIGHT[0] + ny * LIGHT[1] + nz * LIGHT[2])
    else:
        px = x - objects.place[n, 0]
        py = y - objects.place[n, 1]
        pz = z - objects.place[n, 2]
        u, v = _dot(objects.right, n, px, py, pz), _dot(objects.down, n, px, py, pz)
        ax, ay, az = objects.right[n, 0], objects.right[n, 1], objects.right[n, 2]
        bx, by, bz = objects.down[n, 0], objects.down[n, 1], objects.down[n, 2]
        nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        facing = abs(nx * LIGHT[0] + ny * LIGHT[1] + nz * LIGHT[2])
    # Evaluate the pattern, and shade it.
    share, hue = _blend(objects.pattern[n], u * objects.scale[n], v * objects.scale[n])
    light = AMBIENT + (1.0 - AMBIENT) * facing
    for c in range(3):
        tint = 1.0 + (0.7 * hue - 0.35) * (1 - c)
        dark, bright = objects.dark[n, c], objects.bright[n, c]
        sums[c] += light * (dark + (bright - dark) * share) * tint


@kernel
def _direction(eye: RayCamera, x: float, y: float) -> tuple[float, float, float]:
    """Direction of the viewing ray through a point of the frame."""
    ray = eye.ray
    return (
        ray[0, 0] * x + ray[0, 1] * y + ray[0, 2],
        ray[1, 0] * x + ray[1, 1] * y + ray[1, 2],
        ray[2, 0] * x + ray[2, 1] * y + ray[2, 2],
    )


@kernel
def _render_row(
    objects: Objects, eye: RayCamera, row: int, rays: int, color: Floats, depth: Doubles
) -> None:
    """Render a row; see `render_rows`."""
    sums, candidates = np.zeros(3), np.empty(objects.pattern.size, np.int64)
    for column in range(color.shape[1]):
        count = _find_candidates(eye, row, column, candidates)
        # Average a regular grid of rays.
        sums[0], sums[1], sums[2] = 0.0, 0.0, 0.0
        for k in range(rays * rays):
            across = column + (k % rays + 0.5) / rays
            x, y, z = _direction(eye, across, row + (k // rays + 0.5) / rays)
            t, n = _first_hit(objects, candidates, count, eye.place, x, y, z)
            if n >= 0:
                px, py, pz = eye.place[0] + t * x, eye.place[1] + t * y, eye.place[2] + t * z
                _add_color(objects, n, px, py, pz, sums)
        for c in range(3):
            color[row, column, c] = sums[c] / (rays * rays)
        # Take the depth at the center.
        x, y, z = _direction(eye, column + 0.5, row + 0.5)
        depth[row, column] = _first_hit(objects, candidates, count, eye.place, x, y, z)[0]


@parallel_kernel
def render_rows(
    counter: Counter, objects: Objects, eye: RayCamera, rays: int, color: Floats, depth: Doubles
) -> None:
    """Render a scene: means of rays × rays per pixel, and z at pixels' centers.

    `objects`, `eye`: scene and camera. `rays`: along each side of a pixel. `color`: (H, W, 3)
    filled with linear light; black where nothing is. `depth`: (H, W) filled with z; inf where
    nothing is.
    """
    for row in tasks(counter, color.shape[0]):
        _render_row(objects, eye, row, rays, color, depth)


@kernel
def _is_visible(
    objects: Objects,
    other: RayCamera,
    n: int,
    x: float,
    y: float,
    z: float,
    candidates: NDArray[np.int64],
) -> bool:
    """Whether a camera sees a point of an object; `candidates` is scratch."""
    # Project the point; it must be in front of the camera and in its frame.
    matrix = other.matrix
    depth = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z + matrix[2, 3]
    if depth <= 0.0:
        return False
    u = (matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z + matrix[0, 3]) / depth
    v = (matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z + matrix[1, 3]) / depth
    if not (0.0 <= u <= other.shape[1] and 0.0 <= v <= other.shape[0]):
        return False
    # Cast a ray from that camera: the point is visible if it is hit first.
    x, y, z = x - other.place[0], y - other.place[1], z - other.place[2]
    count = _find_candidates(other, math.floor(v), math.floor(u), candidates)
    t, found = _first_hit(objects, candidates, count, other.place, x, y, z)
    return bool(found == n and t > 1.0 - SAME)


@kernel
def _trace_visibility_row(
    objects: Objects, eye: RayCamera, other: RayCamera, row: int, rays: int, sight: VisibleShare
) -> None:
    """Measure the visibility of a row; see `trace_visibility`."""
    candidates = np.empty((2, objects.pattern.size), np.int64)
    for column in range(sight.fraction.shape[1]):
        count = _find_candidates(eye, row, column, candidates[0])
        seen, nearest, farthest = 0, math.inf, 0.0
        # Cast the pixel's rays, and test each hit in the other camera.
        for k in range(rays * rays):
            across = column + (k % rays + 0.5) / rays
            x, y, z = _direction(eye, across, row + (k // rays + 0.5) / rays)
            t, n = _first_hit(objects, candidates[0], count, eye.place, x, y, z)
            nearest, farthest = min(nearest, t), max(farthest, t)
            if n >= 0:
                px, py, pz = eye.place[0] + t * x, eye.place[1] + t * y, eye.place[2] + t * z
                seen += _is_visible(objects, other, n, px, py, pz, candidates[1])
        sight.fraction[row, column] = np.float32(seen / (rays * rays))
        sight.nearest[row, column] = nearest
        sight.farthest[row, column] = farthest


@parallel_kernel
def trace_visibility(
    counter: Counter,
    objects: Objects,
    eye: RayCamera,
    other: RayCamera,
    rays: int,
    sight: VisibleShare,
) -> None:
    """Measure the share of each pixel that another camera sees, and the depths in it."""
    for row in tasks(counter, sight.fraction.shape[0]):
        _trace_visibility_row(objects, eye, other, row, rays, sight)
