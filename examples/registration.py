"""Register two pictures by gradient descent on their difference.

Both show one scene under different homographies, with noise. The matrix that maps one to the other
is found from coarse to fine. `python examples/registration.py picture.png`
"""

import sys
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.optimize import minimize

from resample.files.saving import write_png
from resample_gradients import LinearWarp, MatrixPlaces
from resample_texture import warp

HEIGHT, WIDTH = 90, 120  # px
FIRST = np.array([[0.58, -0.07, 1.0], [0.05, 0.6, -8.0], [1e-4, -2e-4, 1.0]])  # scene to picture
SECOND = np.array([[0.55, 0.03, -9.0], [-0.06, 0.56, 6.0], [-2e-4, 1e-4, 1.0]])
# Scaled parameters: a step of 0.01 moves pixels far from the center by about 1 px.
UNITS = np.array([[100.0, 0.0, WIDTH / 2], [0.0, 100.0, HEIGHT / 2], [0.0, 0.0, 1.0]])
LEVELS = (4, 2, 1)  # px of the picture per compared px


def pictures():
    """Two noisy pictures of blots, with values of about 0 to 1."""
    rng = np.random.default_rng(4)
    scene = sum(
        size * gaussian_filter(rng.standard_normal((180, 240)), size) for size in (1, 3, 8, 20)
    )
    scene = np.clip(0.5 + 0.25 * scene / scene.std(), 0, 1)
    taken = [
        warp(scene, matrix, (HEIGHT, WIDTH), edge="mirror").image for matrix in (FIRST, SECOND)
    ]
    return [image + 0.01 * rng.standard_normal(image.shape) for image in taken]


def matrix_of(numbers):
    """Homography from eight parameters; all 0 is the identity."""
    change = np.append(numbers, 0.0).reshape(3, 3)
    return UNITS @ (np.eye(3) + change) @ np.linalg.inv(UNITS)


def difference(numbers, moving, fixed, level):
    """Mean squared difference where both pictures are defined, and its gradient by the parameters.

    They are compared at pixels `level` times as large, which average what they cover.
    """
    look = LinearWarp("area-spline:limit=none")
    smaller = np.diag([1 / level, 1 / level, 1.0])
    shape = HEIGHT // level, WIDTH // level
    target = look(fixed, MatrixPlaces(smaller, shape, fixed.shape))
    places = MatrixPlaces(smaller @ matrix_of(numbers), shape, moving.shape)
    both = np.stack([moving, np.ones_like(moving)], axis=2)  # warping ones gives the coverage
    seen, coverage = np.moveaxis(look(both, places), 2, 0)
    error, weight = seen - coverage * target, np.sum(coverage**2)
    loss = np.sum(error**2) / weight
    by_coverage = -error * target - loss * coverage
    by_picture = 2 / weight * np.stack([error, by_coverage], axis=2)
    by_matrix = smaller.T @ look.by_places(by_picture, both, places)
    by_change = UNITS.T @ by_matrix @ np.linalg.inv(UNITS).T
    return loss, by_change.ravel()[:8]


def registered(moving, fixed):
    """Homography that registers one picture to another."""
    numbers = np.zeros(8)
    for level in LEVELS:
        found = minimize(difference, numbers, (moving, fixed, level), "L-BFGS-B", jac=True)
        numbers = found.x
    return matrix_of(numbers)


def main(path: Path) -> None:
    """Write both pictures and, below them, their difference before and after."""
    moving, fixed = pictures()
    there = warp(moving, registered(moving, fixed), (HEIGHT, WIDTH))
    before, after = moving - fixed, np.nan_to_num(there.image - fixed)
    halves = [np.hstack([moving, fixed]), 0.5 + np.hstack([before, after])]
    gray = np.clip(np.vstack(halves), 0, 1).astype(np.float32) ** 2.2
    write_png(path, np.stack([gray, gray, gray, np.ones_like(gray)], axis=-1))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
