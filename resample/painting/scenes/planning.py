"""Choose who paints a picture whose samples are loaded in parts, and its tiles."""

from collections.abc import Callable, Sequence

import numpy as np

from resample.painting.scenes.plans import (
    SLACK,
    SPLATS,
    PicturePlan,
    PlansOfPart,
    SamplesInParts,
    together,
)
from resample.painting.scenes.scene import PreparedScene, size_of_tiles
from resample.types import AFFINE, DISC, EXACT, SMALL_ANGLE, Single

MIRRORED = (AFFINE, SMALL_ANGLE)  # footprints that are symmetric about their center

Columns = Callable[[Single], int]  # limit on sub-pixels in a row of a tile, by least spacing


def are_splats_exact(scene: PreparedScene) -> bool:
    """Whether splats have exact footprints, and may occur."""
    style = scene.style
    is_exact = style.model == EXACT or (style.model == DISC and not scene.view.perspective)
    return is_exact and style.threshold < np.inf and style.inflated == style.blurred == 0


def has_points(scene: PreparedScene, plan: PicturePlan) -> bool:
    """Whether a plan of splats may include points."""
    from resample.engine.subpixels import grid_of

    return bool(plan.least * grid_of(plan.least, scene.style) <= scene.style.threshold)


def _tile_of(scene: PreparedScene, columns: Columns, least: Single) -> int:
    """Side in px of a tile for a picture of samples with a smallest spacing."""
    from resample.engine.subpixels import grid_of

    most = columns(least)
    return size_of_tiles(grid_of(least, scene.style), scene.tables.pixel_margin, most)


def plan_of_all(
    scene: PreparedScene,
    parts: Sequence[PlansOfPart],
    columns: Columns,
    suits_points: Callable[[PreparedScene, PicturePlan], bool] | None = None,
) -> PicturePlan | None:
    """Plan of all samples together; None: plans for other painters are needed.

    `suits_points`: whether the samples of a plan may be painted as points; None: none are.
    """
    splats, points, mixture = (_combined_plan(plans) for plans in zip(*parts, strict=True))
    found = None
    if are_splats_exact(scene):
        if splats is None:
            return None
        found = None if has_points(scene, splats) else splats
    if found is None and suits_points is not None:
        if points is None:
            return None
        found = points if suits_points(scene, points) else None
    found = found or mixture
    if found is None:
        return None
    return found._replace(tile=_tile_of(scene, columns, found.least), spacing=None)


def _combined_plan(plans: Sequence[PicturePlan | None]) -> PicturePlan | None:
    """Combined plan of one painter; None if it is missing for a part."""
    known = [plan for plan in plans if plan is not None]
    return together(known) if len(known) == len(plans) else None


def margin_beyond_window(scene: PreparedScene, plan: PicturePlan) -> tuple[bool, float]:
    """Extent of painted samples beyond their exact footprints.

    Result: whether they are symmetric about their center, and a bound on the extent, px.
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


def plan_of_parts(
    scene: PreparedScene, source: SamplesInParts, columns: Columns
) -> PicturePlan | None:
    """Plan of splats with exact footprints from bounds of parts; None if these do not suffice.

    They suffice if splats are exact, the whole picture has equal sub-pixels, and no sample may be a
    point. Layers do not begin at the first sample.
    """
    from resample.engine.subpixels import grid_of

    if not are_splats_exact(scene):
        return None
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
    return plan._replace(tile=_tile_of(scene, columns, plan.least))


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
