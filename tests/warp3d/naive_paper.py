"""The obvious slow way to warp by splats, in float64, one sample and one pixel at a time.

Planes are followed by their homography and back by its inverse; its derivative is a difference.
"""

from itertools import product

import numpy as np

from resample_warp3d.types import DOWN, LEFT, RIGHT, UP

STEP = 1e-5  # px, of differences


def warped(source, equation, shape, brush):
    """Image (h, w, C), coverage, nearness, magnification and bridged pixels (h, w)."""
    samples = [seen for seen in each_sample(source, equation, brush) if seen is not None]
    picture = np.zeros((*shape, source.color.shape[2]))
    coverage, nearness, area = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    bridged = np.zeros(shape, bool)
    for row, column in product(range(shape[0]), range(shape[1])):
        pixel = np.array([column + 0.5, row + 0.5])
        close = [s for s in samples if s.is_close(pixel)]
        covering = [(s.nearness_at(pixel), s.area) for s in close if s.covers(pixel)]
        front = max(covering) if covering else None
        keep = (1.0 - brush.tolerance) * front[0] if front else 0.0
        given = [
            (s.weight(pixel), s.nearness_at(pixel), s.area, s.color)
            for s in close
            if s.weight(pixel) > 0 and s.nearness_at(pixel) >= keep
        ]
        if not given:
            continue
        total = sum(weight for weight, *_ in given)
        picture[row, column] = sum(weight * color for weight, _, _, color in given) / total
        nearest = front or max((near, size) for _, near, size, _ in given)
        coverage[row, column], bridged[row, column] = 1.0, front is None
        nearness[row, column], area[row, column] = nearest
    return picture, coverage, nearness, area, bridged


def each_sample(source, equation, brush):
    """Samples as the target sees them, or None."""
    height, width = source.nearness.shape
    for row, column in product(range(height), range(width)):
        yield sample_at(source, equation, brush, row, column)


def sample_at(source, equation, brush, row, column):
    """One sample in the target; None if it is unknown, behind the eye or seen from the back."""
    w = float(source.nearness[row, column])
    if w <= 0:
        return None
    place = np.array([column + 0.5, row + 0.5])
    plane = np.array([*map(float, source.slope[row, column]), 0.0])
    plane[2] = w - plane[:2] @ place
    homography = equation.matrix + np.outer(equation.epipole, plane)
    depth = homography[2] @ [*place, 1.0]
    if depth <= 0 or np.linalg.det(homography) * np.linalg.det(equation.matrix) <= 0:
        return None
    drawn = source.links[row, column], brush
    return Sample(homography, plane, place, source.color[row, column], drawn)


class Sample:
    """A sample in the target."""

    def __init__(self, homography, plane, place, color, drawn):
        self.plane, self.color = plane, color.astype(float)
        self.links, self.brush = drawn
        self.inverse = np.linalg.inv(homography)
        self.center = followed(homography, place)
        ends = [followed(homography, place + step) for step in STEP * np.eye(2)]
        starts = [followed(homography, place - step) for step in STEP * np.eye(2)]
        self.jacobian = (np.array(ends) - np.array(starts)).T / (2.0 * STEP)
        self.area = abs(np.linalg.det(self.jacobian))
        self.back = np.linalg.inv(self.jacobian)
        turned, stretch, _ = np.linalg.svd(self.jacobian)
        self.stretch = np.clip(stretch, self.brush.least, self.brush.most)
        self.turned = turned.T
        self.reach = self.brush.radius * max(self.stretch[0], stretch[0])

    def is_close(self, pixel):
        """Whether the sample may reach a pixel."""
        return np.abs(pixel - self.center).max() <= self.reach

    def nearness_at(self, pixel):
        """Nearness of the sample's plane in the target."""
        x = self.inverse @ [*pixel, 1.0]
        return self.plane @ x

    def covers(self, pixel):
        """Whether the sample's cell holds a pixel's center."""
        u, v = self.back @ (pixel - self.center)
        core, edge = self.brush.core, min(0.5, self.brush.core)
        sides = (-u, LEFT), (u, RIGHT), (-v, UP), (v, DOWN)
        return all(way <= (core if self.links & bit else edge) for way, bit in sides)

    def weight(self, pixel):
        """Gaussian of a pixel's distance, in the ellipse whose axes are limited."""
        square = np.sum(((self.turned @ (pixel - self.center)) / self.stretch) ** 2)
        if square > self.brush.radius**2:
            return 0.0
        return np.exp(-0.5 * square / self.brush.sigma**2)


def followed(homography, place):
    """Where a homography takes a point."""
    x = homography @ [*place, 1.0]
    return x[:2] / x[2]
