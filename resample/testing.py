"""Checks for authors of plugins: call one on your object in a test.

    from resample.testing import check_filter

    def test_hann_is_a_pixel_filter():
        check_filter(Hann(width=2))

Each check raises an AssertionError that says what the plugin should do instead.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.profiles.filters import PixelFilter
from resample.profiles.interpolation import LARGEST_RADIUS, Interpolation, prefilter, taps
from resample.profiles.orders import CompositingOrder, Summing, of_depth
from resample.profiles.reconstruction import Reconstruction, ripple
from resample.types import Layers, View

LARGEST_RIPPLE = 0.1  # of a constant field; a plainly visible lattice


def check_filter(pixel_filter: PixelFilter) -> None:
    """Make sure that an object can serve as a pixel filter.

    Parameters
    ----------
    pixel_filter
        An object, not its class.

    Raises
    ------
    AssertionError
        It is not callable; its radius is not a positive number; its weights are not one finite
        real number per distance, depend on other distances in the array, differ between calls, or
        add up to 0 or less; or it overwrites the distances.
    """
    name = repr(pixel_filter)
    _require(callable(pixel_filter), f"{name} has no __call__(distance)")
    distance = np.linspace(0.0, _positive(pixel_filter, "radius", "pixels"), 1025)
    weight = _numbers(pixel_filter, distance, "weights")
    mass = 2.0 * np.trapezoid(weight, distance)
    _require(mass > 0.0, f"{name} integrates to {mass:.4g}; weights must add up to more than 0")
    _check_independence(pixel_filter, distance, weight, "weights")


def check_reconstruction(reconstruction: Reconstruction) -> tuple[float, float]:
    """Make sure that an object can serve as a reconstruction kernel.

    Parameters
    ----------
    reconstruction
        An object, not its class.

    Returns
    -------
    Smallest and largest relative error of a constant field (the ripple), such as (-0.004, 0.008).

    Raises
    ------
    AssertionError
        It is not callable; its radius is not a positive number; its densities are not one finite
        real number per distance, depend on other distances in the array, differ between calls,
        are not 0 from the radius on, or integrate to 0 or less; it overwrites the distances; or a
        constant field ripples by 10 % or more.
    """
    name = repr(reconstruction)
    _require(callable(reconstruction), f"{name} has no __call__(distance)")
    radius = _positive(reconstruction, "radius", "voxels")
    distance = np.linspace(0.0, radius, 1025)
    density = _numbers(reconstruction, distance, "densities")
    _check_independence(reconstruction, distance, density, "densities")
    beyond = _numbers(reconstruction, np.linspace(radius, 3 * radius, 65), "densities")
    _require(
        not beyond.any(),
        f"{name} is {np.abs(beyond).max():.4g} beyond its radius of {radius:g} voxels; "
        "it must be 0 from there on",
    )
    mass = float(4 * np.pi * np.trapezoid(density * distance**2, distance))
    _require(mass > 0.0, f"{name} integrates to {mass:.4g}; densities must add up to more than 0")
    low, high = ripple(reconstruction)
    _require(
        max(-low, high) < LARGEST_RIPPLE,
        f"{name} gives a constant field a ripple of {100 * low:+.1f} to {100 * high:+.1f} %; less "
        f"than {100 * LARGEST_RIPPLE:g} % are needed, so make it wider or smoother",
    )
    return low, high


def check_interpolation(interpolation: Interpolation) -> None:
    """Make sure that an object can serve as an interpolation.

    Parameters
    ----------
    interpolation
        An object, not its class.

    Raises
    ------
    AssertionError
        It is not callable; its radius is not a positive number or too large; its weights are not
        one finite real number per distance, depend on other distances in the array, differ between
        calls or add up to 0; or it cannot interpolate samples.
    """
    name = repr(interpolation)
    _require(callable(interpolation), f"{name} has no __call__(distance)")
    radius = _positive(interpolation, "radius", "samples")
    _require(radius <= LARGEST_RADIUS, f"{name} reaches {radius} samples, not {LARGEST_RADIUS}")
    distance = np.linspace(0.0, radius, 1025)
    weight = _numbers(interpolation, distance, "weights")
    _check_independence(interpolation, distance, weight, "weights")
    weights = taps(interpolation, np.linspace(-0.5, 0.5, 65))
    _require(bool(np.isfinite(weights).all()), f"{name} has places where all weights add up to 0")
    try:
        prefilter(interpolation)
    except ValueError as error:
        raise AssertionError(str(error)) from None


def check_order(order: CompositingOrder) -> None:
    """Make sure that an object can serve as a compositing order.

    Parameters
    ----------
    order
        An object, not its class.

    Raises
    ------
    AssertionError
        It is not callable; its thickness is not a positive number; it does not return `Layers` of
        finite numbers along an axis or around the eye; it differs between calls or overwrites its
        input; or it sums slabs of uneven depth.
    """
    name = repr(order)
    _require(callable(order), f"{name} has no __call__(view, lattice)")
    _positive(order, "thickness", "voxels")
    summing = getattr(order, "summing", None)
    _require(
        summing in list(Summing), f"{name} has the summing {summing!r}; give one of {list(Summing)}"
    )
    cosine, sine = math.cos(0.3), math.sin(0.3)
    turn = np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])
    for perspective in (True, False):
        view = View(turn, np.array([0.5, 0.0, 20.0]), np.ones(2), np.zeros(2), 0.0, perspective)
        for lattice in (np.diag([1.0, 1.0, 1.5]), np.diag([0.2, -0.1, 0.1]) @ turn):
            layers = _layers(order, view, lattice)
            depth = of_depth(view, layers.thickness)
            _require(
                summing is not Summing.SLABS or layers == depth,
                f"{name} sums slabs, which needs layers of even depth; it returns {layers}",
            )


def _layers(order: CompositingOrder, view: View, lattice: NDArray[Any]) -> Layers:
    """Layers of an order, after checking their form."""
    name, given = repr(order), lattice.copy()
    turn, shift = view.rotation.copy(), view.translation.copy()
    layers = order(view, lattice)
    _require(np.array_equal(lattice, given), f"{name} overwrites the lattice")
    _require(
        np.array_equal(view.rotation, turn) and np.array_equal(view.translation, shift),
        f"{name} overwrites the view",
    )
    _require(isinstance(layers, Layers), f"{name} gives {type(layers).__name__}, not Layers")
    _require(np.shape(layers.axis) == (3,), f"{name} gives the axis {layers.axis}; it is (x, y, z)")
    numbers = (*layers.axis, layers.offset, layers.thickness)
    _require(
        all(isinstance(number, float | np.floating) for number in (*numbers, layers.eye)),
        f"{name} gives {layers}; its numbers must be floating-point numbers",
    )
    _require(bool(np.isfinite(numbers).all()), f"{name} gives {layers}, which is not finite")
    _require(layers.eye < np.inf, f"{name} gives the eye's place {layers.eye}")
    _require(layers.thickness > 0.0, f"{name} gives layers of the thickness {layers.thickness}")
    _require(
        layers.is_around or any(layers.axis), f"{name} gives an axis of zero length, and no shells"
    )
    _require(order(view, lattice) == layers, f"{name} gives other layers when it is called again")
    return layers


def _positive(plugin: Any, field: str, unit: str) -> float:
    """A plugin's parameter, checked to be a positive number."""
    given = getattr(plugin, field, None)
    is_number = isinstance(given, int | float | np.number) and not isinstance(given, bool)
    number = float(given) if is_number else math.nan  # type: ignore[arg-type]
    _require(
        0.0 < number < math.inf,
        f"{plugin!r} has the {field} {given!r}; it must be a positive, finite number of {unit}",
    )
    return number


def _check_independence(
    plugin: Any, distance: NDArray[Any], value: NDArray[Any], what: str
) -> None:
    again = _numbers(plugin, distance.reshape(5, 205)[::-1], what)
    _require(
        np.array_equal(again[::-1].ravel(), value),
        f"{plugin!r} gives a distance different {what}; they may depend on nothing else",
    )


def _numbers(plugin: Any, distance: NDArray[Any], what: str) -> NDArray[Any]:
    """Values for an array of distances, after checking their form."""
    name, given = repr(plugin), distance.copy()
    value = np.asarray(plugin(distance))
    _require(np.array_equal(distance, given), f"{name} overwrites the distances that it is given")
    _require(
        value.shape == distance.shape,
        f"{name} gives the shape {value.shape} for distances of the shape {distance.shape}",
    )
    _require(
        np.issubdtype(value.dtype, np.floating),
        f"{name} gives {what} of type {value.dtype}; they must be floating-point numbers",
    )
    _require(bool(np.isfinite(value).all()), f"{name} gives {what} that are not finite")
    return value


def _require(condition: bool, message: str) -> None:
    if not condition:
        raise AssertionError(message)
