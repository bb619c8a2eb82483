"""Render several sources as one picture: match, vote, blend.

Of the views that show a pixel's nearest surface, those that sampled it best count most.
"""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import Camera, Orthographic
from resample.cameras.pixels import pixel_centers
from resample.messages import check_kind
from resample.profiles.filters import PixelFilter
from resample.types import Doubles, Floats
from resample_warp3d.depth.equation import between, inverse, warp_places
from resample_warp3d.projection_models import CameraModel, Passage, Way, mapping_between, unproject
from resample_warp3d.types import Hole, Method, Source, Warped
from resample_warp3d.views.matching import (
    WHOLE,
    Match,
    balanced,
    check_colors,
    check_depths,
    match_colors,
    match_depths,
    scaled,
)

Blend = Literal["feathered", "confident", "best"]
BLENDS = get_args(Blend)
SHARP = 2.0  # power of the confidence in the weights
LEAST = 1e-12  # weight of a view without confidence
FEATHER = 2.0  # px from a view's border to its full weight
AT_BORDER = 1e-3  # weight of a view beside its border
AHEAD = np.array([0.0, 0.0, 1.0])
OBLIQUE = math.radians(4.0)  # angle at which a view's weight is halved

Mask = NDArray[np.bool_]
SAME = 0.02  # relative nearness within which views show the same surface
SOLID = 0.5  # least coverage of a view's surface that hides others
VOTES = ("majority", "none")
POSES = ("refined", "none")
REACH = 1  # samples compared around a place


def check_blend(blend: Blend) -> None:
    """Refuse an unknown blend."""
    if blend not in BLENDS:
        raise ValueError(f"unknown blend {blend!r}; known: {', '.join(BLENDS)}")


def weights(
    views: Sequence[Warped], shown: NDArray[np.bool_], shares: Sequence[Floats], blend: Blend
) -> list[Floats]:
    """Return the weight (H, W) of each view; 0 where it does not show the surface.

    `shown`: (V, H, W) where each view shows the surface in question. `shares`: (H, W) factors of
    each view, such as from `angle_share`; or empty.
    """
    found = []
    for n, (view, where) in enumerate(zip(views, shown, strict=True)):
        weight = view.confidence**SHARP
        if shares:
            weight = weight * shares[n]
        if blend == "feathered":
            weight = weight * feather(where & (view.coverage >= WHOLE))
        found.append(np.where(where, weight + LEAST, 0).astype(np.float32))
    if blend != "best":
        return found
    stack = np.stack(found)
    first = stack.argmax(axis=0)
    return [np.where((first == n) & where, np.float32(1), 0) for n, where in enumerate(stack > 0)]


def feather(shown: Mask) -> Floats:
    """Return a ramp from 0 at a mask's border to 1 inside; the frame is not a border."""
    if shown.all():
        return np.ones(shown.shape, np.float32)
    import cv2

    mask = shown.astype(np.uint8)
    away = cv2.distanceTransform(mask, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    share = np.clip(away / np.float32(FEATHER), 0, 1)
    smooth = share * share * (3 - 2 * share)
    return np.asarray(np.maximum(smooth, np.float32(AT_BORDER)), np.float32)


def angle_share(view: Warped, source: Camera, target: CameraModel) -> Floats:
    """Return a view's weight 0..1 by the angle between its rays and the target's."""
    relative = target.world_to_camera @ np.linalg.inv(source.world_to_camera)
    eye = relative[:3, 3]
    shape = view.coverage.shape[0], view.coverage.shape[1]
    depth = np.where(np.isfinite(view.depth), view.depth, 1.0)
    ray, _ = unproject(target, shape, pixel_centers(shape), 1.0 / depth)
    point = np.nan_to_num(ray * depth[..., None])
    back = point - eye
    along = np.broadcast_to(AHEAD, ray.shape) if isinstance(target, Orthographic) else point
    aside = np.linalg.norm(np.cross(along, back), axis=2)
    angle = np.arctan2(aside, np.einsum("hwk,hwk->hw", along, back))
    return np.asarray(1.0 / (1.0 + np.square(angle / OBLIQUE)), np.float32)


def merge(
    views: Sequence[Warped], blend: Blend = "feathered", shares: Sequence[Floats] = ()
) -> Warped:
    """Merge views of one target, each warped from another source.

    Parameters
    ----------
    views
        Of one shape; the result does not depend on their order, bit by bit.
    blend
        `feathered`: weighted by confidence, fading out toward the border of what a view shows, to
        avoid seams; `confident`: weighted by confidence only; `best`: the view with the largest
        weight only, for labels.
    shares
        (H, W) further factors of the views' weights. Default: none.

    Returns
    -------
    Per pixel the mean, weighted by confidence, of the views that show its nearest surface: a source
    that saw the surface from nearby, and not at a grazing angle, has more samples there. Where that
    surface covers a pixel in part, the surface behind it shows. A hole is a hole in all views; of
    its causes the one that is easiest to fix is kept.

    Raises
    ------
    ValueError
        There is no view, their shapes differ, or the blend is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import Camera, merge, warp
    >>> target = Camera.from_fov(60, 24, 32)
    >>> sides = [target.moved(np.c_[np.eye(3), [x, 0, 0]]) for x in (-0.5, 0.5)]
    >>> views = [warp(np.ones((24, 32)), np.full((24, 32), 2.0), side, target) for side in sides]
    >>> [round(float(view.coverage.mean()), 2) for view in (*views, merge(views))]
    [0.85, 0.85, 1.0]
    """
    check_blend(blend)
    for view in views:
        check_kind("view", view, Warped, "results of warp(color, depth, source, target)")
    shapes = {view.image.shape for view in views}
    if len(shapes) != 1:
        raise ValueError(f"views of one shape can be merged, not of {sorted(shapes) or 'none'}")
    order = order_of_bits([(v.image, v.coverage, v.depth, v.confidence) for v in views])
    ordered = [views[n] for n in order]
    factors = [shares[n] for n in order] if shares else []
    nearness = np.stack(
        [np.where(view.coverage > 0, 1.0 / view.depth, 0).astype(np.float32) for view in ordered]
    )
    is_front, (image, coverage, *front) = _surface(ordered, nearness, factors, blend)
    hidden = np.where(is_front, 0, nearness)
    _, (image_behind, coverage_behind, *behind) = _surface(ordered, hidden, factors, blend)
    rest = np.float32(1) - coverage
    near, magnification, confidence = np.where(coverage > 0, front, behind)
    coverage = coverage + rest * coverage_behind
    depth = np.divide(1.0, near, out=np.full_like(near, np.inf), where=near > 0)
    image = image + rest[..., None] * image_behind
    # Holes that all views have; cracks where no view is better.
    reason = np.full(coverage.shape, Hole.NONE, np.uint8)
    for hole in (Hole.OUTSIDE, Hole.NO_DEPTH, Hole.DISOCCLUDED):
        reason[np.any([view.holes == hole for view in ordered], axis=0)] = hole
    is_crack = np.any([view.holes == Hole.CRACK for view in ordered], axis=0)
    is_whole = np.any([(view.holes == Hole.NONE) & (view.coverage > 0) for view in ordered], axis=0)
    covered = np.where(is_crack & ~is_whole, np.uint8(Hole.CRACK), np.uint8(Hole.NONE))
    holes = np.where(coverage > 0, covered, reason)
    return Warped(image, coverage, depth, holes, magnification, confidence)


def _surface(
    views: Sequence[Warped], nearness: Floats, shares: Sequence[Floats], blend: Blend
) -> tuple[NDArray[np.bool_], list[Floats]]:
    """Find the nearest surface of views (V, H, W): where each shows it, and its mean."""
    solid = np.stack([view.coverage >= SOLID for view in views])
    front = np.where(solid, nearness, 0).max(axis=0)
    is_front = (nearness >= front * (1.0 - SAME)) & (nearness > 0)
    total = np.zeros(front.shape, np.float32)
    image = np.zeros(views[0].image.shape, np.float32)
    coverage, near, magnification, confidence = (np.zeros_like(total) for _ in range(4))
    counts = weights(views, is_front, shares, blend)
    for view, shown, depth, weight in zip(views, is_front, nearness, counts, strict=True):
        total += weight
        image += weight[..., None] * view.image
        coverage += weight * view.coverage
        near += weight * depth
        magnification += weight * view.magnification
        confidence = np.maximum(confidence, np.where(shown, view.confidence, 0))
    share = np.divide(1.0, total, out=np.zeros_like(total), where=total > 0)
    means = (each * share for each in (coverage, near, magnification))
    return is_front, [image * share[..., None], *means, confidence]


def order_of_bits(things: Sequence[Sequence[NDArray[Any]]]) -> list[int]:
    """Return a canonical order of items, by a hash of their arrays."""

    def digest(n: int) -> bytes:
        parts = (np.ascontiguousarray(part).data for part in things[n])
        return hashlib.blake2b(b"".join(parts)).digest()

    return sorted(range(len(things)), key=digest)


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
            way, near = equations[m], nearness.flat[asked]
            if isinstance(way, Passage):
                balance += vote(source, *way.back(point, near))
            else:
                balance += vote(source, *warp_places(inverse(way), point, near))
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
        `merge`. `feathered` also weights by the angle to the target.
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
        from resample_warp3d.views.matching import refined_poses

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
