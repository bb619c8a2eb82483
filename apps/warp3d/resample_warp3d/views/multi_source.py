"""Render several sources as one picture: match, vote, blend."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import Camera
from resample.cameras.pixels import pixel_centers
from resample.profiles.filters import PixelFilter
from resample.types import Doubles
from resample_warp3d.depth.equation import between, inverse, warp_places
from resample_warp3d.projection_models import CameraModel, Passage, Way, mapping_between
from resample_warp3d.types import Method, Source, Warped
from resample_warp3d.views.matching import (
    Match,
    balanced,
    check_colors,
    check_depths,
    match_colors,
    match_depths,
    scaled,
)
from resample_warp3d.views.merging import Blend, angle_share, check_blend, merge, order_of_bits

VOTES = ("majority", "none")
POSES = ("refined", "none")
SAME = 0.02  # relative nearness within which surfaces are the same
REACH = 1  # samples compared around a place


def outvoted(
    views: Sequence[Warped], sources: Sequence[Source], equations: Sequence[Way]
) -> list[Warped]:
    """Drop samples that at least as many sources contradict as confirm.

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
        cleared = {}
        if out.any():
            cleared = {"depth": np.where(out, np.float32(np.inf), view.depth)}
            cleared["image"] = np.where(out[..., None], np.float32(0), view.image)
            for name in ("coverage", "magnification", "confidence"):
                cleared[name] = np.where(out, np.float32(0), getattr(view, name))
        kept.append(view._replace(**cleared))
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


@dataclass(frozen=True)
class Joining:
    """Options of combining several views.

    Parameters
    ----------
    blend
        How views that show a pixel's surface are blended: `feathered`, `confident` or `best`; see
        `resample_warp3d.views.merging.merge`. `feathered` also weights by the angle to the target.
    colors
        How colors are matched: `gain`, `gain-bias` or `none`.
    depths
        How depths are matched: `scale` or `none`.
    votes
        `majority` drops samples with as many sources against as for them; `none` keeps all.
    poses
        `refined` moves views of pinholes until their colors and depths agree, keeping the mean of
        their poses, if that makes them agree better; `none` keeps poses.

    Raises
    ------
    ValueError
        A name is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import Camera, Joining, panorama, render_together
    >>> sources = panorama(np.ones((64, 128, 3)), np.full((64, 128), 3.0))
    >>> camera, hard = Camera.from_fov(60, 24, 32), Joining(blend="best", colors="none")
    >>> render_together(sources, camera, (24, 32), joining=hard).warped
    Warped(24 × 32 × 3 float32, 100 % covered)
    """

    blend: Blend = "feathered"
    colors: Literal["gain", "gain-bias", "none"] = "gain"
    depths: Literal["scale", "none"] = "scale"
    votes: Literal["majority", "none"] = "majority"
    poses: Literal["refined", "none"] = "refined"

    def __post_init__(self) -> None:
        check_blend(self.blend)
        check_colors(self.colors)
        check_depths(self.depths)
        for name, known in (("votes", VOTES), ("poses", POSES)):
            given = getattr(self, name)
            if given not in known:
                raise ValueError(f"unknown {name} {given!r}; known: {', '.join(known)}")


PLAIN = Joining("confident", "none", "none", "none", "none")  # without corrections or votes


class PosedSource(NamedTuple):
    """A prepared source and its camera.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import Camera, DepthImage, Joining, PosedSource, agreed, prepare
    >>> color, nearness = np.ones((24, 32, 3), np.float32), np.full((24, 32), 0.5, np.float32)
    >>> source = prepare(DepthImage(color, nearness))
    >>> camera = Camera.from_fov(60, 24, 32)
    >>> right = camera.moved(np.c_[np.eye(3), [-0.1, 0, 0]])
    >>> agreed([PosedSource(source, camera), PosedSource(source, right)], Joining()).scale.tolist()
    [1.0, 1.0]
    """

    source: Source
    camera: Camera


class Agreed(NamedTuple):
    """Sources with matched depths, in canonical order."""

    standing: list[PosedSource]
    order: list[int]  # indices into the sources as given
    scale: Doubles  # (V,) factors of the nearness, in the given order
    moved: Doubles  # (V,) scene units by which their cameras were moved, in the given order


class Joined(NamedTuple):
    """Picture of several views, with the corrections of their colors."""

    warped: Warped
    match: Match  # in the given order of the sources


def agreed(given: Sequence[PosedSource], joining: Joining) -> Agreed:
    """Match the poses and depths of several sources; the result serves every target.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import Camera, DepthImage, Joining, PosedSource, agreed, prepare
    >>> color, none = np.ones((24, 32, 3), np.float32), np.empty((0, 0, 2))
    >>> maps = [np.full((24, 32), nearness, np.float32) for nearness in (0.5, 0.51)]
    >>> sources = [prepare(DepthImage(color, nearness, none)) for nearness in maps]
    >>> camera = Camera.from_fov(60, 24, 32)
    >>> together = agreed([PosedSource(s, camera) for s in sources], Joining(poses="none"))
    >>> together.scale.round(3).tolist()  # of their nearness
    [1.01, 0.99]
    """
    order = order_of_bits([(s.color, s.nearness, c.matrix, c.world_to_camera) for s, c in given])
    standing = [given[n] for n in order]
    if joining.poses == "refined" and not any(each.source.place.size for each in given):
        from resample_warp3d.views.registration import refined_poses

        sources, cameras = [each.source for each in standing], [each.camera for each in standing]
        places = [camera.world_to_camera for camera in cameras]
        poses = refined_poses(sources, [camera.matrix for camera in cameras], places)
        posed = [camera.moved(pose) for camera, pose in zip(cameras, poses, strict=True)]
        standing = list(map(PosedSource, sources, posed))
    equations = [[between(one.camera, other.camera) for other in standing] for one in standing]
    found = match_depths([each.source for each in standing], equations, joining.depths)
    scale = np.ones(len(given))
    scale[order] = found
    ready = [
        each._replace(source=scaled(each.source, float(factor)))
        for each, factor in zip(standing, found, strict=True)
    ]
    centers = [
        np.linalg.inv(each.camera.world_to_camera)[:3, 3]
        - np.linalg.inv(given[n].camera.world_to_camera)[:3, 3]
        for each, n in zip(ready, order, strict=True)
    ]
    moved = np.empty(len(given))
    moved[order] = np.linalg.norm(centers, axis=1)
    return Agreed(ready, order, scale, moved)


def layers_of(sources: Agreed, layers: Sequence[Source | None]) -> Agreed:
    """Return the layers behind sources, with the sources' match; layers in the given order."""
    standing, order = [], []
    for each, n in zip(sources.standing, sources.order, strict=True):
        layer = layers[n]
        if layer is not None:
            standing.append(each._replace(source=scaled(layer, float(sources.scale[n]))))
            order.append(n)
    return sources._replace(standing=standing, order=order)


def render_together(
    sources: Agreed,
    target: CameraModel,
    shape: tuple[int, int],
    method: str | Method = "hybrid",
    joining: Joining | None = None,
    *,
    filter: str | PixelFilter | None = None,  # noqa: A002
    threads: int | None = None,
    match: Match | None = None,
) -> Joined:
    """Render several sources together for one camera.

    Parameters
    ----------
    sources
        Result of `agreed`.
    target, shape
        Camera of any kind, as `resample_warp3d.warp` takes it, and height and width, px.
    method, filter, threads
        As `resample_warp3d.warp` takes them.
    joining
        Options; None: the defaults.
    match
        Color match of another frame, so that the brightness of films is stable; None: find one.

    Returns
    -------
    The picture, bit-identical for any order of the sources and any number of threads.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import Camera, DepthImage, Joining, PosedSource
    >>> from resample_warp3d import agreed, prepare, render_together
    >>> color = np.repeat(np.linspace(0.1, 0.9, 48, dtype=np.float32), 64).reshape(48, 64, 1)
    >>> nearness, none = np.full((48, 64), 0.5, np.float32), np.empty((0, 0, 2))
    >>> camera = Camera.from_fov(60, 48, 64)
    >>> views = []
    >>> for exposure, x in ((1.0, -0.2), (0.5, 0.2)):
    ...     source = prepare(DepthImage(exposure * color, nearness, none))
    ...     views.append(PosedSource(source, camera.moved(np.c_[np.eye(3), [x, 0, 0]])))
    >>> joined = render_together(agreed(views, Joining()), camera, (48, 64))
    >>> joined.warped
    Warped(48 × 64 × 1 float32, 100 % covered)
    >>> joined.match.gain.round(2).tolist()  # of an exposure and its half
    [[0.71], [1.41]]
    """
    from resample_warp3d.warping import render

    if not isinstance(sources, Agreed):
        raise TypeError(
            f"sources of {type(sources).__name__}; give the result of agreed(...) or panorama(...)"
        )
    chosen = Joining() if joining is None else joining
    equations = [mapping_between(each.camera, target, shape) for each in sources.standing]
    views = [
        render(each.source, equation, shape, method, threads, filter=filter)
        for each, equation in zip(sources.standing, equations, strict=True)
    ]
    if match is None:
        found = match_colors(views, chosen.colors)
        match = Match(np.empty_like(found.gain), np.empty_like(found.bias))
        match.gain[sources.order], match.bias[sources.order] = found
    ordered = Match(match.gain[sources.order], match.bias[sources.order])
    views = balanced(views, ordered)
    if chosen.votes == "majority" and len(views) > 1:
        views = outvoted(views, [each.source for each in sources.standing], equations)
    if len(views) == 1:
        return Joined(views[0], match)
    shares = (
        [angle_share(v, s.camera, target) for v, s in zip(views, sources.standing, strict=True)]
        if chosen.blend == "feathered"
        else []
    )
    return Joined(merge(views, chosen.blend, shares), match)
