"""Footprints of splats that are summed: exact, or by a model, where samples are a mixture."""

from typing import NamedTuple

import numpy as np

from resample.engine.ellipsoids.mixed import Bend, Mixture, bend_of
from resample.engine.ellipsoids.models import POINT
from resample.engine.ellipsoids.outlines import ACROSS, DOWN, A, X, Y
from resample.engine.roles import lane_role, plays
from resample.types import Floats, Place, Single


class Exact(NamedTuple):
    """A splat that takes all but its form from the pixels' rays."""

    a: Single
    bend: None


class Modelled(NamedTuple):
    """A splat by a model, whose form need not lie where its center does."""

    a: Single
    bend: Bend | None
    right: Single  # px from the form's middle to the sample's center, negated
    below: Single


Shape = Exact | Modelled


@lane_role
def shape_of(mixture: Mixture | None, room: Floats, s: np.uint64, place: Place) -> Shape:
    """A splat of a batch."""
    raise NotImplementedError


@plays(shape_of, type(None))
def _exact(mixture, room, s, place):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return Exact(room[s + A], None)


@plays(shape_of, Mixture)
def _modelled(mixture, room, s, place):  # type: ignore[no-untyped-def]
    half = np.float32(0.5 / place.subpixels)
    right = np.float32(place.x) + half - room[s + X] - room[s + ACROSS]
    below = np.float32(place.y) + half - room[s + Y] - room[s + DOWN]
    return Modelled(room[s + A], bend_of(mixture, room, s), right, below)


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
