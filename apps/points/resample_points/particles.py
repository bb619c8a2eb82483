"""Old home of the names of `resample_particles`, which another package has."""

from resample.lazy import moved

__getattr__ = moved("resample_particles", "hybrid-resample-particles")
