"""Small volumes in bricks, and pictures of them and of the same in memory."""

import numpy as np

from resample import Resampler
from resample.cameras.viewpoints import Orbit
from resample_volume.data.bricks import Bricks
from resample_volume.rendering import Subject
from resample_volume.types import Volume
from resample_volume.windows import paint_streamed, streamed_subject

SIZE = (120, 150)
EYE = Orbit(30, 20, 1.3)
LAYERS = ("rgba", "depth", "first_depth", "coverage")


def smoke(rng):
    values = rng.integers(0, 200, (37, 26, 31)).astype(np.uint8)
    return Volume(values, np.array([1.0, 0.8, 1.2]), np.array([5.0, 0, -9]), np.eye(3), "smoke")


def in_bricks(volume, side):
    values = volume.values

    def read(box):
        return np.ascontiguousarray(values[box])

    return volume._replace(values=Bricks(read, values.shape, values.dtype, side))


def in_windows(volume, look, viewpoint, size, spent, resampler=None):
    """Picture of a volume in bricks, and the number of its windows."""
    media = [(volume, look)]
    subject = streamed_subject(media)
    camera = subject.camera(viewpoint, *size)
    return paint_streamed(media, subject, camera, size, spent, resampler)


def whole_of(media, fit="volume", eye=EYE):
    """Picture of voxels of volumes in memory."""
    painter = Resampler()
    subject = Subject.of_several(media, painter, fit)
    camera = subject.camera(eye, *SIZE)
    by = {"height": SIZE[0], "width": SIZE[1], "clip": subject.clip}
    return painter(subject.samples_for(camera), camera, **by)


def assert_same(found, wanted):
    for name in LAYERS:
        assert getattr(found, name).tobytes() == getattr(wanted, name).tobytes(), name
