"""Choose the painter of a picture whose samples are loaded in parts."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from resample.painting.points import can_defer_points, plan_of_points, suits_points
from resample.painting.scenes.plans import (
    MIXTURE,
    POINTS,
    SLACK,
    SPLATS,
    PicturePlan,
    PlansOfPart,
    SamplesInParts,
    together,
)
from resample.painting.scenes.scene import PreparedScene, size_of_tiles
from resample.painting.slabs import columns_of, planned_as_summed
from resample.painting.splats import are_splats_exact, has_points, planned_as
from resample.types import AFFINE, MOST_COLUMNS, SMALL_ANGLE, Samples

MIRRORED = (AFFINE, SMALL_ANGLE)  # footprints that are symmetric about their center


class Painters(NamedTuple):
    """Painters that are possible with some choices."""

    is_streamed: bool  # splats are composited one by one
    has_point_filter: bool  # the filter of points is a formula


def _tile_of(scene: PreparedScene, by: Painters, plan: PicturePlan) -> int:
    """Side in px of a tile for a picture of such samples."""
    from resample.engine.subpixels import grid_of

    columns = MOST_COLUMNS if by.is_streamed else columns_of(scene, plan.least)
    return size_of_tiles(grid_of(plan.least, scene.style), scene.tables.pixel_margin, columns)


def plans_of(
    scene: PreparedScene, samples: Samples, by: Painters, asked: Sequence[str]
) -> PlansOfPart:
    """Plans of some samples for the requested painters, as far as possible."""
    planned = planned_as if by.is_streamed else planned_as_summed
    splats = points = mixture = None
    if SPLATS in asked and are_splats_exact(scene):
        splats = planned(scene, samples, SPLATS)
    if POINTS in asked and _may_be_points(scene, by):
        points = plan_of_points(scene, samples)
    if MIXTURE in asked:
        mixture = planned(scene, samples, MIXTURE)
    return PlansOfPart(splats, points, mixture)


def _may_be_points(scene: PreparedScene, by: Painters) -> bool:
    return by.is_streamed and by.has_point_filter and can_defer_points(scene)


def plan_of_all(
    scene: PreparedScene, by: Painters, parts: Sequence[PlansOfPart]
) -> PicturePlan | None:
    """Plan of all samples together; None: plans for other painters are needed."""
    splats, points, mixture = (_combined_plan(plans) for plans in zip(*parts, strict=True))
    found = None
    if are_splats_exact(scene):
        if splats is None:
            return None
        found = None if has_points(scene, splats) else splats
    if found is None and _may_be_points(scene, by):
        if points is None:
            return None
        found = points if suits_points(scene, points) else None
    found = found or mixture
    if found is None:
        return None
    return found._replace(tile=_tile_of(scene, by, found), spacing=None)


def _combined_plan(plans: Sequence[PicturePlan | None]) -> PicturePlan | None:
    """Combined plan of one painter; None if it is missing for a part."""
    known = [plan for plan in plans if plan is not None]
    return together(known) if len(known) == len(plans) else None


def margin_beyond_window(scene: PreparedScene, plan: PicturePlan) -> tuple[bool, float]:
    """Extent of painted samples beyond their exact footprints.

    Returns
    -------
    Whether they are symmetric about their center, and a bound on the extent, px.
    """
    from resample.engine.points.adding import MOST_TAPS

    style = scene.style
    if plan.painter == SPLATS:
        return False, 0.0
    widened = style.inflated * scene.ellipsoid.radius + float(np.sqrt(style.blurred))
    of_points = 0.0
    if style.threshold > 0:
        spacing = min(float(plan.most), style.threshold)
        width = np.sqrt(style.variance * spacing**2 + 1 / 12)
        # Points are no wider than that, in sub-pixels.
        of_points = min(style.point_extent * float(width), 0.5 * MOST_TAPS + 0.5)
    return style.model in MIRRORED, max(widened, of_points)


def plan_of_parts(scene: PreparedScene, source: SamplesInParts, by: Painters) -> PicturePlan | None:
    """Plan of splats with exact footprints from bounds of parts; None if these do not suffice.

    They suffice if the whole picture has equal sub-pixels and no sample may be a point. Layers do
    not begin at the first sample.
    """
    from resample.engine.subpixels import grid_of

    least, most = _spacings(scene, source)
    finest = grid_of(least, scene.style)
    if finest != grid_of(most, scene.style) or least * finest <= scene.style.threshold:
        return None
    low, high = source.bounds[:, :2].min(axis=0), source.bounds[:, 2:].max(axis=0)
    plan = PicturePlan(
        SPLATS,
        (scene.screen.height, scene.screen.width),
        1,
        scene.screen.margin,
        np.float32(least),
        np.float32(most),
        np.inf,
        np.inf,
        scene.layers,
        (float(low[0]), float(low[1]), float(high[0]), float(high[1])),
        int(source.sizes.sum()),
    )
    return plan._replace(tile=_tile_of(scene, by, plan))


def _spacings(scene: PreparedScene, source: SamplesInParts) -> tuple[float, float]:
    """Bounds on the spacings of samples, px; 0 where the near plane may cut one.

    As `_spacings_of` of `resample.engine.ellipsoids.run_bounds`, for balls.
    """
    view, ellipsoid = scene.view, scene.ellipsoid
    center = source.center @ view.rotation.T + view.translation
    half = source.radius + SLACK * (np.abs(center).sum(axis=1) + np.abs(view.translation).sum())
    v, (fx, fy), z = ellipsoid.covariance, view.focal, center[:, 2]
    near = z - half
    front = near.min() - np.sqrt(v[2, 2])
    if front <= view.near or (view.perspective and front <= 0):
        return 0.0, np.inf
    x, y = center[:, :2].T / z if view.perspective else np.zeros((2, len(z)))
    xx = fx * fx * (v[0, 0] - 2 * x * v[0, 2] + x * x * v[2, 2])
    yy = fy * fy * (v[1, 1] - 2 * y * v[1, 2] + y * y * v[2, 2])
    xy = fx * fy * (v[0, 1] - x * v[1, 2] - y * v[0, 2] + x * y * v[2, 2])
    mean, determinant = 0.5 * (xx + yy), xx * yy - xy * xy
    largest = np.sqrt(mean + np.sqrt(np.maximum(0.0, mean * mean - determinant)))
    largest /= ellipsoid.radius
    if not view.perspective:
        return (1 - SLACK) * float(largest.min()), (1 + SLACK) * float(largest.max())
    turn = np.hypot(half + np.abs(x) * half, half + np.abs(y) * half) / near
    change = max(fx, fy) * turn * np.sqrt(v[2, 2]) / ellipsoid.radius
    least, most = (largest - change) / (z + half), (largest + change) / near
    return (1 - SLACK) * float(least.min()), (1 + SLACK) * float(most.max())
