"""Sheets of pictures that have changed, and truths that pictures are measured by."""

import numpy as np
import pytest
from PIL import Image, ImageChops, ImageDraw, ImageFont

from tests.golden import sheets
from tests.golden.scenes import SCENES, recorded
from tests.golden.sheets import CAPTION, GAP, amplified, captions, write_sheet
from tests.golden.truths import NONE, TRUTHS, decibels, stored, truth_of


def ramp(channels: int = 4) -> np.ndarray:
    y, x = np.mgrid[:24, :24] / 24
    return np.stack([x, y, x * y, np.ones_like(x)][:channels], axis=-1).astype(np.float32)


def test_every_scene_has_a_truth_or_a_reason_for_having_none():
    assert set(NONE) <= set(SCENES)
    named = {truth_of(scene) for scene in SCENES} - {None}
    assert named == set(TRUTHS) == set(stored())


def test_truths_have_the_shapes_of_their_pictures():
    truths, known = stored(), recorded()
    for scene in SCENES:
        if scene not in NONE:
            assert truths[truth_of(scene)].shape == known[scene].shape, scene


def test_decibels_are_of_what_the_truth_knows():
    truth = ramp()
    truth[:12] = np.nan
    found = np.nan_to_num(truth) + 0.1
    assert decibels(found, truth) == pytest.approx(20, abs=1e-4)
    found[:12] = 9
    assert decibels(found, truth) == pytest.approx(20, abs=1e-4)


def test_captions_name_the_panels_in_their_order_with_what_they_show():
    before, after = ramp(), ramp()
    after[3, 5] -= 0.03
    assert captions(before, after, (41.254, 38.5)) == [
        "before, 41.25 dB to the truth",
        "after, 38.50 dB to the truth",
        "after minus before, 16 times, on gray",
    ]
    assert captions(before, after, None)[:2] == ["before", "after"]
    assert "".join(captions(before, after, (41.254, 38.5))).isascii()  # what the font has


@pytest.mark.parametrize(("largest", "factor"), [(0.6, 1), (0.2, 2), (0.01, 32), (0.0, 1)])
def test_a_difference_is_amplified_to_be_seen_and_not_to_be_cut_off(largest, factor):
    before, after = ramp(), ramp()
    after[0, 0, 0] += largest
    assert amplified(before, after) == factor
    assert factor * largest <= 0.6


def test_a_sheet_shows_both_pictures_their_difference_and_captions(tmp_path):
    before, after = ramp(), ramp()
    after[3, 5] = 0.5 * before[3, 5]
    path = write_sheet("texture, hybrid: plane", before, after, (41.254, 38.5), tmp_path / "new")
    assert path == tmp_path / "new" / "texture-hybrid-plane.png"
    with Image.open(path) as stored_sheet:
        sheet = stored_sheet.convert("RGB")
    left = 0
    font = ImageFont.load_default(12)
    for n, text in enumerate(captions(before, after, (41.254, 38.5))):
        wide = max(240, int(np.ceil(font.getlength(text))) + 4)
        strip = Image.new("RGB", (wide, CAPTION), "white")
        ImageDraw.Draw(strip).text((2, 2), text, "black", font)
        found = sheet.crop((left, 0, left + wide, CAPTION))
        assert ImageChops.difference(found, strip).getbbox() is None, text
        panel = np.asarray(sheet)[CAPTION:, left : left + 240][5::10, 5::10]
        if n < 2:
            light = (before, after)[n][..., :3]
            np.testing.assert_allclose(panel / 255, light ** (1 / 2.2), atol=0.5 / 255 + 1e-6)
        else:
            moved = np.abs(panel.astype(int) - 128).max(axis=2) > 1
            assert np.argwhere(moved).tolist() == [[3, 5]]
            assert panel[3, 5, 0] < 100  # darker than before
        left += wide + GAP
    assert sheet.width == left


@pytest.mark.parametrize("shape", [(24, 24), (24, 24, 1), (24, 24, 3), (300, 4), (300, 3)])
def test_pictures_of_every_shape_have_a_sheet(shape, tmp_path):
    before = np.random.default_rng(7).random(shape)
    path = write_sheet("x", before, 0.9 * before, None, tmp_path)
    with Image.open(path) as sheet:
        assert sheet.width > 3 * 100


def test_values_are_shown_by_their_range():
    before = np.linspace(-50, 150, 24 * 24).reshape(24, 24)
    assert sheets.shown(before, before).min() == 0
    assert sheets.shown(before, before).max() == 1
