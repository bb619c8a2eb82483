"""Old name of `resample_gradients.torch`, which another package has."""

from resample.lazy import moved

__getattr__ = moved("resample_gradients.torch", "hybrid-resample-gradients")
