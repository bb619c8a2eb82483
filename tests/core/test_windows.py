"""Sizes of pictures, and windows that make up a picture."""

import numpy as np
import pytest

from resample import Camera, Resampler
from resample.outofcore.ellipsoids import WindowTask, split_windows
from resample.types import Samples

HEIGHT, WIDTH = 50, 70
PICTURE = {"height": HEIGHT, "width": WIDTH}
LAYERS = ("rgba", "depth", "first_depth", "coverage")
REACH = 24  # px around a window in which its samples are kept: filters and tiles


def cloud(count, near, seed=3):
    """Samples of a lattice of unit steps, some of them left out, from `near` on."""
    rng = np.random.default_rng(seed)
    place = rng.permutation(14**3)[:count]
    at = np.column_stack(np.unravel_index(place, (14, 14, 14))) - 6.5
    position = (at + np.array([0, 0, near + 7])).astype(np.float32)
    color = rng.uniform(0, 1, (count, 3)).astype(np.float32)
    return Samples(position, color, rng.uniform(0, 1, count).astype(np.float32), np.eye(3))


def camera():
    return Camera.from_fov(50, HEIGHT, WIDTH)


@pytest.mark.parametrize("size", [{"height": 0, "width": 5}, {"height": 5, "width": -1}])
@pytest.mark.parametrize("way", ["__call__", "footprints"])
def test_each_way_to_a_picture_refuses_a_size_that_is_none(way, size):
    with pytest.raises(ValueError, match="both sides must be at least 1"):
        getattr(Resampler(), way)(cloud(50, 20.0), camera(), **size)


def test_samples_with_a_scale_each_have_no_footprints():
    samples = cloud(50, 20.0)
    scaled = samples._replace(scale=np.ones(50))
    with pytest.raises(ValueError, match="no records of samples that have a scale each"):
        Resampler().footprints(scaled, camera(), **PICTURE)


NONE = np.zeros(0, np.int32)


def test_a_window_is_halved_along_its_longer_side_until_it_fits():
    def bounds(window):
        x0, y0, x1, y1 = window
        return WindowTask(window, NONE, NONE) if (x1 - x0) * (y1 - y0) <= 16 * 16 else None

    tasks = split_windows((32, 64), 8, bounds)
    assert sorted(task.window for task in tasks) == [
        (x, y, x + 16, y + 16) for x in range(0, 64, 16) for y in range(0, 32, 16)
    ]
