"""Checks for the authors of plugins: call one on an object of yours in a test.

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
from resample.profiles.orders import CompositingOrder, Summing
from resample.profiles.reconstruction import Reconstruction, ripple
from resample.types import FOOTPRINT, Seen, Sheets, View

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
        It is not callable; its radius is not a positive number; its weights do not come as one
        finite real number per distance, depend on the distance's neighbours in the array, change
        from call to call, overwrite the distances, or add up to 0 or less.
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
    Smallest and largest relative error of a constant field, such as (-0.004, 0.008): its ripple.

    Raises
    ------
    AssertionError
        It is not callable; its radius is not a positive number; its densities do not come as one
        finite real number per distance, depend on the distance's neighbours in the array, change
        from call to call, overwrite the distances, are not 0 from the radius on, or add up to 0 or
        less in space; or a constant field ripples by 10 % or more.
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
        It is not callable; its radius is not a positive number or too large; its weights do not
        come as one finite real number per distance, depend on the distance's neighbours in the
        array, change from call to call or add up to 0; or it cannot pass through samples.
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
        It is not callable; its thickness is not a positive number; it does not give `Sheets` of one
        float32 key and one int32 sheet per footprint, gives keys that are not finite, fails where
        there is no footprint, overwrites the footprints, changes from call to call, or treats a
        footprint differently where others come before it.
    """
    name = repr(order)
    _require(callable(order), f"{name} has no __call__(seen)")
    thickness = _positive(order, "thickness", "voxels")
    _require(
        getattr(order, "summing", None) in list(Summing),
        f"{name} has the summing {getattr(order, 'summing', None)!r}; give one of {list(Summing)}",
    )
    rng = np.random.default_rng(7)
    footprints = np.zeros(257, FOOTPRINT)
    for field in ("x", "y", "extinction", "spacing"):
        footprints[field] = rng.uniform(0, 100, footprints.size)
    footprints["depth"] = rng.uniform(-5, 50, footprints.size)
    footprints["depth"][:9] = 20.0  # as lattices seen along an axis have them
    footprints["obliquity"] = rng.uniform(1, 2, footprints.size)
    position = rng.uniform(-9, 9, (footprints.size, 3)).astype(np.float32)
    view = View(np.eye(3), np.array([0.5, 0.0, 20.0]), np.ones(2), np.zeros(2), 0.0, True)
    seen = Seen(footprints, position, np.diag([1.0, 1.0, 1.5]), view, thickness)
    _sheets(order, seen._replace(footprints=footprints[:0], position=position[:0]))
    sheets = _sheets(order, seen)
    turn = rng.permutation(footprints.size)
    mixed = _sheets(order, seen._replace(footprints=footprints[turn], position=position[turn]))
    _require(
        np.array_equal(mixed.key, sheets.key[turn])
        and np.array_equal(mixed.sheet, sheets.sheet[turn]),
        f"{name} depends on the order in which footprints are given; it must not",
    )


def _sheets(order: CompositingOrder, seen: Seen) -> Sheets:
    """Order of samples, once its form has been checked."""
    name, footprints = repr(order), seen.footprints
    given, place = footprints.copy(), seen.position.copy()
    sheets = order(seen)
    _require(np.array_equal(footprints, given), f"{name} overwrites the footprints")
    _require(np.array_equal(seen.position, place), f"{name} overwrites the positions")
    _require(isinstance(sheets, Sheets), f"{name} gives {type(sheets).__name__}, not Sheets")
    for field, kind in (("key", np.float32), ("sheet", np.int32)):
        array = np.asarray(getattr(sheets, field))
        _require(
            array.shape == (footprints.size,) and array.dtype == kind,
            f"{name} gives {field} as {array.dtype} {array.shape} for {footprints.size} "
            f"footprints; it must be {np.dtype(kind)} ({footprints.size},)",
        )
    _require(bool(np.isfinite(sheets.key).all()), f"{name} gives keys that are not finite")
    return sheets


def _positive(plugin: Any, field: str, unit: str) -> float:
    """A plugin's number, once it is known to be one."""
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
    """Values of an array of distances, once their form has been checked."""
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
