"""Old name of `resample_sky`, which another package has."""

from resample.lazy import moved

__getattr__ = moved("resample_sky", "hybrid-resample-sky")
