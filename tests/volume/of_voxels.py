"""Looks of voxels, which are painted whatever the default is."""

from functools import partial

from resample_volume.appearance import Appearance, Classification

of_voxels = partial(Appearance, classification=Classification.PRE)
