"""Meshes in a field: where rays meet them, and what light they send.

Boxes lie in a tree without pointers: those of box n are 2 n and 2 n + 1, and the last half of them
are leaves. A ray goes through the tree in that order, so it needs no memory of its own.
"""

import math

from resample.engine.jit import inner_step
from resample.engine.over import VISIBLE
from resample.engine.rays.looks import Light
from resample.engine.rays.marching import ray_at
from resample.engine.rays.media import Medium, aims_at, kept_at, reaching, reflect
from resample.engine.rays.seeing import NOTHING, Result, Way, seen
from resample.engine.vectors import Vector, combine, cross, dot, scaled
from resample.types import Doubles, Triangles, View

LEAF = 4  # triangles of a leaf
BESIDE = 1e-9  # shares of a triangle's sides by which a ray may miss it, so that none slips through
BEHIND = 1e-9  # share of a depth that the next triangle is farther away, at least
MOST_HITS = 64  # surfaces that a ray goes through
OPAQUE = 1e-3  # transmittance that counts as none
ALONG = 1e-30  # scene units per depth, of a ray that leaves no box along an axis

Hit = tuple[float, int, float, float]  # depth, triangle, and shares of its second and third corner


@inner_step
def _scene_vector(view: View, v: Vector) -> Vector:
    """Vector in scene axes of one in camera axes."""
    turn = view.rotation
    return (
        turn[0, 0] * v[0] + turn[1, 0] * v[1] + turn[2, 0] * v[2],
        turn[0, 1] * v[0] + turn[1, 1] * v[1] + turn[2, 1] * v[2],
        turn[0, 2] * v[0] + turn[1, 2] * v[1] + turn[2, 2] * v[2],
    )


@inner_step
def _scene_ray(x: float, y: float, view: View) -> tuple[Vector, Vector]:
    """Place at depth 0 of a ray through a point of the screen, and its way per depth."""
    across, down = (x - view.principal[0]) / view.focal[0], (y - view.principal[1]) / view.focal[1]
    shift = (view.translation[0], view.translation[1], view.translation[2])
    here, toward = (0.0, 0.0, 0.0), (across, down, 1.0)
    if not view.perspective:
        here, toward = (across, down, 0.0), (0.0, 0.0, 1.0)
    return _scene_vector(view, combine(here, -1.0, shift)), _scene_vector(view, toward)


@inner_step
def _slab(least: float, greatest: float, start: float, way: float) -> tuple[float, float]:
    """Depths between which a ray is between two walls."""
    per = 1.0 / way if abs(way) > ALONG else 1.0 / ALONG
    near, far = (least - start) * per, (greatest - start) * per
    return (near, far) if per > 0.0 else (far, near)


@inner_step
def _meets(box: Doubles, n: int, start: Vector, way: Vector, between: tuple[float, float]) -> bool:
    """Whether a ray meets a box between two depths."""
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
    """Depth where a ray meets a triangle, and shares of corners; infinite if it does not.

    Möller and Trumbore, Fast, Minimum Storage Ray/Triangle Intersection, 1997.
    """
    first = _corner(mesh, n, 0)
    one, two = combine(_corner(mesh, n, 1), -1.0, first), combine(_corner(mesh, n, 2), -1.0, first)
    across = cross(way, two)
    volume = dot(one, across)
    if volume == 0.0:
        return math.inf, 0.0, 0.0
    per, away = 1.0 / volume, combine(start, -1.0, first)
    u, turned = per * dot(away, across), cross(away, one)
    v = per * dot(way, turned)
    if not (u >= -BESIDE and v >= -BESIDE and u + v <= 1.0 + BESIDE):
        return math.inf, 0.0, 0.0
    return per * dot(two, turned), u, v


@inner_step
def next_hit(mesh: Triangles, start: Vector, way: Vector, between: tuple[float, float]) -> Hit:
    """The first triangle that a ray meets behind one depth and before another; -1 if none."""
    after, depth = between
    face, u, v, n = -1, 0.0, 0.0, 1
    leaves = mesh.box.shape[0] // 2
    while n > 0 and leaves > 0:
        if _meets(mesh.box, n, start, way, (after, depth)):
            if n < leaves:
                n *= 2
                continue
            first = (n - leaves) * LEAF
            for k in range(first, min(first + LEAF, mesh.face.shape[0])):
                found, found_u, found_v = _crossed(mesh, k, start, way)
                if after < found <= depth and found < math.inf:
                    depth, face, u, v = found, k, found_u, found_v
        while n & 1:
            n >>= 1
        n += int(n > 0)
    return depth, face, u, v


@inner_step
def is_on_mesh(x: float, y: float, mesh: Triangles, view: View) -> bool:
    """Whether there is a triangle at a point of the screen, px."""
    if mesh.face.shape[0] == 0:
        return False
    start, way = _scene_ray(x, y, view)
    return next_hit(mesh, start, way, (view.near, view.far))[1] >= 0


@inner_step
def _mean(of: Doubles, mesh: Triangles, hit: Hit) -> Vector:
    """What corners have, between them."""
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
    """Straight color of a triangle where a ray meets it, and its opacity.

    It is lit as the field is, but for what has no normals: that is seen as it is.
    """
    mesh, lamp, cells = medium.mesh, medium.look.lamp, medium.space.cells
    normal, color = _mean(mesh.normal, mesh, hit), _mean(mesh.color, mesh, hit)
    length = math.sqrt(dot(normal, normal))
    if length == 0.0:
        return color[0], color[1], color[2], mesh.opacity[hit[1]]
    own, highlight = reflect(scaled(1.0 / length, normal), aims_at(at, medium.look), medium.look)
    of_lamp, of_all = 1.0, 1.0
    if (
        0.0 < place[0] < cells[0] and 0.0 < place[1] < cells[1] and 0.0 < place[2] < cells[2]
    ):  # light is known within the field alone
        of_lamp, of_all = reaching(medium, place)
    kept = kept_at(medium.look, hit[0])
    own, high = kept * (of_all * lamp.ambient + of_lamp * own), kept * of_lamp * highlight
    red, green, blue = own * color[0] + high, own * color[1] + high, own * color[2] + high
    return red, green, blue, mesh.opacity[hit[1]]


@inner_step
def _behind(before: Result, found: Result) -> Result:
    """What is seen of a part of a ray behind another part."""
    if before[3] == 0.0 and before[6] == 0.0:
        return found
    left = 1.0 - before[3]
    first = before[5] if before[5] < math.inf else found[5]
    value, presence = before[7], before[8]
    if found[8] > 0.0:
        value, presence = found[7], found[8]
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
    """What is seen with a surface behind it."""
    alpha = light[3]
    first = depth if alpha > VISIBLE else math.inf
    surface = (
        alpha * light[0], alpha * light[1], alpha * light[2], alpha, alpha * depth, first, 1.0,
        0.0, 0.0,
    )  # fmt: skip
    return _behind(result, surface)


@inner_step
def seen_with_mesh(x: float, y: float, way: Way, medium: Medium, view: View) -> Result:
    """What a ray through a point of the screen, px, sees of a field and of meshes in it."""
    mesh, result, after = medium.mesh, NOTHING, view.near
    start, toward = _scene_ray(x, y, view)
    for _ in range(MOST_HITS):
        hit = next_hit(mesh, start, toward, (after, view.far))
        ray = ray_at(x, y, medium.space, view, (after, hit[0]))
        if ray.steps > 0:
            result = _behind(result, seen(way, ray, medium))
        if hit[1] < 0 or 1.0 - result[3] <= OPAQUE:
            break
        depth = hit[0]
        place = combine(ray.start, depth, ray.way)
        light = _sent(medium, hit, combine(start, depth, toward), place)
        result = _with_surface(result, light, depth)
        if 1.0 - result[3] <= OPAQUE:
            break
        after = depth + BEHIND * abs(depth)
    return result
