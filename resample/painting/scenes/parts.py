"""Samples that are loaded part by part."""

from collections.abc import Callable
from typing import NamedTuple

from resample.types import Classifier, Doubles, Field, Floats, Indices, Samples

SLACK = 1e-5  # share of lengths in a scene that rounding may take away, at most


class SamplesInParts(NamedTuple):
    """Samples in parts that are loaded when it is their turn; none of them is in two."""

    center: Doubles  # (P, 3) of balls around the places of each part's samples, scene units
    radius: Doubles  # (P,) of the same
    bounds: Floats  # (P, 4) left, top, right and bottom of their footprints, px
    sizes: Indices  # (P,) samples of each, at most
    lattice: Doubles  # (3, 3) as of `Samples`
    load: Callable[[Indices], Samples | Field]  # gives those of some parts, in any order
    step: int  # samples that are loaded together, or more where no part is that small
    classifier: Classifier | None = None  # of parts of a field
