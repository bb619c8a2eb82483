"""Cameras fitted so that everything visible fills the picture."""

from resample.cameras.viewpoints import Orbit, Viewpoint
from resample_volume.rendering import Subject
from resample_volume.voxels.framing import filling

AROUND = 0.04  # of what is visible, left free where no camera is asked for


def filled(
    viewpoint: Viewpoint,
    subject: Subject,
    size: tuple[int, int],
    around: float = 0.0,
) -> Orbit:
    """Fit the camera so that everything visible fills the picture; `around`: as of `filling`."""
    if not isinstance(viewpoint, Orbit):
        raise ValueError(
            "zoom-in needs a camera that orbits the volume, such as 30,20,1; leave it out for a "
            "camera at a fixed position"
        )
    if subject.seen is None:
        return viewpoint
    found = filling(viewpoint, subject.sphere, subject.seen(), size, subject.mesh.corner, around)
    is_smaller = around > 0 and found.zoom < viewpoint.zoom  # of a ball all is seen at zoom 1
    return viewpoint if is_smaller else found
