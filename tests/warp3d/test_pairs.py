import json

import numpy as np
import pytest

from resample_warp3d.depth.equation import of_rectified, warp_places
from resample_warp3d.figures.pairs import edges_in_view, expected_nearness, load_pairs
from resample_warp3d.types import DepthImage, Equation
from tests.conftest import real

SHAPE = (12, 20)
NOWHERE = np.empty((0, 0, 2))


def image_of(nearness):
    color = np.zeros((*nearness.shape, 3), np.float32)
    return DepthImage(color, np.asarray(nearness, np.float32), NOWHERE)


def write_png(path, array):
    import cv2

    cv2.imwrite(str(path), array)


@pytest.fixture
def stereo(tmp_path, rng):
    """Background of disparity 1, and a square of disparity 5, at column 10 in the left view."""
    texture = rng.integers(0, 255, (SHAPE[0], 40, 3)).astype(np.uint8)
    square = rng.integers(0, 255, (4, 4, 3)).astype(np.uint8)
    folder = tmp_path / "square"
    folder.mkdir()
    for side, start, column in (("left", 0, 10), ("right", 1, 5)):
        color = texture[:, start : start + SHAPE[1]].copy()
        color[4:8, column : column + 4] = square
        disparity = np.full(SHAPE, 4, np.uint8)
        disparity[4:8, column : column + 4] = 20
        write_png(folder / f"{side}.png", color)
        write_png(folder / f"disparity-{side}.png", disparity)
    facts = {
        "left": "left.png",
        "right": "right.png",
        "disp_left": "disparity-left.png",
        "disp_right": "disparity-right.png (as seen from the right)",
        "disparity_scale": 4,
    }
    (folder / "calib.json").write_text(json.dumps(facts))
    return tmp_path


@pytest.fixture(scope="module")
def pairs():
    return load_pairs(real("depth"))


def nearest_warped(pair):
    """Truth as the depth image's nearest samples would show it, by a loop over sorted samples."""
    height, width = pair.image.nearness.shape
    rows, columns = np.indices((height, width))
    start = np.dstack([columns + 0.5, rows + 0.5])
    place, there = warp_places(pair.equation, start, pair.image.nearness.astype(np.float64))
    order = np.argsort(there, axis=None)
    place, color = place.reshape(-1, 2)[order], pair.image.color.reshape(-1, 3)[order]
    known = there.reshape(-1)[order] > 0
    column, row = np.floor(np.nan_to_num(place, nan=-1.0)).astype(int).T
    inside = known & (row >= 0) & (column >= 0)
    inside &= (row < pair.truth.shape[0]) & (column < pair.truth.shape[1])
    picture = np.full(pair.truth.shape, np.nan, np.float32)
    picture[row[inside], column[inside]] = color[inside]
    return picture


def test_both_ways_of_a_stereo_pair_are_found(stereo):
    names = [pair.name for pair in load_pairs(stereo)]
    assert names == ["square: left to right", "square: right to left"]


def test_one_folder_alone_is_read_too(stereo):
    assert len(load_pairs(stereo / "square")) == 2


def test_pixels_of_the_mask_show_what_the_depth_image_shows(stereo):
    for pair in load_pairs(stereo):
        difference = (nearest_warped(pair) - pair.truth)[pair.mask]
        np.testing.assert_allclose(difference, 0.0, atol=1e-6)


def test_what_the_square_hides_from_the_left_is_not_in_the_mask(stereo):
    mask = load_pairs(stereo)[0].mask
    # On the left the square hides columns 10 to 13 of the wall, on the right 9 to 12.
    assert not mask[5, 9:13].any()
    assert mask[5, 13:19].all()
    assert mask[5, :9].all()


def test_what_is_outside_of_the_source_is_not_in_the_mask(stereo):
    mask = load_pairs(stereo)[0].mask
    assert not mask[:, 19].any()


def test_without_a_second_map_the_mask_is_where_samples_arrive(stereo):
    path = stereo / "square" / "calib.json"
    facts = json.loads(path.read_text())
    del facts["disp_right"]
    path.write_text(json.dumps(facts))
    (pair,) = load_pairs(stereo)
    assert pair.mask[0, :19].all()
    assert not pair.mask[:, 19].any()


def test_rims_of_the_square_are_edges(stereo):
    edge = load_pairs(stereo)[0].target().edge
    assert edge[5, 3:11].all()
    assert not edge[5, 11:].any()
    assert not edge[0].any()


def test_the_nearest_sample_of_a_pixel_is_expected():
    nearness = np.full(SHAPE, 1.0)
    nearness[:, 10] = 3.0
    found = expected_nearness(image_of(nearness), of_rectified(1.0), SHAPE)
    assert found[4, 7] == 3.0
    assert found[4, 5] == 1.0


def test_samples_without_depth_are_expected_nowhere():
    nearness = np.zeros(SHAPE)
    nearness[3, 4] = 1.0
    found = expected_nearness(image_of(nearness), of_rectified(0.5), SHAPE)
    assert np.argwhere(found).tolist() == [[3, 3], [3, 4]]


def test_points_behind_the_eye_are_expected_nowhere():
    behind = Equation(np.eye(3), np.array([0.0, 0.0, -2.0]))
    assert not expected_nearness(image_of(np.ones(SHAPE)), behind, SHAPE).any()


def test_an_even_slope_is_no_edge():
    nearness = np.broadcast_to(np.linspace(1.0, 1.2, SHAPE[1]), SHAPE)
    assert not edges_in_view(image_of(nearness), of_rectified(1.0), SHAPE).any()


@pytest.mark.parametrize("key", ["left", "disp_right", "color", "pose"])
@pytest.mark.parametrize("name", ["../out/x", "../../x"])
def test_facts_that_name_files_outside_of_their_folder_are_refused(key, name, stereo):
    path = stereo / "square" / "calib.json"
    facts = json.loads(path.read_text()) | {key: name}
    if key in ("color", "pose"):
        (path.parent / "x").mkdir()
        facts = {"color": "x/*.png", "depth": "x/*.png", "pose": "poses.txt", key: name}
    path.write_text(json.dumps(facts))
    with pytest.raises(ValueError, match=r"calib\.json names"):
        load_pairs(stereo)


def test_a_folder_without_facts_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"calib\.json"):
        load_pairs(tmp_path)


def test_facts_of_another_kind_are_refused(tmp_path):
    (tmp_path / "calib.json").write_text("{}")
    with pytest.raises(ValueError, match="neither disparity maps"):
        load_pairs(tmp_path)


@pytest.mark.sweep
def test_masks_of_real_pairs_hold_a_good_part_of_the_picture(pairs):
    shares = {pair.name: float(pair.mask.mean()) for pair in pairs}
    assert min(shares.values()) > 0.2, shares
    assert max(shares.values()) < 0.95, shares


@pytest.mark.sweep
def test_real_pictures_agree_in_their_masks(pairs):
    for pair in pairs:
        warped = nearest_warped(pair)
        known = pair.mask & np.isfinite(warped).all(axis=2)
        error = np.abs(warped[known] - pair.truth[known])
        # Levels of 255; half of the pixels agree within noise, exposure and half a pixel.
        assert 255 * np.median(error) < 6, pair.name
