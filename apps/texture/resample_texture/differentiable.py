"""Old name of `resample_gradients`, which another package has."""

from resample.lazy import moved

__getattr__ = moved("resample_gradients", "hybrid-resample-gradients")
