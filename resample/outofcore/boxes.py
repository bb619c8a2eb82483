"""Boxes around parts of a scene's samples, in space and on the screen."""

from itertools import product
from typing import NamedTuple

import numpy as np

from resample.types import Doubles, Floats, View


class PartBoxes(NamedTuple):
    """Boxes around the centers of the samples of some parts."""

    low: Doubles  # (P, 3) least coordinates, in steps
    high: Doubles  # (P, 3) greatest
    steps: Doubles = np.eye(3)  # columns are steps, scene units
    origin: Doubles = np.zeros(3)  # scene units
    beyond: Doubles | float = 1.0  # steps that a kernel of radius 1 covers beyond its center

    def corners(self) -> Doubles:
        """Return all corners (8 P, 3), scene units."""
        ends = [np.where(at, self.high, self.low) for at in product((False, True), repeat=3)]
        return np.concatenate(ends) @ self.steps.T + self.origin

    def balls(self) -> tuple[Doubles, Doubles]:
        """Return centers (P, 3) and radii (P,) of balls around them, scene units."""
        center = 0.5 * (self.low + self.high) @ self.steps.T + self.origin
        corner = np.array(list(product((-0.5, 0.5), repeat=3)))
        away = (self.high - self.low)[:, np.newaxis] * corner @ self.steps.T
        return center, np.sqrt((away * away).sum(axis=2).max(axis=1))

    def on_screen(self, view: View, radius: float) -> Floats:
        """Return left, top, right and bottom (P, 4), px, of samples with kernels of a radius.

        A box is convex, so the projections of its corners bound it. Infinite where one reaches the
        near plane.
        """
        low, high = self.low - radius * self.beyond, self.high + radius * self.beyond
        steps = view.rotation @ self.steps
        start = view.rotation @ self.origin + view.translation
        least, most = np.full((2, len(low), 2), np.inf) * [[[1.0]], [[-1.0]]]
        is_near = np.zeros(len(low), bool)
        for is_high in product((False, True), repeat=3):
            place = np.where(is_high, high, low) @ steps.T + start
            is_near |= place[:, 2] <= view.near
            on_screen = _projected(place, view)
            least, most = np.minimum(least, on_screen), np.maximum(most, on_screen)
        if view.perspective:
            least[is_near], most[is_near] = -np.inf, np.inf
        return np.column_stack([least, most]).astype(np.float32)


def _projected(place: Doubles, view: View) -> Doubles:
    """Project points (N, 3) in camera axes to (N, 2) px; undefined behind the camera."""
    if not view.perspective:
        return np.asarray(place[:, :2] * view.focal + view.principal)
    depth = np.where(place[:, 2] > 0, place[:, 2], 1.0)[:, np.newaxis]
    return np.asarray(place[:, :2] / depth * view.focal + view.principal)
