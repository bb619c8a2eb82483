"""A spinning laser scanner in a street, by formula: 64 rings of directions, a ground, and boxes."""

from typing import NamedTuple

import numpy as np

HEIGHT = 1.73  # of the scanner above the ground, m
LOWEST, HIGHEST = -24.8, 2.0  # elevation of the rings, degrees
RINGS, STEPS = 64, 2048
FARTHEST = 60.0  # m
BOXES = (  # x, y and z of two corners, m; the scanner is at 0, the ground at −HEIGHT
    ((6.0, -9.0, -HEIGHT), (14.0, -5.0, 1.0)),
    ((-12.0, 4.0, -HEIGHT), (-8.0, 10.0, 2.5)),
    ((3.0, 7.0, -HEIGHT), (5.0, 9.0, -0.4)),
)


class Hits(NamedTuple):
    """Where rays from the scanner end."""

    away: np.ndarray  # (N,) in lengths of the ray; inf if it meets nothing
    place: np.ndarray  # (N, 3)
    normal: np.ndarray  # (N, 3)
    is_ground: np.ndarray  # (N,)


def hits(ray: np.ndarray) -> Hits:
    """The nearest surface along rays (N, 3) from the origin."""
    with np.errstate(divide="ignore", invalid="ignore"):
        away = np.where(ray[:, 2] < 0, -HEIGHT / ray[:, 2], np.inf)
        normal = np.tile([0.0, 0.0, 1.0], (len(ray), 1))
        is_ground = np.isfinite(away)
        for low, high in BOXES:
            one, two = np.array(low) / ray, np.array(high) / ray
            enter, leave = np.minimum(one, two), np.maximum(one, two)
            first, axis = enter.max(axis=1), enter.argmax(axis=1)
            meets = (first > 0) & (first <= leave.min(axis=1)) & (first < away)
            away[meets], is_ground[meets] = first[meets], False
            normal[meets] = np.eye(3)[axis[meets]]
        return Hits(away, ray * away[:, None], normal, is_ground)


def street(noise: float = 0.0, rings: int = RINGS, steps: int = STEPS) -> Hits:
    """What the scanner measures in one turn; `noise`: standard deviation along each axis, m."""
    elevation = np.radians(np.linspace(LOWEST, HIGHEST, rings))[:, None]
    azimuth = np.linspace(0, 2 * np.pi, steps, endpoint=False)[None, :]
    parts = np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth)
    found = hits(np.stack([*parts, np.sin(elevation) + 0 * azimuth], axis=-1).reshape(-1, 3))
    seen = found.away < FARTHEST
    off = noise * np.random.default_rng(4).normal(size=(np.count_nonzero(seen), 3))
    return Hits(
        found.away[seen], found.place[seen] + off, found.normal[seen], found.is_ground[seen]
    )
