"""Cameras fitted so that everything visible fills the picture."""

from collections.abc import Sequence

from resample.cameras.viewpoints import Orbit, Viewpoint
from resample.console import say
from resample.resampler import Resampler
from resample_volume.data.spacings import in_unit, unit_of_space
from resample_volume.media.appearance import VolumeLayer
from resample_volume.rendering import Subject, shown_together
from resample_volume.voxels.fields import FieldVoxels
from resample_volume.voxels.framing import FramedVoxels, Placed, filling
from resample_volume.voxels.gathered import Gathered


def filled(
    viewpoint: Viewpoint,
    subject: Subject,
    media: Sequence[VolumeLayer],
    resampler: Resampler,
    size: tuple[int, int],
) -> Viewpoint:
    """Fit the camera to everything visible, and print it."""
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
    found = filling(viewpoint, subject.sphere, shown, size, subject.mesh.corner)
    if found is viewpoint:
        return viewpoint
    turned = (found.azimuth, found.elevation, found.zoom, *found.pan)
    say(f"the camera {'/'.join(f'{number:.8g}' for number in turned)} fills the picture")
    return found
