"""Old home of `resample_particles.viewing`, which another package has."""

from resample.lazy import moved

__getattr__ = moved("resample_particles.viewing", "hybrid-resample-particles")
