"""Coefficients of lenses, as OpenCV counts them, and the frame (height, width) that they bend."""

SHAPE = (80, 100)
COEFFICIENTS = {
    "barrel": [-0.3, 0.1, 1e-3, -2e-3],
    "pincushion": [0.25, 0.05, 0, 0, 0.01],
    "rational": [-0.28, 0.07, 2e-4, 1e-4, 0, 0.1, 0.02, 0.01],
    "prism": [-0.28, 0.07, 2e-4, 1e-4, 0, 0.1, 0.02, 0.01, 1e-2, 2e-3, -1e-2, 1e-3],
    "tilt": [-0.1, 0.01, 0, 0, 0, 0, 0, 0, 1e-3, 0, 1e-3, 0, 0.05, -0.03],
}
FOLDING = [-0.5, 0.0, 0.0, 0.0]  # r (1 − r² / 2) grows up to r² = 2 / 3 and then falls
