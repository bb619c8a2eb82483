"""Old name of `resample_meshes`, which another package has."""

from resample.lazy import moved

__getattr__ = moved("resample_meshes", "hybrid-resample-meshes")
