"""The obvious slow ways to join views: each pixel against every other and every source."""

import math

import numpy as np

from resample_warp3d.depth.equation import inverse, warp_places

SAME = 0.02
FEATHER = 2.0
WHOLE = 0.95


def feather(shown):
    """Smooth step of each pixel's distance to the nearest one that is not shown."""
    made = np.ones(shown.shape)
    missing = np.argwhere(~shown)
    for place in np.ndindex(shown.shape):
        if not missing.size:
            continue
        away = np.sqrt(np.square(missing - place).sum(axis=1).min())
        share = min(away / FEATHER, 1.0)
        made[place] = max(share * share * (3.0 - 2.0 * share), 1e-3)
    return made


def front(views, blend="feathered"):
    """Color (H, W, C) and coverage of what covers a pixel: means over those that show it."""
    shape = views[0].coverage.shape
    nearness = [np.where(view.coverage > 0, 1.0 / view.depth, 0.0) for view in views]
    is_front = np.zeros((len(views), *shape), bool)
    for place in np.ndindex(shape):
        solid = [
            n[place] for n, view in zip(nearness, views, strict=True) if view.coverage[place] >= 0.5
        ]
        nearest = max(solid, default=0.0)
        for k, n in enumerate(nearness):
            is_front[k][place] = n[place] > 0 and n[place] >= nearest * (1 - SAME)
    soft = [
        feather(where & (view.coverage >= WHOLE))
        for where, view in zip(is_front, views, strict=True)
    ]
    image, coverage = np.zeros(views[0].image.shape), np.zeros(shape)
    for place in np.ndindex(shape):
        weight = [
            (view.confidence[place] ** 2 * (s[place] if blend == "feathered" else 1) + 1e-12)
            * w[place]
            for view, s, w in zip(views, soft, is_front, strict=True)
        ]
        if sum(weight) > 0:
            share = np.array(weight) / sum(weight)
            image[place] = sum(w * view.image[place] for w, view in zip(share, views, strict=True))
            coverage[place] = sum(
                w * view.coverage[place] for w, view in zip(share, views, strict=True)
            )
    return image, coverage


def angle(place, depth, source, target):
    """Angle between the rays of two cameras at a point of the target, by its place in the world."""
    back = np.linalg.inv(target.world_to_camera)
    ray = np.linalg.inv(target.matrix) @ [place[1] + 0.5, place[0] + 0.5, 1.0]
    point = (back @ [*(ray * depth), 1.0])[:3]
    eyes = [np.linalg.inv(camera.world_to_camera)[:3, 3] for camera in (source, target)]
    one, other = (point - eye for eye in eyes)
    cosine = one @ other / np.linalg.norm(one) / np.linalg.norm(other)
    return math.acos(min(1.0, cosine))


def outvoted(views, sources, equations):
    """Pixels (V, H, W) whose points as many sources look through as see."""
    out = np.zeros((len(views), *views[0].coverage.shape), bool)
    for n, view in enumerate(views):
        for place in np.ndindex(view.coverage.shape):
            others = [
                other.depth[place]
                for m, other in enumerate(views)
                if m != n and other.coverage[place] > 0
            ]
            depth = view.depth[place]
            if not view.coverage[place] or not others or max(others) <= depth * (1 + SAME):
                continue
            votes = 1 + sum(
                _vote(source, equation, place, 1.0 / depth)
                for m, (source, equation) in enumerate(zip(sources, equations, strict=True))
                if m != n
            )
            out[n][place] = votes <= 0
    return out


def _vote(source, equation, place, nearness):
    point = np.array([place[1] + 0.5, place[0] + 0.5])
    at, expected = warp_places(inverse(equation), point, np.float64(nearness))
    if not np.isfinite(at).all():
        return 0
    column, row = (math.floor(each) for each in at)
    height, width = source.nearness.shape
    if not (1 <= row < height - 1 and 1 <= column < width - 1):
        return 0
    around = source.nearness[row - 1 : row + 2, column - 1 : column + 2]
    if around.min() <= 0 or not np.isfinite(expected):
        return 0
    if expected > around.max() * (1 + SAME):
        return -1
    return int(expected >= around.min() * (1 - SAME))
