"""Triangles in screen space, clipped at the near plane, with linear functions.

On screen, `(x, y)` is in px. `u` and `t` span a texture from its upper left corner, 0..1 each, and
continue periodically.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.engine.vectors import Matrix, Vector, column, cross, dot, multiply
from resample.engine.windows.footprints import cut_to
from resample.types import Doubles, Records

Ints = NDArray[np.int64]
Place = tuple[float, float]

# Of a triangle on screen, px: what the engine sorts into tiles. left > right: not visible.
BOUNDS = np.dtype([(name, np.float64) for name in ("left", "top", "right", "bottom", "spacing")])
CHUNK = 1024  # triangles that a thread takes at a time


class Faces(NamedTuple):
    """T triangles of V vertices, projected."""

    point: Doubles  # (V, 3) vertices as (x w, y w, w), w the depth or, where parallel, 1
    depth: Doubles  # (V,) of the vertices
    corner: Ints  # (T, 3) vertices of the triangles
    uv: Doubles  # (T, 3, 2) u and t there


class ProjectedTriangles(NamedTuple):
    """T triangles in screen space, without what lies before the near plane."""

    corner: Doubles  # (T, 4, 2) px, in order around the triangle
    corners: Ints  # (T,) 3 or 4; 0: not visible
    weight: Doubles  # (T, 3, 3) row k times (x, y, 1): vertex k's barycentric weight over w
    nearness: Doubles  # (T, 3) times (x, y, 1): 1 / depth, or -depth where parallel
    limit: Doubles  # (T, 2) least and greatest nearness
    forward: Doubles  # (T, 3, 3) homography from (u, t, 1) to (x w, y w, w)
    determinant: Doubles  # (T,) of `forward`; 0: texture coordinates without area
    facing: Doubles  # (T,) -1: toward the camera, 1: away
    bounds: Records  # (T,) of BOUNDS


class VisibilityCamera(NamedTuple):
    """Camera parameters of visibility."""

    near: float  # scene units, of the near plane
    perspective: bool
    cull: bool  # leave out what faces away
    tolerance: float  # how far apart in nearness one surface's neighbouring triangles may be,
    # times the nearness where perspective


@kernel
def _add_corner(triangles: ProjectedTriangles, n: int, point: Vector, nearness: float) -> None:
    """Append a corner to a triangle's polygon, and extend the limits of its nearness."""
    k = triangles.corners[n]
    triangles.corner[n, k, 0] = point[0] / point[2]
    triangles.corner[n, k, 1] = point[1] / point[2]
    triangles.corners[n] = k + 1
    triangles.limit[n, 0] = min(triangles.limit[n, 0], nearness)
    triangles.limit[n, 1] = max(triangles.limit[n, 1], nearness)


@kernel
def _cut_near(triangles: ProjectedTriangles, n: int, faces: Faces, lens: VisibilityCamera) -> None:
    """Clip a triangle at the near plane, to a polygon on screen.

    The intersection is computed from the inner end of an edge to the outer one, so that both
    triangles that share the edge get the same.
    """
    point, depth, corner, _ = faces
    triangles.limit[n, 0], triangles.limit[n, 1] = np.inf, -np.inf
    # Visit the edges (Sutherland-Hodgman).
    for k in range(3):
        a, b = corner[n, k], corner[n, (k + 1) % 3]
        seen, next_seen = depth[a] > lens.near, depth[b] > lens.near
        # Keep corners beyond the near plane.
        if seen:
            nearness = 1.0 / depth[a] if lens.perspective else -depth[a]
            _add_corner(triangles, n, (point[a, 0], point[a, 1], point[a, 2]), nearness)
        # Add the intersection where an edge crosses it.
        if seen != next_seen:
            inner, outer = (a, b) if seen else (b, a)
            share = (depth[inner] - lens.near) / (depth[inner] - depth[outer])
            x = point[inner, 0] + share * (point[outer, 0] - point[inner, 0])
            y = point[inner, 1] + share * (point[outer, 1] - point[inner, 1])
            w = lens.near if lens.perspective else 1.0
            _add_corner(triangles, n, (x, y, w), 1.0 / w if lens.perspective else -lens.near)


@kernel
def _set_forward(triangles: ProjectedTriangles, n: int, faces: Faces) -> None:
    """Set the homography from texture to screen; 0 for a texture without area."""
    point, _, corner, uv = faces
    # Take the texture's edge vectors; their determinant tells whether it has area.
    a, b, c = corner[n, 0], corner[n, 1], corner[n, 2]
    u1, t1 = uv[n, 1, 0] - uv[n, 0, 0], uv[n, 1, 1] - uv[n, 0, 1]
    u2, t2 = uv[n, 2, 0] - uv[n, 0, 0], uv[n, 2, 1] - uv[n, 0, 1]
    area = u1 * t2 - u2 * t1
    if not abs(area) > 1e-12 * (u1 * u1 + t1 * t1 + u2 * u2 + t2 * t2):
        return
    # Solve for the affine map from (u, t) to each homogeneous screen coordinate.
    for k in range(3):
        first, second = point[b, k] - point[a, k], point[c, k] - point[a, k]
        along_u = (first * t2 - second * t1) / area
        along_t = (second * u1 - first * u2) / area
        triangles.forward[n, k, 0] = along_u
        triangles.forward[n, k, 1] = along_t
        triangles.forward[n, k, 2] = point[a, k] - along_u * uv[n, 0, 0] - along_t * uv[n, 0, 1]
    matrix = matrix_at(triangles.forward, n)
    triangles.determinant[n] = dot(column(matrix, 2), cross(column(matrix, 0), column(matrix, 1)))


@kernel
def _project_triangle(
    n: int, faces: Faces, lens: VisibilityCamera, triangles: ProjectedTriangles
) -> None:
    """Set up a triangle: facing, barycentric weights, nearness, clipping, homography."""
    point, depth, corner, _ = faces
    a, b, c = corner[n, 0], corner[n, 1], corner[n, 2]
    p = (point[a, 0], point[a, 1], point[a, 2])
    q = (point[b, 0], point[b, 1], point[b, 2])
    r = (point[c, 0], point[c, 1], point[c, 2])
    # Invert the matrix of the corners by cross products.
    rows = (cross(q, r), cross(r, p), cross(p, q))
    volume = dot(p, rows[0])
    # Cull triangles seen edge-on, and back faces if asked to.
    if not (0.0 < abs(volume) < np.inf) or (lens.cull and volume > 0.0):
        return
    triangles.facing[n] = math.copysign(1.0, volume)
    # Express barycentric weights and nearness as linear functions of (x, y, 1).
    weight = (1.0, 1.0, 1.0)
    if not lens.perspective:
        weight = (-depth[a], -depth[b], -depth[c])
    for k in range(3):
        across = column(rows, k)
        for m in range(3):
            triangles.weight[n, m, k] = across[m] / volume
        triangles.nearness[n, k] = dot(across, weight) / volume
    _cut_near(triangles, n, faces, lens)
    _set_forward(triangles, n, faces)


@kernel
def _bound(triangles: ProjectedTriangles, n: int) -> None:
    """Write the bounds of a triangle on screen."""
    left, top, right, bottom = np.inf, np.inf, -np.inf, -np.inf
    for k in range(triangles.corners[n]):
        x, y = triangles.corner[n, k, 0], triangles.corner[n, k, 1]
        left, right = min(left, x), max(right, x)
        top, bottom = min(top, y), max(bottom, y)
    record = triangles.bounds[n]
    record["left"], record["top"], record["right"], record["bottom"] = left, top, right, bottom


@kernel
def _project_chunk(
    chunk: int, faces: Faces, lens: VisibilityCamera, triangles: ProjectedTriangles
) -> None:
    """Project the triangles of a chunk, and bound them."""
    for n in range(chunk * CHUNK, min((chunk + 1) * CHUNK, len(faces.corner))):
        _project_triangle(n, faces, lens, triangles)
        _bound(triangles, n)


@parallel_kernel
def project_triangles(
    counter: Counter, faces: Faces, lens: VisibilityCamera, triangles: ProjectedTriangles
) -> None:
    """Project triangles: fill in the visible ones; all are 0 before."""
    for chunk in tasks(counter, (len(faces.corner) + CHUNK - 1) // CHUNK):
        _project_chunk(chunk, faces, lens, triangles)


@kernel
def matrix_at(matrices: Doubles, n: int) -> Matrix:
    """One matrix of an array (N, 3, 3)."""
    return (
        (matrices[n, 0, 0], matrices[n, 0, 1], matrices[n, 0, 2]),
        (matrices[n, 1, 0], matrices[n, 1, 1], matrices[n, 1, 2]),
        (matrices[n, 2, 0], matrices[n, 2, 1], matrices[n, 2, 2]),
    )


@kernel
def plane_at(triangles: ProjectedTriangles, n: int) -> Vector:
    """Coefficients of a triangle's nearness for (x, y, 1), also outside of it."""
    return triangles.nearness[n, 0], triangles.nearness[n, 1], triangles.nearness[n, 2]


@kernel
def barycentric(triangles: ProjectedTriangles, n: int, place: Place) -> Vector:
    """Barycentric weights of the vertices at a place in a triangle, of sum 1."""
    a, b, c = multiply(matrix_at(triangles.weight, n), (place[0], place[1], 1.0))
    # Clamp: rounding may put a place just outside.
    a, b, c = max(0.0, a), max(0.0, b), max(0.0, c)
    total = a + b + c
    # Without a valid sum, as in a triangle thinner than rounding, take the centroid.
    if not 0.0 < total < np.inf:
        return 1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0
    return a / total, b / total, c / total


@kernel
def texture_place(triangles: ProjectedTriangles, uv: Doubles, n: int, place: Place) -> Place:
    """Texture coordinates u and t of a place on screen."""
    weight = barycentric(triangles, n, place)
    return (
        dot(weight, (uv[n, 0, 0], uv[n, 1, 0], uv[n, 2, 0])),
        dot(weight, (uv[n, 0, 1], uv[n, 1, 1], uv[n, 2, 1])),
    )


@kernel
def stretch(forward: Matrix, place: Place) -> tuple[Place, Place]:
    """Derivatives of (x, y) by u, and by t, at a texture place."""
    xw, yw, w = multiply(forward, (place[0], place[1], 1.0))
    x, y = xw / w, yw / w
    (xu, xt, _), (yu, yt, _), (wu, wt, _) = forward
    return ((xu - x * wu) / w, (yu - y * wu) / w), ((xt - x * wt) / w, (yt - y * wt) / w)


@kernel
def stretched(forward: Matrix, place: Place) -> tuple[float, float]:
    """Length on screen of a unit step of u and of one of t, px."""
    along_u, along_t = stretch(forward, place)
    return math.hypot(along_u[0], along_u[1]), math.hypot(along_t[0], along_t[1])


@kernel
def cut_out(
    triangles: ProjectedTriangles,
    n: int,
    rectangle: tuple[float, float, float, float],
    polygon: Doubles,
    spare: Doubles,
) -> int:
    """Clip a triangle to left, top, right, bottom, px; count its corners.

    `polygon` (8, 2) receives them; `spare` is scratch of its shape.
    """
    count = triangles.corners[n]
    # Copy the corners: clipping overwrites them.
    for k in range(count):
        polygon[k, 0], polygon[k, 1] = triangles.corner[n, k, 0], triangles.corner[n, k, 1]
    return cut_to(polygon, spare, count, rectangle)
