"""Volumes of several times: one look, one frame, nothing flickers."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from resample.cameras.viewpoints import Orbit
from resample.files.images import read_image
from resample.resampler import Resampler
from resample_volume import cli
from resample_volume.classification.transfer import from_points
from resample_volume.command.animation import Course, around
from resample_volume.command.choices import AppearanceChoices, ReadOptions
from resample_volume.command.inputs import appearance_over_time, held, times_of
from resample_volume.rendering import Subject
from resample_volume.series import Series
from resample_volume.types import Recording
from tests import commands
from tests.volume.of_voxels import of_voxels

ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)
RAMP = from_points([(0.1, (1, 0.5, 0.2), 0.0), (1.0, (0.2, 0.5, 1), 0.9)], normalized=True)
SMALL = ("--size", "24")
TIMES, SIZE = 4, 16
Z, Y, X = np.mgrid[-1 : 1 : SIZE * 1j, -1 : 1 : SIZE * 1j, -1 : 1 : SIZE * 1j]


def ball(x, radius=0.35, strength=1.0):
    away = np.sqrt((X - x) ** 2 + Y**2 + Z**2)
    return strength * np.clip(4 * (radius - away) + 0.5, 0, 1)


def recording(values):
    space = (np.ones(3), np.zeros(3), np.eye(3))
    return Recording(np.asarray(values, np.float32)[:, np.newaxis], *space, "beats")


# A ball that stands still, and one that becomes brighter as it goes away.
BEATS = recording(
    [100 * ball(-0.6, 0.3) + ball(0.3 + 0.1 * n, 0.2, 100.0 * (1 + n)) for n in range(TIMES)]
)


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    np.save("beats.npy", BEATS.values[:, 0])


def still_ones(subject):
    """Voxels of the ball that stands still, by their place."""
    voxels = subject.voxels
    place = voxels.position + subject.middle
    left = place[:, 0] < 6
    order = np.lexsort(place[left].T)
    return place[left][order], voxels.color[left][order], voxels.extinction[left][order]


@pytest.mark.parametrize(
    "look",
    [
        of_voxels(RAMP),
        of_voxels("auto"),
        of_voxels("gray:gradient=0.1/0.5"),
        of_voxels("surfaces"),
        of_voxels(RAMP, gradient_opacity=(0.1, 0.6)),
    ],
    ids=["fractions", "auto", "faded", "regions", "gradient opacity"],
)
def test_what_does_not_change_looks_the_same_at_all_times(look):
    series = Series.of(BEATS)
    own = series.appearance(look)
    first, *others = (still_ones(Subject.of(volume, own)) for volume in series)
    assert len(first[0]) > 30
    for other in others:
        for found, wanted in zip(other, first, strict=True):
            np.testing.assert_allclose(found, wanted, rtol=1e-5)
    alone = [still_ones(Subject.of(volume, look))[2] for volume in series]
    assert alone[0].shape != alone[-1].shape or not np.allclose(alone[0], alone[-1], rtol=0.01)


def test_looks_are_of_the_range_of_all_times():
    series = Series.of(BEATS)
    assert series.known.span == (0, pytest.approx(BEATS.values.max()))
    brightest = series.appearance(of_voxels(RAMP)).transfer.classify(
        np.array([series.known.high]), None, (0, 1), 0
    )
    assert brightest[1][0] == pytest.approx(0.9, abs=1e-3)


def test_padding_is_that_of_all_times():
    values = BEATS.values.copy()
    values[0, :, :, :2] = -3000
    series = Series.of(BEATS._replace(values=values))
    assert series.known.padding == (-3000,)
    assert np.isnan(series[0].values[:, :2]).all()
    assert np.isfinite(series[1].values).all()
    assert np.isfinite(series.all().values).sum() == values.size - 2 * SIZE**2


def test_a_camera_sees_the_ball_around_all_times():
    series = Series.of(BEATS)
    look = series.appearance(of_voxels(RAMP))
    course = Course(len(series), lambda n: Subject.of(series[n], look))
    for n in range(TIMES):
        away = np.linalg.norm(course[n].voxels.position - course.sphere.center, axis=1)
        assert away.max() <= course.sphere.radius
        assert course[n].sphere is course.sphere
    single = around([(course[0].is_empty, course[0].sphere)])
    assert single.radius == course.sphere.radius
    assert course[0].camera(Orbit(), 24, 24) is not None
    assert len(set(course.marks)) == TIMES


def test_times_without_anything_to_see_do_not_frame():
    values = BEATS.values.copy()
    values[1:] = 0
    series = Series.of(BEATS._replace(values=values))
    look = series.appearance(of_voxels(from_points([(5, (1, 1, 1), 0.0), (50, (1, 1, 1), 0.5)])))
    course = Course(len(series), lambda n: Subject.of(series[n], look))
    assert course.sphere.radius == pytest.approx(Subject.of(series[0], look).sphere.radius)


@pytest.mark.sweep
def test_a_film_has_a_frame_for_each_time(capsys):
    words = ("--path", "still", "--transfer", "auto", "--classify", "pre", *SMALL)
    assert ended("animate", "beats.npy", "-o", "f", *words) == 0
    frames = [read_image(path) for path in sorted(Path("f").glob("*.png"))]
    assert len(frames) == TIMES
    moved = [np.abs(frame - frames[0]).max(axis=(0, 2)) for frame in frames[1:]]
    assert all(columns[:6].max() < 0.01 for columns in moved)  # where the still ball is
    assert all(columns.max() > 0.1 for columns in moved)
    before = json.loads(Path("f/animation.json").read_text())
    last = np.load("beats.npy")
    last[-1] *= 0.5
    np.save("beats.npy", last)
    capsys.readouterr()
    assert ended("animate", "beats.npy", "-o", "f", "--resume", *words) == 2
    assert before == json.loads(Path("f/animation.json").read_text())


@pytest.mark.parametrize(("words", "times"), [([], TIMES), (["--time", "1"], None)])
def test_a_film_is_of_all_times_unless_one_is_asked_for(monkeypatch, words, times):
    asked = []

    def film_of(_, recording, *_rest):
        asked.append(None if recording is None else len(recording.values))
        raise ValueError("no film is made here")

    monkeypatch.setattr("resample_volume.command.animation.film_of", film_of)
    assert ended("animate", "beats.npy", "-o", "f", *words, *SMALL) == 2
    assert asked == [times]


@pytest.mark.sweep
def test_times_are_spread_over_frames_of_a_turn():
    words = ("--frames", "8", *SMALL)
    assert ended("animate", "beats.npy", "-o", "f", *words) == 0
    assert len(list(Path("f").glob("*.png"))) == 8
    assert ended("animate", "beats.npy", "--time", "1", "-o", "g", "--frames", "2", *SMALL) == 0
    assert len(list(Path("g").glob("*.png"))) == 2


@pytest.mark.sweep
@pytest.mark.parametrize("words", [("--projection", "maximum"), ("--classify", "post")])
def test_fields_are_filmed_over_time(words):
    assert ended("animate", "beats.npy", "--path", "still", "-o", "f", *words, *SMALL) == 0
    frames = [read_image(path) for path in sorted(Path("f").glob("*.png"))]
    assert len(frames) == TIMES
    change = [np.abs(frame[:, :6] - frames[0][:, :6]).max() for frame in frames]
    assert max(change) < 0.03, change  # splines reach beyond the values of a time


@pytest.mark.sweep
def test_other_volumes_stay_while_times_go_on():
    words = ("--also", "vessel-tree:size=16:transfer=gray", "--path", "still", *SMALL)
    assert ended("animate", "beats.npy", "-o", "f", *words) == 0
    assert len(list(Path("f").glob("*.png"))) == TIMES


def test_a_channel_of_a_film_is_filmed():
    both = np.stack([BEATS.values[:, 0], 2 * BEATS.values[:, 0]], 1)
    np.save("both.npy", both)
    known = held(ReadOptions(), "both.npy")
    series = Series.of(times_of(ReadOptions(channel=1), known))
    assert np.array_equal(series[2].values, both[2, 1])
    with pytest.raises(ValueError, match=r"2 channels; .* by channel, 0 to 1 \(--channel 0"):
        Series.of(times_of(ReadOptions(), known))
    assert times_of(ReadOptions(channel=1), held(ReadOptions(), "beats.npy")) is None
    assert times_of(ReadOptions(), known._replace(values=known.values[:1, :1])) is None


def test_labels_are_of_the_voxels_of_each_time():
    labels = np.zeros((SIZE,) * 3, np.uint8)
    labels[:, :, 8:] = 1
    np.save("labels.npy", labels)
    series = Series.of(BEATS)
    words = AppearanceChoices(
        labels="labels.npy", label=("1:hidden",), shading=False, classify="pre"
    )
    look = appearance_over_time(series, words, Resampler())
    look = replace(look, labels=words.labels_of(series[0]))
    for volume in series:
        subject = Subject.of(volume, look)
        assert (subject.voxels.position + subject.middle)[:, 0].max() < 8


def test_colors_of_several_times_are_filmed():
    values = np.zeros((3, 4, SIZE, SIZE, SIZE), np.uint8)
    for n in range(3):
        values[n, n], values[n, 3] = 255, 100 * (ball(0.0) > 0.5)
    known = BEATS._replace(values=values, is_color=True)
    series = Series.of(known)
    assert len(series) == 3
    look = series.appearance(of_voxels(light=None))
    for n, volume in enumerate(series):
        color = Subject.of(volume, look).voxels.color
        np.testing.assert_allclose(color, np.tile(np.eye(3)[n], (len(color), 1)), atol=1e-6)
