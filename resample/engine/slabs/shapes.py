"""Footprints of splats that are summed: exact, or by a model, where samples are a mixture."""

from typing import NamedTuple

import numpy as np

from resample.engine.ellipsoids.mixed import Mixture
from resample.engine.ellipsoids.models import POINT
from resample.engine.ellipsoids.outlines import (
    ACROSS,
    AMPLITUDE,
    BENT,
    DOWN,
    FLAT,
    A,
    X,
    Y,
)
from resample.engine.roles import lane_role, plays
from resample.types import Floats, Place, Single


class Exact(NamedTuple):
    """A splat that takes all but its form from the pixels' rays."""

    a: Single


class Modelled(NamedTuple):
    """A splat by a model, whose form need not lie where its center does."""

    a: Single
    flat: Single
    bent: Single
    amplitude: Single
    right: Single  # px from the form's middle to the sample's center, negated
    below: Single


Shape = Exact | Modelled


@lane_role
def shape_of(mixture: Mixture | None, room: Floats, s: np.uint64, place: Place) -> Shape:
    """A splat of a batch."""
    raise NotImplementedError


@plays(shape_of, type(None))
def _exact(mixture, room, s, place):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return Exact(room[s + A])


@plays(shape_of, Mixture)
def _modelled(mixture, room, s, place):  # type: ignore[no-untyped-def]  # noqa: ARG001
    half = np.float32(0.5 / place.subpixels)
    right = np.float32(place.x) + half - room[s + X] - room[s + ACROSS]
    below = np.float32(place.y) + half - room[s + Y] - room[s + DOWN]
    return Modelled(room[s + A], room[s + FLAT], room[s + BENT], room[s + AMPLITUDE], right, below)


@lane_role
def squared_of(shape: Shape, u: Single) -> Single:
    """Squared distance of a ray from the center, from the form times the ray's own number."""
    raise NotImplementedError


@plays(squared_of, Exact)
def _squared_exactly(shape, u):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return u


@plays(squared_of, Modelled)
def _squared_by_model(shape, u):  # type: ignore[no-untyped-def]
    one, inside = np.float32(1.0), max(np.float32(0.0), u)
    return inside / (shape.flat + shape.bent * inside) if inside < one else one


@lane_role
def amplitude_of(shape: Shape, chord: Single) -> Single:
    """What line integrals of the unit kernel are multiplied by, from the ray's own number."""
    raise NotImplementedError


@plays(amplitude_of, Exact)
def _amplitude_of_ray(shape, chord):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return chord


@plays(amplitude_of, Modelled)
def _amplitude_of_model(shape, chord):  # type: ignore[no-untyped-def]
    return chord * shape.amplitude


@lane_role
def inverse_square_of(shape: Shape, ray: Single, along: Single) -> Single:
    """Inverse square of a ray's radii per depth, `along`, which is its own number if exact."""
    raise NotImplementedError


@plays(inverse_square_of, Exact)
def _inverse_square_exactly(shape, ray, along):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return ray


@plays(inverse_square_of, Modelled)
def _inverse_square_by_model(shape, ray, along):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return np.float32(1.0) / (along * along)


@lane_role
def from_center(shape: Shape, dx: Single) -> Single:
    """Px to the right of the sample's center, from those to the right of the form's middle."""
    raise NotImplementedError


@plays(from_center, Exact)
def _from_middle(shape, dx):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return dx


@plays(from_center, Modelled)
def _from_elsewhere(shape, dx):  # type: ignore[no-untyped-def]
    return dx + shape.right


@lane_role
def below_center(shape: Shape, dy: Single) -> Single:
    """Likewise downwards."""
    raise NotImplementedError


@plays(below_center, Exact)
def _below_middle(shape, dy):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return dy


@plays(below_center, Modelled)
def _below_elsewhere(shape, dy):  # type: ignore[no-untyped-def]
    return dy + shape.below


@lane_role
def is_point(mixture: Mixture | None, mark: Single) -> bool:
    """Whether what stands in the column CUT marks a point."""
    raise NotImplementedError


@plays(is_point, type(None))
def _never(mixture, mark):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return False


@plays(is_point, Mixture)
def _if_marked(mixture, mark):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return mark == POINT
