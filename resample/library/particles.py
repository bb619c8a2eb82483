"""Particles: spheres that take light, of one radius with colors or of a radius each.

What rays from an eye pass through a sphere looks the same if sphere and way are scaled about the
eye. So spheres of a radius each are spheres of radius 1 at other distances, which share one
ellipsoid as all samples do. What is nearer than what else is lost on the way: it does not matter to
how much light comes through, which is a product, and it does to colors.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from resample.cameras.models import Camera
from resample.painting.scene import check_samples
from resample.profiles.reconstruction import GaussianKernel, Reconstruction, footprint_table
from resample.resampler import Resampler
from resample.types import Doubles, Floats, Samples


def particles(
    position: ArrayLike,
    color: ArrayLike,
    opacity: ArrayLike,
    radius: float,
    *,
    reconstruction: Reconstruction | None = None,
) -> Samples:
    """Spheres of one radius for a `Resampler`.

    Parameters
    ----------
    position
        (N, 3) scene units.
    color
        (3,) or (N, 3) linear light, straight.
    opacity
        Number or (N,), 0 to below 1: what a ray through the center loses.
    radius
        At which a sphere ends, scene units; it thins out from its center as the kernel does.
    reconstruction
        The resampler's kernel; None: a `GaussianKernel`.

    Raises
    ------
    ValueError
        Arrays do not fit together or a number is out of range.
    """
    kernel = reconstruction or GaussianKernel()
    place = np.asarray(position, np.float64)
    count = len(place) if place.ndim else 0
    share = _per_particle("opacity", opacity, count)
    if not ((share >= 0) & (share < 1)).all():
        raise ValueError("an opacity lies between 0 and below 1")
    if np.ndim(radius) or not 0 < radius < np.inf:
        raise ValueError(f"spheres that have colors share one radius above 0, not {radius}")
    colors = np.asarray(color, np.float32)
    colors = np.broadcast_to(colors, (count, 3)) if colors.shape == (3,) else colors
    spacing = radius / kernel.radius
    peak = float(footprint_table(kernel).values[0]) * spacing / kernel.radius**2  # scene units
    extinction = -np.log1p(-share) / peak
    return check_samples(Samples(place, colors, extinction, spacing * np.eye(3)))  # type: ignore[arg-type]


def absorbed(
    position: ArrayLike,
    opacity: ArrayLike,
    radius: ArrayLike,
    camera: Camera,
    *,
    size: tuple[int, int],
    resampler: Resampler | None = None,
    threads: int | None = None,
) -> Floats:
    """Share of the light that spheres of a radius each take, (height, width), 0 to 1.

    Parameters
    ----------
    position, opacity
        As `particles` takes them.
    radius
        Number or (N,), scene units, above 0.
    camera
        In perspective, its near plane at 0.
    size
        Height and width, px.
    resampler
        Choices; None: points and splats, each where it is better.
    threads
        At most this many; the result depends neither on them nor on the order of particles.

    Raises
    ------
    ValueError
        Arrays do not fit together, a number is out of range, or the camera is another.
    """
    if not isinstance(camera, Camera) or camera.near:
        raise ValueError("a radius each needs a camera in perspective with its near plane at 0")
    place = np.asarray(position, np.float64)
    if place.ndim != 2 or place.shape[1] != 3:
        raise ValueError(f"positions are (N, 3), not {place.shape}")
    radii = _per_particle("radius", radius, len(place))
    if not (radii > 0).all():
        raise ValueError("a radius is a number of scene units above 0")
    pose = camera.world_to_camera
    in_radii = (place @ pose[:3, :3].T + pose[:3, 3]) / radii[:, None]
    chosen = resampler or Resampler()
    white = np.ones(3, np.float32)
    spheres = particles(in_radii, white, opacity, 1.0, reconstruction=chosen.reconstruction)
    from_eye = replace(camera, world_to_camera=np.eye(4))
    height, width = size
    return chosen(spheres, from_eye, height=height, width=width, threads=threads).rgba[..., 3]


def _per_particle(name: str, given: ArrayLike, count: int) -> Doubles:
    """A number for each of `count` particles."""
    numbers = np.asarray(given, np.float64)
    if numbers.shape not in ((), (count,)) or not np.isfinite(numbers).all():
        raise ValueError(f"{name} is one finite number or {count} of them, not {numbers.shape}")
    return np.broadcast_to(numbers, (count,))
