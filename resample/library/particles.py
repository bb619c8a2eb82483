"""Particles: spheres or ellipsoids with size and color, as samples for a `Resampler`."""

import numpy as np
from numpy.typing import ArrayLike

from resample.messages import doubles_of
from resample.painting.scenes.scene import check_samples
from resample.painting.shaped.ellipsoids import Ellipsoids, check_ellipsoids
from resample.profiles.reconstruction import GaussianKernel, Reconstruction, footprint_table
from resample.types import Doubles, Samples


def particles(
    position: ArrayLike,
    color: ArrayLike,
    opacity: ArrayLike,
    radius: ArrayLike,
    *,
    reconstruction: Reconstruction | None = None,
    rotation: ArrayLike | None = None,
) -> Samples | Ellipsoids:
    """Create spheres or ellipsoids for a `Resampler`; size, color and opacity may vary.

    Parameters
    ----------
    position
        (N, 3) scene units.
    color
        (3,) or (N, 3) linear light, straight.
    opacity
        Number or (N,), 0 to below 1: fraction of light lost along a ray through the center; of an
        ellipsoid, along one that is as long in it as in a sphere of its volume.
    radius
        Number or (N,), above 0, scene units: where a sphere ends; it fades from its center as the
        kernel does. Or (N, 3): half axes of ellipsoids, of which one or two may be 0.
    reconstruction
        Kernel of the resampler; None: a `GaussianKernel`.
    rotation
        (4,) or (N, 4) quaternions w, x, y, z from the ellipsoids' axes to the scene's, of any
        length; None: these axes are alike.

    Returns
    -------
    Samples; or, where radii are (N, 3) or rotations are given, `Ellipsoids`, which a `Resampler`
    composites one by one.

    Raises
    ------
    ValueError
        Arrays do not fit together or a number is out of range.

    Examples
    --------
    >>> from resample import Camera, Resampler, particles
    >>> balls = particles([[0, 0, 4], [0, 0, 6]], [[1, 0, 0], [0, 1, 0]], 0.8, [0.5, 1.0])
    >>> frame = Resampler()(balls, Camera.from_fov(60, 481, 641), height=481, width=641)
    >>> round(float(frame.rgba[240, 320, 3]), 2)  # through both centers: 1 - 0.2 * 0.2
    0.96
    """
    kernel = reconstruction or GaussianKernel()
    place = doubles_of("positions", position, "numbers (N, 3)")
    if place.ndim != 2 or place.shape[1] != 3:
        raise ValueError(f"positions are (N, 3), not {place.shape}")
    share = _per_particle("opacity", opacity, len(place))
    if rotation is not None or np.shape(radius) == (len(place), 3):
        return _ellipsoids(place, color, share, radius, rotation, kernel)
    if not ((share >= 0) & (share < 1)).all():
        raise ValueError("an opacity must be at least 0 and below 1")
    radii = _per_particle("radius", radius, len(place))
    if not (radii > 0).all():
        raise ValueError("a radius is a number of scene units above 0")
    colors = np.asarray(color, np.float32)
    colors = np.broadcast_to(colors, place.shape) if colors.shape == (3,) else colors
    usual = float(np.median(radii)) if radii.size else 1.0
    spacing = usual / kernel.radius
    peak = float(footprint_table(kernel).values[0]) / kernel.radius**3 * radii  # scene units
    with np.errstate(over="ignore", divide="ignore"):  # overflow is rejected below
        extinction = (-np.log1p(-share) / peak).astype(np.float32)
        scale = (radii / usual).astype(np.float32)
        position = place.astype(np.float32)
    return check_samples(Samples(position, colors, extinction, spacing * np.eye(3), scale))


def _ellipsoids(
    place: Doubles,
    color: ArrayLike,
    opacity: Doubles,
    radius: ArrayLike,
    rotation: ArrayLike | None,
    kernel: Reconstruction,
) -> Ellipsoids:
    """Ellipsoids with a shape each."""
    count, half = len(place), np.asarray(radius, np.float32)
    half = half[:, np.newaxis] if half.shape == (count,) else half
    turn = np.asarray((1.0, 0.0, 0.0, 0.0) if rotation is None else rotation, np.float32)
    parts = (half, (count, 3)), (turn, (count, 4)), (np.asarray(color, np.float32), (count, 3))
    try:
        axes, turns, colors = (np.broadcast_to(given, shape) for given, shape in parts)
    except ValueError:
        raise ValueError(
            f"radii {half.shape}, rotations {turn.shape} and colors {np.shape(color)} do not fit "
            f"{count} particles; they are (N, 3), (N, 4) and (N, 3)"
        ) from None
    places, shares = place.astype(np.float32), opacity.astype(np.float32)
    return check_ellipsoids(Ellipsoids(places, axes, turns, shares, colors, kernel))


def _per_particle(name: str, given: ArrayLike, count: int) -> Doubles:
    """One number for each of `count` particles."""
    numbers = np.asarray(given, np.float64)
    if numbers.shape not in ((), (count,)) or not np.isfinite(numbers).all():
        raise ValueError(f"{name} is one finite number or {count} of them, not {numbers.shape}")
    return np.broadcast_to(numbers, (count,))
