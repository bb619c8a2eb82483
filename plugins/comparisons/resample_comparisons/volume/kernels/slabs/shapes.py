"""Footprints of splats in slabs: exact, or by a model where samples are a mixture."""

from typing import NamedTuple

import numpy as np

from resample.engine.ellipsoids.mixed import Bend, Mixture, bend_of
from resample.engine.ellipsoids.outlines import ACROSS, DOWN, A, X, Y
from resample.engine.mixtures.models import POINT
from resample.engine.roles import lane_role, plays
from resample.types import Floats, Place, Single


class Exact(NamedTuple):
    """A splat with an exact footprint: all but its quadratic form is the rays' own."""

    a: Single
    bend: None


class Modelled(NamedTuple):
    """A splat with a modelled footprint, whose form may be centered beside the sample."""

    a: Single
    bend: Bend | None
    right: Single  # px from the sample's center to the form's center
    below: Single


Shape = Exact | Modelled


@lane_role
def shape_of(mixture: Mixture | None, room: Floats, s: np.uint64, place: Place) -> Shape:
    """Footprint of a splat of the batch."""
    raise NotImplementedError


@plays(shape_of, type(None))
def _exact(mixture, room, s, place):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return Exact(room[s + A], None)


@plays(shape_of, Mixture)
def _modelled(mixture, room, s, place):  # type: ignore[no-untyped-def]
    # Offsets ACROSS and DOWN count from the form's center to the tile's first sub-pixel.
    half = np.float32(0.5 / place.subpixels)
    right = np.float32(place.x) + half - room[s + X] - room[s + ACROSS]
    below = np.float32(place.y) + half - room[s + Y] - room[s + DOWN]
    return Modelled(room[s + A], bend_of(mixture, room, s), right, below)


@lane_role
def inverse_square_of(shape: Shape, ray: Single, along: Single) -> Single:
    """Reciprocal of |w|² on a ray; `along` is |w|, and `ray` is known already if exact."""
    raise NotImplementedError


@plays(inverse_square_of, Exact)
def _inverse_square_exactly(shape, ray, along):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return ray


@plays(inverse_square_of, Modelled)
def _inverse_square_by_model(shape, ray, along):  # type: ignore[no-untyped-def]  # noqa: ARG001
    # A model's `ray` is not the pixel's own.
    return np.float32(1.0) / (along * along)


@lane_role
def middle_of(shape: Shape) -> tuple[Single, Single]:
    """Px from the sample's center, right and down, to the form's center."""
    raise NotImplementedError


@plays(middle_of, Exact)
def _at_center(shape):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return np.float32(0.0), np.float32(0.0)


@plays(middle_of, Modelled)
def _elsewhere(shape):  # type: ignore[no-untyped-def]
    return shape.right, shape.below


@lane_role
def is_point(mixture: Mixture | None, mark: Single) -> bool:
    """Whether the column CUT marks a point."""
    raise NotImplementedError


@plays(is_point, type(None))
def _never(mixture, mark):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return False


@plays(is_point, Mixture)
def _if_marked(mixture, mark):  # type: ignore[no-untyped-def]  # noqa: ARG001
    # Splats have their cut in this column, points a mark of their own.
    return mark == POINT
