"""Dense volumes in bricks, painted window by window, have the bits of volumes in memory."""

import numpy as np
import pytest

from resample import Resampler
from resample.cameras.viewpoints import Orbit
from resample_volume.rendering import Appearance, Subject
from resample_volume.types import Volume
from resample_volume.voxels.bricks import Bricks
from resample_volume.voxels.shading import Light
from resample_volume.windows import Spent, render_in_windows

SIZE = (120, 150)
EYE = Orbit(30, 20, 1.3)


def smoke(rng):
    values = rng.integers(0, 200, (37, 26, 31)).astype(np.uint8)
    return Volume(values, np.array([1.0, 0.8, 1.2]), np.array([5.0, 0, -9]), np.eye(3), "smoke")


def in_bricks(volume, side):
    values = volume.values

    def read(box):
        return np.ascontiguousarray(values[box])

    return volume._replace(values=Bricks(read, values.shape, values.dtype, side))


@pytest.mark.parametrize("side", [(8, 8, 8), (5, 7, 9)])
@pytest.mark.parametrize("look", [Appearance("60..190"), Appearance("60..190", light=None)])
@pytest.mark.parametrize("memory", [700_000, 1 << 30])
def test_windows_have_the_bits_of_a_volume_in_memory(side, look, memory, rng):
    volume = smoke(rng)
    subject = Subject.of(volume, look, around=volume)
    camera = subject.camera(EYE, *SIZE)
    whole = Resampler()(subject.seen_by(camera), camera, height=SIZE[0], width=SIZE[1])
    found, windows = render_in_windows(in_bricks(volume, side), look, EYE, SIZE, Spent(memory))
    assert (windows > 1) == (memory < 1 << 30)
    for name in ("rgba", "depth", "first_depth", "coverage"):
        assert getattr(found, name).tobytes() == getattr(whole, name).tobytes(), name


def test_what_needs_all_voxels_or_too_much_memory_is_refused(rng):
    volume = in_bricks(smoke(rng), (16, 16, 16))
    for look in (Appearance("60..190", clip=("1/0/0",)), Appearance(light=Light(occlusion=True))):
        with pytest.raises(ValueError, match="window by window; leave it out"):
            render_in_windows(volume, look, EYE, SIZE, Spent(1 << 30))
    with pytest.raises(ValueError, match="fit in the memory that is allowed"):
        render_in_windows(volume, Appearance("60..190"), EYE, SIZE, Spent(1000))
