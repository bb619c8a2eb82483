"""Intersection of rays with meshes that lie in a field, and shading of their surfaces.

Boxes are in a tree without pointers: the children of box n are 2 n and 2 n + 1, and the last half
of the boxes are leaves. A ray traverses the tree in that order, without a stack.
"""

import math
from typing import Any

from resample.engine.jit import inner_step, plays, role
from resample.engine.lookup import VISIBLE
from resample.engine.rays.extremes import Extreme
from resample.engine.rays.integrators import (
    NOTHING,
    AttenuatedMaximum,
    Composite,
    IsoSurfaceHit,
    Mean,
    Result,
    integrate,
)
from resample.engine.rays.media import (
    Light,
    Medium,
    Ray,
    aims_at,
    depth_cue_at,
    light_shares_at,
    ray_at,
    reflect,
)
from resample.engine.vectors import Vector, combine, cross, dot, scaled
from resample.types import Doubles, Triangles, View

LEAF = 4  # triangles per leaf
BESIDE = 1e-9  # barycentric tolerance, so that no ray slips through between two triangles
BEHIND = 1e-9  # share of a depth by which the next intersection is farther away, at least
MOST_HITS = 64  # surfaces that a ray passes through
OPAQUE = 1e-3  # transmittance that counts as none
ALONG = 1e-30  # scene units per depth, of a ray that is parallel to a wall

Way = Composite | Extreme | Mean | IsoSurfaceHit | AttenuatedMaximum
Hit = tuple[float, int, float, float]  # depth, triangle, weights of its second and third corner


@inner_step
def _scene_vector(view: View, v: Vector) -> Vector:
    """Turn a vector from camera axes to scene axes."""
    turn = view.rotation
    return (
        turn[0, 0] * v[0] + turn[1, 0] * v[1] + turn[2, 0] * v[2],
        turn[0, 1] * v[0] + turn[1, 1] * v[1] + turn[2, 1] * v[2],
        turn[0, 2] * v[0] + turn[1, 2] * v[1] + turn[2, 2] * v[2],
    )


@inner_step
def _scene_ray(x: float, y: float, view: View) -> tuple[Vector, Vector]:
    """Origin, at depth 0, and direction per depth of the ray through a screen point, px."""
    across, down = (x - view.principal[0]) / view.focal[0], (y - view.principal[1]) / view.focal[1]
    shift = (view.translation[0], view.translation[1], view.translation[2])
    # Perspective rays start at the eye and diverge; parallel ones start on the image plane.
    here, toward = (0.0, 0.0, 0.0), (across, down, 1.0)
    if not view.perspective:
        here, toward = (across, down, 0.0), (0.0, 0.0, 1.0)
    return _scene_vector(view, combine(here, -1.0, shift)), _scene_vector(view, toward)


@inner_step
def _slab(least: float, greatest: float, start: float, way: float) -> tuple[float, float]:
    """Depths between which a ray lies between two parallel walls."""
    per = 1.0 / way if abs(way) > ALONG else 1.0 / ALONG
    near, far = (least - start) * per, (greatest - start) * per
    return (near, far) if per > 0.0 else (far, near)


@inner_step
def _meets(box: Doubles, n: int, start: Vector, way: Vector, between: tuple[float, float]) -> bool:
    """Whether a ray meets an axis-aligned box between two depths (slab test)."""
    # Intersect the intervals of the three axes with the given one.
    one = _slab(box[n, 0], box[n, 3], start[0], way[0])
    two = _slab(box[n, 1], box[n, 4], start[1], way[1])
    three = _slab(box[n, 2], box[n, 5], start[2], way[2])
    near = max(one[0], two[0], three[0], between[0])
    return bool(near <= min(one[1], two[1], three[1], between[1]))


@inner_step
def _corner(mesh: Triangles, n: int, k: int) -> Vector:
    corner = mesh.face[n, k]
    return (mesh.corner[corner, 0], mesh.corner[corner, 1], mesh.corner[corner, 2])


@inner_step
def _crossed(mesh: Triangles, n: int, start: Vector, way: Vector) -> tuple[float, float, float]:
    """Depth where a ray meets a triangle, and weights of corners; infinite if it misses.

    Möller and Trumbore, Fast, Minimum Storage Ray/Triangle Intersection, 1997.
    """
    # Edges from the first corner; a zero determinant is a ray parallel to the triangle.
    first = _corner(mesh, n, 0)
    one, two = combine(_corner(mesh, n, 1), -1.0, first), combine(_corner(mesh, n, 2), -1.0, first)
    across = cross(way, two)
    volume = dot(one, across)
    if volume == 0.0:
        return math.inf, 0.0, 0.0
    # Barycentric coordinates of the intersection.
    per, away = 1.0 / volume, combine(start, -1.0, first)
    u, turned = per * dot(away, across), cross(away, one)
    v = per * dot(way, turned)
    if not (u >= -BESIDE and v >= -BESIDE and u + v <= 1.0 + BESIDE):
        return math.inf, 0.0, 0.0
    # Depth along the ray.
    return per * dot(two, turned), u, v


@inner_step
def next_hit(mesh: Triangles, start: Vector, way: Vector, between: tuple[float, float]) -> Hit:
    """Nearest triangle that a ray meets after one depth and before another; -1 if none."""
    after, depth = between
    face, u, v, n = -1, 0.0, 0.0, 1
    leaves = mesh.box.shape[0] // 2
    while n > 0 and leaves > 0:
        # Descend to the first child of a box that is met before the nearest hit so far.
        if _meets(mesh.box, n, start, way, (after, depth)):
            if n < leaves:
                n *= 2
                continue
            # Test all triangles of a leaf.
            first = (n - leaves) * LEAF
            for k in range(first, min(first + LEAF, mesh.face.shape[0])):
                found, found_u, found_v = _crossed(mesh, k, start, way)
                if after < found <= depth and found < math.inf:
                    depth, face, u, v = found, k, found_u, found_v
        # Climb while the box is a second child, then go to the box's sibling.
        while n & 1:
            n >>= 1
        n += int(n > 0)
    return depth, face, u, v


@inner_step
def is_on_mesh(x: float, y: float, mesh: Triangles, view: View) -> bool:
    """Whether there is a triangle at a point of the screen, px."""
    if mesh.face.shape[0] == 0:
        return False
    # Any hit between the near and the far plane counts.
    start, way = _scene_ray(x, y, view)
    return next_hit(mesh, start, way, (view.near, view.far))[1] >= 0


@inner_step
def _mean(of: Doubles, mesh: Triangles, hit: Hit) -> Vector:
    """Interpolate a property of corners (N, 3) at a hit."""
    _, face, u, v = hit
    a, b, c = mesh.face[face, 0], mesh.face[face, 1], mesh.face[face, 2]
    w = 1.0 - u - v
    return (
        w * of[a, 0] + u * of[b, 0] + v * of[c, 0],
        w * of[a, 1] + u * of[b, 1] + v * of[c, 1],
        w * of[a, 2] + u * of[b, 2] + v * of[c, 2],
    )


@inner_step
def _sent(medium: Medium, hit: Hit, at: Vector, place: Vector) -> Light:
    """Straight color and opacity of a triangle where a ray meets it.

    It is lit as the field is; a mesh without normals keeps its own color.
    """
    mesh, lamp, cells = medium.mesh, medium.classifier.lamp, medium.space.cells
    # Interpolate normal and color; without a normal there is no shading.
    normal, color = _mean(mesh.normal, mesh, hit), _mean(mesh.color, mesh, hit)
    length = math.sqrt(dot(normal, normal))
    if length == 0.0:
        return color[0], color[1], color[2], mesh.opacity[hit[1]]
    # Shade with the lamp's diffuse and specular terms.
    own, highlight = reflect(
        scaled(1.0 / length, normal), aims_at(at, medium.classifier), medium.classifier
    )
    of_lamp, of_all = 1.0, 1.0
    # Shadows are known within the field alone.
    if 0.0 < place[0] < cells[0] and 0.0 < place[1] < cells[1] and 0.0 < place[2] < cells[2]:
        of_lamp, of_all = light_shares_at(medium, place)
    # Combine ambient, diffuse and specular light, dimmed by depth.
    kept = depth_cue_at(medium.classifier, hit[0])
    own, high = kept * (of_all * lamp.ambient + of_lamp * own), kept * of_lamp * highlight
    red, green, blue = own * color[0] + high, own * color[1] + high, own * color[2] + high
    return red, green, blue, mesh.opacity[hit[1]]


@inner_step
def _behind(before: Result, found: Result) -> Result:
    """Composite one part of a ray under the part in front of it."""
    # An empty front leaves the other as it is.
    if before[3] == 0.0 and before[6] == 0.0:
        return found
    # Keep the nearest visible depth, and the value of the part that has one.
    left = 1.0 - before[3]
    first = before[5] if before[5] < math.inf else found[5]
    value, presence = before[7], before[8]
    if found[8] > 0.0:
        value, presence = found[7], found[8]
    # Add what the front's transmittance lets through.
    return (
        before[0] + left * found[0],
        before[1] + left * found[1],
        before[2] + left * found[2],
        before[3] + left * found[3],
        before[4] + left * found[4],
        first,
        max(before[6], found[6]),
        value,
        presence,
    )


@inner_step
def _with_surface(result: Result, light: Light, depth: float) -> Result:
    """Composite an opaque or translucent surface under a part of a ray."""
    alpha = light[3]
    first = depth if alpha > VISIBLE else math.inf
    surface = (
        alpha * light[0], alpha * light[1], alpha * light[2], alpha, alpha * depth, first, 1.0,
        0.0, 0.0,
    )  # fmt: skip
    return _behind(result, surface)


@role
def cast(
    way: Any,
    ray: Ray,
    point: tuple[float, float],
    medium: Medium,
    view: View,
    between: tuple[float, float],
) -> Result:
    """Integrate meshes along a ray through a point of the screen, px, between two depths."""
    raise NotImplementedError


@plays(cast, of=object)
def _(
    way: Any,
    ray: Ray,
    point: tuple[float, float],  # noqa: ARG001
    medium: Medium,
    view: View,  # noqa: ARG001
    between: tuple[float, float],  # noqa: ARG001
) -> Result:
    return integrate(way, ray, medium) if ray.steps > 0 else NOTHING


@inner_step
def integrate_with_mesh(
    x: float, y: float, hint: float, way: Way, medium: Medium, view: View
) -> Result:
    """Cast a ray through a screen point, px, through a field and the meshes in it.

    `hint`: as in `Ray`.
    """
    mesh, result, after = medium.mesh, NOTHING, view.near
    # Trace from surface to surface: the field in between, then the surface.
    start, toward = _scene_ray(x, y, view)
    for _ in range(MOST_HITS):
        # March through the field up to the next surface.
        hit = next_hit(mesh, start, toward, (after, view.far))
        ray = ray_at(x, y, medium.space, view, (after, hit[0]), hint)
        result = _behind(result, cast(way, ray, (x, y), medium, view, (after, hit[0])))
        # Stop behind the last surface, or once the ray is opaque.
        if hit[1] < 0 or 1.0 - result[3] <= OPAQUE:
            break
        # Shade the surface and composite it.
        depth = hit[0]
        place = combine(ray.start, depth, ray.way)
        light = _sent(medium, hit, combine(start, depth, toward), place)
        result = _with_surface(result, light, depth)
        if 1.0 - result[3] <= OPAQUE:
            break
        # Go on behind it, so that the same triangle is not hit again.
        after = depth + BEHIND * abs(depth)
    return result
