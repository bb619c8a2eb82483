"""Vote out outliers: samples in front that other sources see through."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from resample.cameras.pixels import pixel_centers
from resample.types import Doubles
from resample_warp3d.depth.equation import inverse, warp_places
from resample_warp3d.types import Source, Warped
from resample_warp3d.wide.passages import Passage, Way

VOTES = ("majority", "none")
SAME = 0.02  # relative nearness within which surfaces are the same
REACH = 1  # samples compared around a place


def check_votes(votes: str) -> None:
    """Refuse an unknown way to vote."""
    if votes not in VOTES:
        raise ValueError(f"unknown votes {votes!r}; known: {', '.join(VOTES)}")


def outvoted(
    views: Sequence[Warped], sources: Sequence[Source], equations: Sequence[Way]
) -> list[Warped]:
    """Drop samples that as many sources contradict as confirm.

    A pixel's point is projected back to every other source. A source with the point's depth there,
    within 2 %, confirms it, as does the view itself; a source with only farther samples around it
    contradicts it; a source with something nearer abstains. Only points in front of what another
    view shows at the pixel are tested, so that no holes result.
    """
    shown = [
        np.where(view.coverage > 0, 1.0 / view.depth, 0.0).astype(np.float64) for view in views
    ]
    kept = []
    for n, (view, nearness) in enumerate(zip(views, shown, strict=True)):
        others = [each for m, each in enumerate(shown) if m != n]
        farthest = np.min([np.where(each > 0, each, np.inf) for each in others], axis=0)
        asked = np.flatnonzero((nearness > farthest * (1.0 + SAME)) & (nearness > 0))
        balance = np.ones(asked.size, np.int64)
        point = pixel_centers(view.coverage.shape).reshape(-1, 2)[asked]
        for m, source in enumerate(sources):
            if m == n or source.place.size:
                continue
            balance += vote(source, *led_back(equations[m], point, nearness.flat[asked]))
        out = np.zeros(view.coverage.shape, np.bool_)
        out.flat[asked[balance <= 0]] = True
        kept.append(_without(view, out) if out.any() else view)
    return kept


def led_back(way: Way, place: Doubles, nearness: Doubles) -> tuple[Doubles, Doubles]:
    """Map a target's places (N, 2) px to the source, with their nearness there."""
    if isinstance(way, Passage):
        return way.back(place, nearness)
    return warp_places(inverse(way), place, nearness)


def vote(source: Source, place: Doubles, nearness: Doubles) -> NDArray[np.int64]:
    """Return 1 where a source confirms points, −1 where it contradicts, 0 if unknown."""
    height, width = source.nearness.shape
    at = np.floor(np.where(np.isfinite(place), place, -9.0)).astype(np.int64)
    column, row = at[:, 0], at[:, 1]
    inside = (column >= REACH) & (row >= REACH)
    inside &= (column < width - REACH) & (row < height - REACH)
    column, row = np.where(inside, column, REACH), np.where(inside, row, REACH)
    steps = range(-REACH, REACH + 1)
    around = np.stack([source.nearness[row + y, column + x] for y in steps for x in steps])
    low, high = around.min(axis=0), around.max(axis=0)
    told = inside & (low > 0) & np.isfinite(nearness)
    through = told & (nearness > high * (1.0 + SAME))
    seen = told & ~through & (nearness >= low * (1.0 - SAME))
    return np.asarray(seen.astype(np.int64) - through.astype(np.int64))


def _without(view: Warped, out: NDArray[np.bool_]) -> Warped:
    """Clear some pixels of a view."""
    empty = np.float32(0)
    return view._replace(
        image=np.where(out[..., None], empty, view.image),
        coverage=np.where(out, empty, view.coverage),
        depth=np.where(out, np.float32(np.inf), view.depth),
        magnification=np.where(out, empty, view.magnification),
        confidence=np.where(out, empty, view.confidence),
    )
