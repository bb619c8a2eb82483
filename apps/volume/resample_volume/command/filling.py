"""Cameras fitted so that everything visible fills the picture."""

from collections.abc import Sequence
from dataclasses import replace

from resample.cameras.viewpoints import Orbit, Viewpoint
from resample.resampler import Resampler
from resample_volume.data.spacings import in_unit, unit_of_space
from resample_volume.media.appearance import VolumeLayer
from resample_volume.rendering import Subject, shown_together
from resample_volume.voxels.fields import FieldVoxels
from resample_volume.voxels.framing import FramedVoxels, Placed, filling
from resample_volume.voxels.gathered import Gathered

MOST = 0.9  # of a picture, which is filled where no camera is asked for


def filled(
    viewpoint: Viewpoint,
    subject: Subject,
    media: Sequence[VolumeLayer],
    resampler: Resampler,
    size: tuple[int, int],
    part: float = 1.0,
) -> Orbit:
    """Fit the camera so that everything visible fills a part of the picture."""
    if not isinstance(viewpoint, Orbit):
        raise ValueError(
            "zoom-in needs a camera that orbits the volume, such as 30,20,1; leave it out for a "
            "camera at a fixed position"
        )
    shown: Placed | FramedVoxels
    if not isinstance(subject.voxels, FieldVoxels | Gathered | list):
        shown = subject.voxels
    else:
        unit = unit_of_space(media[0][0])
        placed = ((subject.placed(in_unit(volume, unit)), look) for volume, look in media)
        shown = shown_together(placed, subject.clip, resampler)
    viewpoint = replace(viewpoint, zoom=part * viewpoint.zoom)
    return filling(viewpoint, subject.sphere, shown, size, subject.mesh.corner)
