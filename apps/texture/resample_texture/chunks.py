"""Old name of `resample_chunks`, which another package has."""

from resample.lazy import moved

__getattr__ = moved("resample_chunks", "hybrid-resample-chunks")
