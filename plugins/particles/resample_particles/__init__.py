"""Particles of simulations: snapshots, maps of column density, and films of maps.

The names below are imported on first use, so that `import resample_particles` is fast.
"""

from typing import TYPE_CHECKING

from resample.lazy import attributes, listing

if TYPE_CHECKING:
    from resample_particles.density import DensityMap, column_density
    from resample_particles.files import read_particles
    from resample_particles.particles import Particles

_HOMES = {
    "DensityMap": "density",
    "Particles": "particles",
    "column_density": "density",
    "read_particles": "files",
}

__all__ = ["DensityMap", "Particles", "column_density", "read_particles"]

__getattr__ = attributes(__name__, _HOMES)
__dir__ = listing(_HOMES)
