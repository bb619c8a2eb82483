"""Detect targets that equal the source, and return the source unchanged."""

import numpy as np

from resample_warp3d.types import Equation, Rendered, Source

STILL = 1e-9  # relative to the picture's size: smaller moves are ignored


def is_identity(source: Source, equation: Equation, shape: tuple[int, int]) -> bool:
    """Whether no sample moves: the target equals the source."""
    if equation.matrix[2, 2] == 0.0:
        return False
    matrix = equation.matrix / equation.matrix[2, 2]
    extent = np.array([source.nearness.shape[1], source.nearness.shape[0], 1.0])
    moved = np.abs(matrix - np.eye(3)) @ extent  # px, at most
    shift = np.abs(equation.epipole / equation.matrix[2, 2]).max() * source.nearness.max()
    return (
        source.place.size == 0
        and tuple(shape) == source.nearness.shape
        and float(max(moved.max(), shift)) < STILL * max(shape)
    )


def unmoved(source: Source) -> Rendered:
    """Return the source unchanged, bit by bit; samples without depth are empty."""
    known = source.nearness > 0
    coverage = known.astype(np.float32)
    image = np.where(known[..., None], source.color, np.float32(0))
    return Rendered(image, coverage, source.nearness.copy(), coverage.copy(), np.zeros_like(known))
