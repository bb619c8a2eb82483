"""Footprints of splats that are summed: exact, or by a model, where samples are a mixture."""

from typing import NamedTuple

import numpy as np

from resample.engine.ellipsoids.mixed import Bend, Mixture, bend_of
from resample.engine.ellipsoids.outlines import ACROSS, DOWN, A, X, Y
from resample.engine.mixtures.models import POINT
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
    right: Single  # px from the sample's center to the form's middle
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
def middle_of(shape: Shape) -> tuple[Single, Single]:
    """Px to the right of the sample's center and below it where the form's middle is."""
    raise NotImplementedError


@plays(middle_of, Exact)
def _at_center(shape):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return np.float32(0.0), np.float32(0.0)


@plays(middle_of, Modelled)
def _elsewhere(shape):  # type: ignore[no-untyped-def]
    return shape.right, shape.below


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
