"""Section 4.2, Figure 3, and appendix A: the ellipse that a sample covers on the screen.

P is the eye's ray perpendicular to the viewing plane, Q the ray through the center of the sphere.
One axis of the ellipse, R1, lies in the plane of P and Q; the other, R2, is perpendicular to it and
parallel to the viewing plane.

All of it takes place where the kernel is the unit sphere: the space of a lattice that is uneven or
oblique is stretched until it is. A plane stays a plane there, and the proof holds.
"""

import math

from resample.engine.jit import inner_step
from resample.engine.vectors import Vector, cross, dot, scaled

Ellipse = tuple[Vector, Vector, Vector]  # center, R1, R2
NO_ELLIPSE = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


@inner_step
def cone_section(P: Vector, Q: Vector, is_projected: bool) -> tuple[bool, Ellipse, float]:
    """Ellipse of the unit sphere around Q on the plane through P, perpendicular to it.

    `P`: where the perpendicular from the eye, which is at the origin, meets the viewing plane. `Q`:
    center of the sphere. `is_projected`: put the ellipse around C', the projection of Q, instead of
    the midpoint of A'B'. Result: whether there is an ellipse; its center and the half axes R1 and
    R2, vectors of that space; and α, rad. There is none if the eye is inside the sphere, or if the
    cone of its tangents meets the plane through the eye, so that its section is a parabola or a
    hyperbola.
    """
    length, far = math.sqrt(dot(Q, Q)), math.sqrt(dot(P, P))
    q, p = scaled(1.0 / length, Q), scaled(1.0 / far, P)
    cosine = dot(p, q)  # of θ, the angle between P and Q
    sin2, cos2 = 1.0 / (length * length), cosine * cosine  # of α and of θ
    left = cos2 - sin2  # cos(θ + α) cos(θ − α)
    if sin2 >= 1.0 or cosine <= 0.0 or left <= 0.0:
        return False, NO_ELLIPSE, 0.0

    # The unit vector along which R1 lies: from P toward C'.
    along = (q[0] - cosine * p[0], q[1] - cosine * p[1], q[2] - cosine * p[2])
    sine = math.sqrt(dot(along, along))
    along = scaled(1.0 / sine, along) if sine > 1e-9 else _perpendicular(p)
    beside = cross(p, along)

    # A' and B' are at tan(θ − α) and tan(θ + α) from P. R1 is foreshortened, so the center is their
    # midpoint, not C' at tan θ.
    away = sine / cosine if is_projected else sine * cosine / left
    center = scaled(far, (p[0] + away * along[0], p[1] + away * along[1], p[2] + away * along[2]))
    R1 = scaled(far * math.sqrt(sin2 * (1.0 - sin2)) / left, along)
    R2 = scaled(far * math.sqrt(sin2 / left), beside)
    return True, (center, R1, R2), math.asin(math.sqrt(sin2))


@inner_step
def _perpendicular(p: Vector) -> Vector:
    """A unit vector perpendicular to the unit vector p."""
    side = (0.0, -p[2], p[1]) if abs(p[0]) < 0.5 else (p[2], 0.0, -p[0])
    return scaled(1.0 / math.sqrt(dot(side, side)), side)
