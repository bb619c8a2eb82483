"""Cameras fitted so that everything visible fills the picture."""

from resample.cameras.viewpoints import Orbit, Viewpoint
from resample.console import say
from resample.resampler import Resampler
from resample_volume.media.appearance import VolumeLayer, named_or_own
from resample_volume.rendering import Subject
from resample_volume.voxels.fields import FieldVoxels
from resample_volume.voxels.framing import Placed, filling, shown_by
from resample_volume.voxels.gathered import Gathered


def filled(
    viewpoint: Viewpoint,
    subject: Subject,
    medium: VolumeLayer,
    resampler: Resampler,
    size: tuple[int, int],
) -> Viewpoint:
    """Fit the camera to everything visible, and print it."""
    if not isinstance(viewpoint, Orbit):
        raise ValueError(
            "zoom-in needs a camera that orbits the volume, such as 30,20,1; leave it out for a "
            "camera at a fixed position"
        )
    volume, look = medium
    shown: Placed
    if not isinstance(subject.voxels, FieldVoxels | Gathered):
        shown = subject.voxels
    else:
        framing = named_or_own(look.framing or look.transfer, volume)
        radius = resampler.reconstruction.radius
        shown = shown_by(subject.placed(volume), framing, subject.clip, radius, resampler.iso)
    corner = subject.mesh.corner
    if not len(shown.position) and not len(corner):
        return viewpoint
    found = filling(viewpoint, subject.sphere, shown, size, corner)
    turned = (found.azimuth, found.elevation, found.zoom, *found.pan)
    say(f"the camera {'/'.join(f'{number:.8g}' for number in turned)} fills the picture")
    return found
