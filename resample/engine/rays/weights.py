"""Weights of a cubic B-spline's coefficients, as polynomials."""

# Weights of the four coefficients along an axis: rows are powers of the fraction between the second
# and the third, from its power 0 on.
WEIGHTS = (
    (1 / 6, 2 / 3, 1 / 6, 0.0),
    (-1 / 2, 0.0, 1 / 2, 0.0),
    (1 / 2, -1.0, 1 / 2, 0.0),
    (-1 / 6, 1 / 2, -1 / 2, 1 / 6),
)
# Derivatives of the weights, likewise.
SLOPES = tuple(tuple(n * one for one in row) for n, row in enumerate(WEIGHTS) if n > 0)
# Weights at the second sample of four, and at the third.
SAMPLES = (WEIGHTS[0], tuple(sum(column) for column in zip(*WEIGHTS, strict=True)))
