"""Some points of a cloud, and several clouds: by columns, boxes and files."""

from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest

from resample_points import Cloud, cli, join_clouds, select_points
from resample_points.data import columns as selecting
from resample_points.data import parts
from tests import commands

ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)
NONE = np.empty((0, 3), np.float32)
PLACE = np.mgrid[:10, :10, :2].reshape(3, -1).T + np.array([5e6, 0, 0])
NUMBER = np.arange(len(PLACE)) % 7
CLOUD = Cloud(PLACE, NONE, NONE, np.empty(0), {"classification": NUMBER})


@pytest.mark.parametrize(
    ("only", "kept"),
    [
        (["classification=2"], NUMBER == 2),
        (["classification=2,5:6"], (NUMBER == 2) | (NUMBER >= 5)),
        (["classification=:1", "y=3:"], (NUMBER <= 1) & (PLACE[:, 1] >= 3)),
        (["x=5000002"], PLACE[:, 0] == 5_000_002),
    ],
)
def test_points_are_selected_by_values_and_ranges_of_columns(only, kept):
    chosen = select_points(CLOUD, only)
    np.testing.assert_array_equal(chosen.position, PLACE[kept])
    np.testing.assert_array_equal(chosen.columns["classification"], NUMBER[kept])


def test_a_box_keeps_the_points_in_it_and_on_its_faces():
    chosen = select_points(CLOUD, crop="5000002:5000004,:,-1:0")
    kept = (PLACE[:, 0] >= 5_000_002) & (PLACE[:, 0] <= 5_000_004) & (PLACE[:, 2] == 0)
    np.testing.assert_array_equal(chosen.position, PLACE[kept])


@pytest.mark.parametrize(
    ("only", "crop", "message"),
    [
        (["classification"], None, "selects no points; give a column"),
        (["classification=two"], None, "selects no points"),
        (["classification=5:2"], None, "selects no points"),
        (["classification=9"], None, "no point is left by classification=9: .* from 0 to 6"),
        (["class=2"], None, "no column 'class'; known: x, y, z, classification"),
        ([], "0:1,0:1", "give ranges of x, y and z"),
        ([], "1,2,3", "give ranges of x, y and z"),
        ([], "0:1,:,:", "no point is left by x=0:1: x goes from 5e"),
    ],
)
def test_selections_that_are_wrong_are_refused_in_one_line(only, crop, message):
    with pytest.raises(ValueError, match=message) as caught:
        select_points(CLOUD, only, crop)
    assert "\n" not in str(caught.value)


def test_a_selection_of_a_cloud_in_files_is_that_of_one_in_memory(tmp_path, monkeypatch):
    monkeypatch.setenv("HYBRID_RESAMPLE_CACHE", str(tmp_path))
    monkeypatch.setattr(parts, "STEP", 30)
    stored = join_clouds([CLOUD])
    monkeypatch.setattr(parts, "available_memory", lambda: 40 * parts.PER_POINT)
    builder = parts.CloudBuilder(parts.storage_for(len(PLACE), "a cloud"))
    builder.add(stored)
    chosen = select_points(builder.cloud(), ["classification=2,5:6"], ":,2:,:")
    expected = select_points(CLOUD, ["classification=2,5:6"], ":,2:,:")
    np.testing.assert_array_equal(chosen.position, expected.position)
    np.testing.assert_array_equal(
        chosen.columns["classification"], expected.columns["classification"]
    )


def test_joined_clouds_have_what_all_have_and_gray_where_colors_are_missing():
    red = Cloud(
        np.float32(PLACE - PLACE[0]),
        np.tile(np.float32([0, 0, 1]), (len(PLACE), 1)),
        np.tile(np.float32([1, 0, 0]), (len(PLACE), 1)),
        np.empty(0),
        {"intensity": NUMBER, "classification": NUMBER + 10},
    )
    joined = join_clouds([CLOUD, red])
    assert joined.position.dtype == np.float64
    np.testing.assert_array_equal(joined.position, np.concatenate([PLACE, red.position]))
    np.testing.assert_array_equal(joined.color[:200], np.full((200, 3), selecting.GRAY, "f4"))
    np.testing.assert_array_equal(joined.color[200:], red.color)
    np.testing.assert_array_equal(joined.normal.any(axis=1), np.arange(400) >= 200)
    assert list(joined.columns) == ["classification"]


@pytest.fixture
def scans(tmp_path, monkeypatch):
    """a.csv and b.csv: left and right half of a square of two classes."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HYBRID_RESAMPLE_CACHE", str(tmp_path / "cache"))
    x, z = np.mgrid[:30, :30] / 10.0
    table = np.column_stack([x.ravel(), np.zeros(900), z.ravel(), z.ravel() > 1.45])
    head = {"delimiter": ",", "header": "x,y,z,class", "comments": ""}
    np.savetxt("whole.csv", table, **head)
    np.savetxt("a.csv", table[table[:, 0] < 1.45], **head)
    np.savetxt("b.csv", table[table[:, 0] > 1.45], **head)


def shown(*words):
    look = ["--camera", "0/0/1", "--size", "64x48", "--background", "white"]
    assert ended("render", *words, *look, "-o", "o.png") == 0
    return cv2.imread("o.png")


@pytest.mark.sweep
@pytest.mark.usefixtures("scans")
def test_several_clouds_in_one_picture_look_as_one(capsys):
    whole = shown("whole.csv", "--color-by", "class")
    np.testing.assert_array_equal(shown("a.csv", "--also", "b.csv", "--color-by", "class"), whole)
    words = ["--also", "none.csv", "-o", "o2.png"]
    assert "none.csv: there is no such file" in refused(capsys, "render", "a.csv", *words)


@pytest.mark.sweep
@pytest.mark.usefixtures("scans")
def test_the_command_selects_by_class_and_box():
    half = shown("whole.csv", "--crop", "1.45:,:,:")
    np.testing.assert_array_equal(shown("b.csv"), half)
    upper = shown("whole.csv", "--only", "class=1", "--color-by", "class")
    assert (upper != shown("whole.csv", "--color-by", "class")).any()
    np.testing.assert_array_equal(
        upper, shown("whole.csv", "--only", "z=1.45:", "--color-by", "class")
    )


@pytest.mark.usefixtures("scans")
def test_a_selection_that_cannot_be_read_is_refused_before_the_file_is(capsys):
    Path("some.csv").write_text("not yet read")
    said = refused(capsys, "render", "some.csv", "--only", "class", "-o", "o.png")
    assert "selects no points" in said
