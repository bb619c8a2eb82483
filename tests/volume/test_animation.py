from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from resample.cameras.keyframes import Keyframes
from resample.cameras.models import Camera, Orthographic
from resample.cameras.viewpoints import Orbit, Spot
from resample.command.films import Tour
from resample.files.animations import write_film
from resample.files.saving import write_png
from resample.painting.choices import Primitive
from resample.resampler import Resampler
from resample_volume.appearance import Appearance
from resample_volume.calls import render
from resample_volume.cli import app
from resample_volume.command.animation import (
    FRAMES,
    PATHS,
    Flight,
    FrameOptions,
    cameras_of,
    flight_of,
    frame_of,
    shots,
)
from resample_volume.files.generated import vessel_tree
from resample_volume.files.source import write_volume
from resample_volume.inputs import as_volume
from resample_volume.rendering import Subject
from resample_volume.voxels.shading import Light
from tests.commands import ended, refused
from tests.volume.of_voxels import of_voxels

SIZE = (24, 32)
SKY = FrameOptions(size=SIZE, background=(0.0, 0.0, 0.5))
TWO = "[[camera]]\ntime = 0\nzoom = 2\n[[camera]]\ntime = 2.5\nazimuth = 90\nzoom = 2\n"


@pytest.fixture(scope="module")
def subject() -> Subject:
    return Subject.of(vessel_tree(16), Appearance())


@pytest.fixture
def tour(tmp_path) -> str:
    (tmp_path / "film.toml").write_text(TWO)
    return str(tmp_path / "film.toml")


def distances(subject, cameras):
    """Depths of the volume's middle."""
    views = [camera.view() for camera in cameras]
    return np.array(
        [(view.rotation @ subject.sphere.center + view.translation)[2] for view in views]
    )


def px_between_voxels(subject, camera):
    """On screen, in the middle of the volume."""
    view = camera.view()
    return view.focal[0] / distances(subject, [camera])[0] if view.perspective else view.focal[0]


# Paths


def test_an_orbit_goes_once_around_and_does_not_double_its_first_frame():
    made = Flight("orbit", 8, Orbit(30, 25, 1.5)).viewpoints(1.0)
    assert [camera.azimuth for camera in made] == pytest.approx(30 + 45 * np.arange(8))
    assert {replace(camera, azimuth=0) for camera in made} == {Orbit(0, 25, 1.5)}


def test_an_orbit_keeps_its_distance_to_one_middle(subject):
    cameras = cameras_of(subject, Flight("orbit", 7), SIZE)
    assert distances(subject, cameras) == pytest.approx(distances(subject, cameras[:1])[0])


def test_a_zoom_starts_at_the_cameras_own_and_ends_sixteen_times_as_far(subject):
    cameras = cameras_of(subject, Flight("zoom", 5, Orbit(zoom=2.0)), SIZE)
    away = distances(subject, cameras)
    assert away[-1] == pytest.approx(16 * away[0])
    assert away[0] == pytest.approx(
        distances(subject, [Orbit(zoom=2).around(subject.sphere, *SIZE)])
    )
    assert away[1:] / away[:-1] == pytest.approx(2)


@pytest.mark.some(1)
@pytest.mark.parametrize("fov", [0.0, 30.0])
@pytest.mark.parametrize("spacing", [0.3, 4.0])
def test_the_threshold_is_crossed_by_voxels_from_two_px_to_a_tenth(fov, spacing):
    volume = vessel_tree(16)._replace(spacing=np.full(3, spacing))
    subject = Subject.of(volume, Appearance())
    first, *_, last = cameras_of(subject, Flight("threshold", 3, Orbit(fov=fov)), SIZE)
    assert isinstance(first, Camera if fov else Orthographic)
    ends = [spacing * px_between_voxels(subject, camera) for camera in (first, last)]
    assert ends == pytest.approx([2, 0.03])


@pytest.mark.sweep
@pytest.mark.parametrize(
    "primitive", [Primitive.HYBRID, pytest.param(Primitive.PAPER, marks=pytest.mark.sweep)]
)
def test_across_the_threshold_splats_become_points(primitive):
    share, voxels = [], Subject.of(vessel_tree(16), of_voxels())
    for camera in cameras_of(voxels, Flight("threshold", 5), SIZE):
        painted = Resampler(primitive)(voxels.samples_for(camera), camera, height=24, width=32)
        share.append(painted.statistics.splat_fraction)
    assert (share[0], share[-1]) == (1, 0)
    assert share == sorted(share, reverse=True)


@pytest.mark.parametrize("path", PATHS)
def test_one_frame_is_a_path(path, subject):
    assert len(cameras_of(subject, Flight(path, 1), SIZE)) == 1


# Which path


def test_a_name_is_a_path_from_the_given_camera():
    start = Orbit(10, 20, 3)
    assert flight_of("zoom", 12, 24.0, start) == Flight("zoom", 12, start)
    assert flight_of("zoom", None, 24.0, start).frames == FRAMES


def test_a_file_is_a_path_whose_times_are_seconds(tour):
    seen = flight_of(tour, None, 10.0, Orbit())
    assert isinstance(seen, Tour)
    assert seen.frames == 26  # at 0 and 2.5 seconds there is one each
    assert flight_of(tour, 7, 10.0, Orbit()).frames == 7


def test_keyframes_lead_the_way(tour, subject):
    first, middle, last = cameras_of(subject, flight_of(tour, 3, 24.0, Orbit()), SIZE)
    for camera, azimuth in ((first, 30), (middle, 60), (last, 90)):
        wanted = Orbit(azimuth, zoom=2.0).around(subject.sphere, *SIZE)
        assert np.allclose(camera.world_to_camera, wanted.world_to_camera, atol=1e-9)


def test_keyframes_of_places_are_in_the_volumes_own_space(subject):
    spots = [Spot([0.0, y, 0.0], [8.0, 8.0, 8.0], [0.0, 0.0, 1.0], 30.0, 0.0) for y in (-30, -40)]
    tour = Tour(Keyframes(np.array([0.0, 1.0]), spots), 2)
    camera = cameras_of(subject, tour, SIZE)[0]
    view = camera.view()
    moved = np.array([0.0, -30.0, 0.0]) - subject.middle
    assert view.rotation @ moved + view.translation == pytest.approx([0, 0, 0], abs=1e-9)


@pytest.mark.parametrize(
    ("path", "frames", "complaint"),
    [
        ("spin", 8, "unknown path 'spin'; known: orbit, zoom, threshold, still, or a file"),
        ("orbit", 0, "0 frames; 1 to 10000 are allowed"),
        ("zoom", 10_001, "10001 frames; 1 to 10000 are allowed"),
    ],
)
def test_a_path_that_is_none_is_refused(path, frames, complaint):
    with pytest.raises(ValueError, match=complaint):
        flight_of(path, frames, 24.0, Orbit())


def test_keyframes_of_too_many_frames_are_refused(tour):
    with pytest.raises(ValueError, match=r"film\.toml: 10001 frames; 1 to 10000 are allowed"):
        flight_of(tour, None, 1e9, Orbit())
    with pytest.raises(ValueError, match="0 frames; 1 to 10000"):
        flight_of(tour, 0, 24.0, Orbit())


def test_keyframes_that_cannot_be_read_are_refused(tmp_path):
    with pytest.raises(OSError, match="No such file"):
        flight_of(str(tmp_path / "none.TOML"), 8, 24.0, Orbit())


@pytest.mark.parametrize("path", PATHS)
def test_a_camera_that_is_not_around_the_volume_has_no_path(path):
    spot = Spot([0, -9, 0], [0, 0, 0], [0, 0, 1], 30.0, 0.0)
    with pytest.raises(ValueError, match=r"give its camera as azimuth,elevation,zoom, or a file"):
        flight_of(path, 8, 24.0, spot)


# Frames


@pytest.mark.some(1)
@pytest.mark.parametrize("light", [Light(), Light((1.0, 0.0, 0.0)), None])
def test_a_frame_is_the_picture_that_is_rendered(light, tmp_path):
    volume = vessel_tree(16)._replace(origin=np.array([5.0, 6.0, 7.0]))
    look = Appearance(light=light)
    subject = Subject.of(volume, look)
    seen = frame_of(subject, cameras_of(subject, Flight("orbit", 4, Orbit(30)), SIZE)[1], SKY)
    write_png(
        tmp_path / "a.png",
        render(volume, look, Orbit(120), size=(32, 24)).rgba,
        background=SKY.background,
    )
    assert np.array_equal(seen, np.asarray(Image.open(tmp_path / "a.png")))


def test_nothing_to_see_is_the_background():
    subject = Subject.of(as_volume(np.full((4, 4, 4), np.nan, np.float32)), Appearance("gray"))
    levels = frame_of(subject, cameras_of(subject, Flight("threshold", 3), SIZE)[2], SKY)
    assert levels.shape == (*SIZE, 3)
    assert (levels == levels[0, 0]).all()


def test_the_shots_are_the_frames_of_the_cameras(subject):
    cameras = cameras_of(subject, Flight("orbit", 3), SIZE)
    made = shots(subject, cameras, SKY)
    assert made.total == 3
    assert np.array_equal(made.frame(2), frame_of(subject, cameras[2], SKY))


@pytest.mark.sweep
def test_equal_choices_are_the_same_job():
    jobs = []
    for _ in range(2):
        subject = Subject.of(vessel_tree(16), Appearance())
        cameras = cameras_of(subject, Flight("zoom", 3), SIZE)
        jobs.append(shots(subject, cameras, FrameOptions(size=SIZE), {"volume": "vessel-tree"}).job)
    assert jobs[0] == jobs[1]


@pytest.mark.sweep
def test_whatever_changes_the_frames_changes_the_job():
    volume, look, path, paint = vessel_tree(16), of_voxels(), Flight("orbit", 3), SKY
    others = [
        (vessel_tree(16, seed=8), look, path, paint),
        (volume._replace(spacing=np.array([1.0, 1.0, 2.0])), look, path, paint),
        (volume, Appearance(), path, paint),
        (volume, of_voxels("bone"), path, paint),
        (volume, of_voxels(light=Light(ambient=0.5)), path, paint),
        (volume, of_voxels(light=None), path, paint),
        (volume, look, Flight("zoom", 3), paint),
        (volume, look, Flight("orbit", 3, Orbit(31)), paint),
        (volume, look, path, replace(paint, size=(32, 24))),
        (volume, look, path, replace(paint, background=(0.0, 0.0, 0.0))),
        (volume, look, path, replace(paint, resampler=Resampler(threshold=0.7))),
        (volume, look, path, replace(paint, resampler=Resampler(Primitive.PAPER))),
    ]
    jobs = []
    for volume_, look_, path_, paint_ in [(volume, look, path, paint), *others]:
        subject = Subject.of(volume_, look_)
        jobs.append(shots(subject, cameras_of(subject, path_, paint_.size), paint_).job)
    assert all(one != other for n, one in enumerate(jobs) for other in jobs[:n])


def test_how_many_threads_paint_changes_neither_frames_nor_job(subject):
    cameras = cameras_of(subject, Flight("orbit", 3), SIZE)
    one, all_ = (shots(subject, cameras, replace(SKY, threads=threads)) for threads in (1, None))
    assert one.job == all_.job
    assert np.array_equal(one.frame(1), all_.frame(1))


# Files


def test_frames_of_another_path_are_refused_by_its_name(subject, tmp_path):
    for path in ("orbit", "zoom"):
        cameras = cameras_of(subject, Flight(path, 2), SIZE)
        made = shots(subject, cameras, SKY, {"path": path})
        if path == "orbit":
            write_film(tmp_path / "film", made, 24)
    with pytest.raises(ValueError, match="path is 'orbit' there and 'zoom' here"):
        write_film(tmp_path / "film", made, 24, resume=True)


@pytest.mark.parametrize("name", ["file", "file/film", "file/film.gif", "none/film"])
def test_a_target_that_cannot_be_written_is_refused_before_any_frame_is_made(
    name, subject, tmp_path
):
    (tmp_path / "file").write_text("keep me")
    before = sorted(tmp_path.rglob("*"))
    asked: list[int] = []
    made = shots(subject, cameras_of(subject, Flight(frames=2), SIZE), SKY)
    with pytest.raises(OSError, match=r"cannot be written|is not a folder"):
        write_film(tmp_path / name, made._replace(frame=asked.append), 24)
    assert asked == []
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("more", [[], ["--workers", "2"], ["--also", "sample:checker-box"]])
def test_a_film_has_the_color_bars_of_its_pictures(more, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["sample:vessel-tree", "--size", "80x96", "--color-bar", "--scale-bar"]
    beside = [one for one in more if more[:1] == ["--also"]]
    assert ended(app, "render", *words, *beside, "-o", "a.png") == 0
    assert ended(app, "animate", *words, *more, "--frames", "2", "-o", "film") == 0
    with Image.open("a.png") as one, Image.open("film/frame-0000.png") as first:
        picture, frame_0 = np.asarray(one.convert("RGB")), np.asarray(first)
    assert frame_0.shape == picture.shape
    assert frame_0.shape[1] > 96
    np.testing.assert_array_equal(frame_0[:, 80:], picture[:, 80:])


@pytest.mark.parametrize(
    "drawn",
    [
        ["--plane", "z=50%:colors=bone"],
        ["--labels", "labels.nrrd", "--label", "1:color=tomato", "--label", "2:hidden"],
        ["--also", "sample:checker-box:size=24", "--color-bar", "--scale-bar"],
        ["--box", "--axes", "--cube", "--clip", "1,0,0"],
        ["--slab", "0,20", "--projection", "maximum", "--color-bar"],
    ],
    ids=lambda words: words[0].strip("-"),
)
def test_films_have_what_pictures_have(drawn, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    tree = as_volume("vessel-tree:size=32")
    write_volume(Path("tree.nrrd"), tree)
    labels = (np.indices(tree.values.shape)[0] > 15).astype(np.uint8) + 1
    write_volume(Path("labels.nrrd"), tree._replace(values=labels))
    words = ["tree.nrrd", "--size", "64x96", "--camera", "40,30,1", *drawn]
    assert ended(app, "render", *words, "-o", "a.png") == 0
    assert ended(app, "animate", *words, "--path", "still", "--frames", "1", "-o", "film") == 0
    with Image.open("a.png") as one, Image.open("film/frame-0000.png") as frame:
        np.testing.assert_array_equal(np.asarray(frame), np.asarray(one.convert("RGB")))


def test_a_film_of_sums_has_no_color_bar(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    words = ["animate", "checker-box", "--projection", "additive", "--color-bar", "-o", "a.webp"]
    assert "leave --color-bar out" in refused(app, capsys, *words)
    assert not list(tmp_path.iterdir())
