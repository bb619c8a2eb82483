"""Volumes of one slice, row or voxel, at the ends of the spacings that are allowed."""

import numpy as np
import pytest

from resample.painting.choices import Primitive
from resample.profiles.orders import Rays
from resample.resampler import Resampler
from resample_comparisons.volume.painting import ImageSheets
from resample_volume import Appearance, Volume, render

SIZE = (24, 20)
MODES = {
    "hybrid": (Resampler(), "pre"),
    "points": (Resampler(primitive=Primitive.POINTS), "pre"),
    "paper": (Resampler(primitive=Primitive.PAPER), "pre"),
    "sheets": (Resampler(order=ImageSheets()), "pre"),
    "rays": (Resampler(order=Rays()), "post"),
}


def picture(values, spacing, mode="hybrid", zoom=1.0, transfer="auto"):
    painter, classification = MODES[mode]
    volume = Volume(values, np.full(3, spacing), np.zeros(3), np.eye(3), "few")
    look = Appearance(transfer, classification=classification)
    return render(volume, look, (30, 20, zoom), size=SIZE, resampler=painter).rgba


def noise(shape, dtype=np.uint8):
    return (np.random.default_rng(0).random(shape) * 255).astype(dtype)


@pytest.mark.some(2)
@pytest.mark.parametrize("mode", MODES)
def test_a_slice_has_the_bits_of_any_other_unit(mode):
    values = noise((1, 7, 8))
    wanted = picture(values, 1.0, mode)
    assert wanted[..., 3].max() > 0
    for power in (-39, -34, 33, 36):  # 2e-12, where forms of splats left float32, to 7e10
        assert np.array_equal(picture(values, 2.0**power, mode), wanted)


@pytest.mark.some(3)
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 1, 5), (1, 5, 1), (5, 1, 1)])
def test_a_voxel_and_a_row_are_seen_at_both_ends_of_spacings(shape, mode):
    values = noise(shape)
    for zoom in (1.0, 0.05, 50.0):
        pictures = [picture(values, spacing, mode, zoom) for spacing in (1.1e-12, 1e10)]
        assert all(np.isfinite(one).all() for one in pictures)


@pytest.mark.parametrize("value", [1e30, 1e-45, 0.0])
def test_a_field_of_one_value_is_classified(value):
    painter = Resampler(order=Rays())
    volume = np.full((1, 2, 3), value, np.float32)
    look = Appearance(classification="post")
    with pytest.warns(UserWarning, match=r"all values of array are |nothing of array is visible"):
        frame = render(volume, look, size=SIZE, resampler=painter)
    assert np.isfinite(frame.rgba).all()
