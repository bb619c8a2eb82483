"""Samples that are loaded in parts."""

from collections.abc import Callable
from typing import NamedTuple

from resample.types import Classifier, Doubles, Field, Floats, Indices, Samples

SLACK = 1e-5  # largest relative rounding error of lengths in a scene


class SamplesInParts(NamedTuple):
    """Disjoint parts of samples, loaded on demand."""

    center: Doubles  # (P,) centers of balls around each part's samples, scene units
    radius: Doubles  # (P,) their radii
    bounds: Floats  # (P, 4) left, top, right and bottom of their footprints, px
    sizes: Indices  # (P,) upper bound on samples of each
    lattice: Doubles  # (3, 3) as in `Samples`
    load: Callable[[Indices], Samples | Field]  # returns the samples of some parts, in any order
    step: int  # samples to load together, or more if no part is that small
    classifier: Classifier | None = None  # for parts of a field
