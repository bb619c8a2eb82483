"""Checks for the authors of plugins: call one on an object of yours in a test.

    from resample.testing import check_filter

    def test_hann_is_a_pixel_filter():
        check_filter(Hann(width=2))

Each check raises an AssertionError that says what the plugin should do instead.
"""

import math

import numpy as np

from resample.filters import PixelFilter


def check_filter(pixel_filter: PixelFilter) -> None:
    """Make sure that an object can serve as a pixel filter.

    Parameters
    ----------
    pixel_filter
        An object, not its class.

    Raises
    ------
    AssertionError
        It is not callable; its radius is not a positive number; its weights do not come as one
        finite real number per distance, depend on the distance's neighbours in the array, change
        from call to call, overwrite the distances, or add up to 0 or less.
    """
    name = repr(pixel_filter)
    _require(callable(pixel_filter), f"{name} has no __call__(distance)")
    radius = getattr(pixel_filter, "radius", None)
    is_number = isinstance(radius, int | float | np.number) and not isinstance(radius, bool)
    _require(
        is_number and 0.0 < float(radius or 0.0) < math.inf,
        f"{name} has the radius {radius!r}; it must be a positive, finite number of pixels",
    )
    distance = np.linspace(0.0, float(pixel_filter.radius), 1025)
    weight = _weights(pixel_filter, distance)
    mass = 2.0 * np.trapezoid(weight, distance)
    _require(mass > 0.0, f"{name} integrates to {mass:.4g}; weights must add up to more than 0")
    again = _weights(pixel_filter, distance.reshape(5, 205)[::-1])
    _require(
        np.array_equal(again[::-1].ravel(), weight),
        f"{name} gives a distance different weights; they may depend on nothing else",
    )


def _weights(pixel_filter: PixelFilter, distance: np.ndarray) -> np.ndarray:
    """Weights of an array of distances, once their form has been checked."""
    name, given = repr(pixel_filter), distance.copy()
    weight = np.asarray(pixel_filter(distance))
    _require(np.array_equal(distance, given), f"{name} overwrites the distances that it is given")
    _require(
        weight.shape == distance.shape,
        f"{name} gives the shape {weight.shape} for distances of the shape {distance.shape}",
    )
    _require(
        np.issubdtype(weight.dtype, np.floating),
        f"{name} gives weights of type {weight.dtype}; they must be floating-point numbers",
    )
    _require(bool(np.isfinite(weight).all()), f"{name} gives weights that are not finite")
    return weight


def _require(condition: bool, message: str) -> None:
    if not condition:
        raise AssertionError(message)
