"""What parts of a picture need of the whole: its plan, and samples that are loaded in parts."""

import operator
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from resample.types import Classifier, Doubles, Field, Floats, Indices, Layers, Samples, Single
from resample.words import check_threads, shortly

SPLATS, POINTS, MIXTURE, PAPER = "splats", "points", "mixture", "paper"  # names of painters
ALL_PAINTERS = (SPLATS, POINTS, MIXTURE)  # of which all samples decide

Window = tuple[int, int, int, int]  # x0, y0, x1, y1, px of the whole picture; the end is exclusive
NOTHING: Window = (0, 0, 0, 0)  # window for a plan without a picture
LARGEST_PICTURE = 2**28  # px
SLACK = 1e-5  # largest relative rounding error of lengths in a scene


class PicturePlan(NamedTuple):
    """Properties of a picture that depend on all its samples; found once, given to each window.

    Examples
    --------
    >>> import numpy as np
    >>> from resample import Camera, Resampler, particles
    >>> balls = particles([[0, 0, 5], [1, 0, 9]], [[1, 0, 0], [0, 0, 1]], 0.9, 1)
    >>> picture = {"camera": Camera.from_fov(60, 24, 32), "height": 24, "width": 32}
    >>> plan = Resampler().plan(balls, **picture)
    >>> plan.painter
    'splats'
    >>> part = Resampler().paint_window(balls, picture["camera"], plan, (8, 0, 20, 24))
    >>> bool(np.array_equal(part.rgba, Resampler()(balls, **picture).rgba[:, 8:20]))
    True
    """

    painter: str  # "splats", "points", "mixture" or "paper"
    size: tuple[int, int]  # height and width of the whole picture, px
    tile: int  # px, side of a tile; windows that end inside a tile paint all of it
    margin: float  # px around a tile from which samples contribute
    least: Single  # px, smallest spacing of samples
    most: Single  # px, largest spacing of samples
    farthest: float  # largest absolute key, in the order's units
    strongest: float  # largest extinction of a sample, per scene unit
    layers: Layers
    bounds: tuple[float, float, float, float]  # left, top, right, bottom of samples, px
    visible: int  # visible samples
    spacing: Floats | None = None  # (T,) smallest spacing in each tile; None: windows find it


class PlansOfPart(NamedTuple):
    """Plans of some of a picture's samples, one per possible painter.

    None: not requested, or impossible. `Resampler.plan_of` combines those of all parts.
    """

    splats: PicturePlan | None  # as if all were splats with exact footprints
    points: PicturePlan | None  # as if all were points
    mixture: PicturePlan | None  # as if they were a mixture of both

    @property
    def visible(self) -> int:
        """Number of visible samples, the largest of all plans."""
        return max(plan.visible for plan in self if plan is not None)


def together(plans: Sequence[PicturePlan]) -> PicturePlan:
    """Plan of all samples, from plans of parts by the same painter."""
    seen = [plan for plan in plans if plan.visible] or plans[:1]
    sides = np.array([plan.bounds for plan in seen])
    low, high = sides[:, :2].min(axis=0), sides[:, 2:].max(axis=0)
    return seen[0]._replace(
        tile=min(plan.tile for plan in seen),
        least=min(plan.least for plan in seen),
        most=max(plan.most for plan in seen),
        farthest=max(plan.farthest for plan in seen),
        strongest=max(plan.strongest for plan in plans),
        # If layers begin at the first sample, it is that of the plan with the greatest places.
        layers=max((plan.layers for plan in plans), key=lambda layers: layers.offset),
        bounds=(float(low[0]), float(low[1]), float(high[0]), float(high[1])),
        visible=sum(plan.visible for plan in seen),
        spacing=None,
    )


def checked_window(window: Window, height: int, width: int) -> Window:
    """Check a window of a picture of a size in px."""
    try:
        x0, y0, x1, y1 = (int(number) for number in window)
    except (TypeError, ValueError):
        raise ValueError(
            f"window {window!r}; give x0, y0, x1 and y1, whole numbers of px"
        ) from None
    if not (0 <= x0 < x1 <= width and 0 <= y0 < y1 <= height):
        raise ValueError(
            f"the window {x0}, {y0}, {x1}, {y1} is not inside a picture of {width} x {height} "
            "pixels; x0 and y0 come before x1 and y1"
        )
    return x0, y0, x1, y1


def shape_of(size: Sequence[int]) -> tuple[int, int]:
    """Height and width from a size, which is width and height, px."""
    width, height = pair_of("size", size, "width and height")
    check_size(height, width)
    return height, width


def pair_of(name: str, given: Any, wanted: str) -> tuple[int, int]:
    """Two whole numbers of px."""
    try:
        first, second = (operator.index(number) for number in given)
    except (TypeError, ValueError):
        raise ValueError(
            f"{name} {shortly(given)}; give {wanted}, two whole numbers of px"
        ) from None
    return first, second


def check_call(camera: Any, height: Any, width: Any, threads: Any) -> None:
    """Reject what is no camera, no size of a picture, or no number of threads."""
    check_size(*pair_of("height and width", (height, width), "both"))
    check_threads(threads)
    if isinstance(camera, np.ndarray) or not callable(getattr(camera, "view", None)):
        raise TypeError(
            f"a camera of {type(camera).__name__}; give a Camera or another with a view, such as "
            "Camera.from_fov(60, height, width)"
        )


def check_size(height: int, width: int) -> None:
    """Reject an invalid size of a picture, px."""
    if height < 1 or width < 1 or height * width > LARGEST_PICTURE:
        raise ValueError(
            f"a picture of {width} x {height} pixels; both sides must be at least 1 and there can "
            f"be at most {LARGEST_PICTURE} pixels"
        )


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
