"""Old name of `resample_meshes.rendering`, which another package has."""

from resample.lazy import moved

__getattr__ = moved("resample_meshes.rendering", "hybrid-resample-meshes")
