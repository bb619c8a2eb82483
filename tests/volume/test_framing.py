import re

import numpy as np
import pytest

from resample.cameras.files import read_shot, viewpoint
from resample.cameras.models import Camera, Orthographic
from resample.cameras.viewpoints import Orbit, Sphere, Spot
from resample.command.settings import Resampling
from resample.files.images import read_image
from resample_volume import cli
from resample_volume.appearance import Appearance
from resample_volume.calls import render
from resample_volume.classification.presets import load_transfer
from resample_volume.command.choices import AppearanceChoices
from resample_volume.inputs import as_volume
from resample_volume.rendering import Subject
from resample_volume.voxels.framing import filling, sphere_around
from resample_volume.voxels.visible import classify
from tests import commands

BALL = Sphere(np.array([1.0, 2.0, 3.0]), 2.0)


def voxels_of(values):
    volume = as_volume(values)
    return classify(volume, load_transfer("gray"), gradient=None), volume


def projected(camera, point):
    """Screen point of a scene point, px."""
    view = camera.view()
    x, y, z = view.rotation @ np.asarray(point, float) + view.translation
    scale = view.focal / (z if view.perspective else 1.0)
    return np.array([x, y]) * scale + view.principal


@pytest.mark.sweep
@pytest.mark.parametrize("fov", [0.0, 1.0, 30.0, 120.0])
@pytest.mark.parametrize(("height", "width"), [(100, 100), (60, 200), (200, 60)])
def test_the_ball_leaves_a_pixel_at_zoom_one(fov, height, width, rng):
    camera = Orbit(20, 30, fov=fov).around(BALL, height, width)
    outward = rng.normal(size=(20000, 3))
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    point = np.array([projected(camera, BALL.center + BALL.radius * out) for out in outward])
    away = np.linalg.norm(point - [width / 2, height / 2], axis=1).max()
    assert away == pytest.approx(min(height, width) / 2 - 1, rel=2e-3)  # 20000 points of a sphere


@pytest.mark.parametrize("fov", [0.0, 30.0])
def test_the_middle_of_the_ball_is_the_middle_of_the_picture(fov):
    camera = Orbit(70, -40, zoom=0.7, fov=fov).around(BALL, 100, 160)
    assert projected(camera, BALL.center) == pytest.approx([80, 50])


def test_a_zoom_of_two_halves_the_distance_or_doubles_the_scale():
    near, far = (Orbit(zoom=zoom).around(BALL, 100, 100).view() for zoom in (2.0, 1.0))
    depth = [(view.rotation @ BALL.center + view.translation)[2] for view in (near, far)]
    assert depth[1] == pytest.approx(2 * depth[0])
    large, small = (Orbit(zoom=zoom, fov=0).around(BALL, 100, 100) for zoom in (2.0, 1.0))
    assert isinstance(large, Orthographic)
    assert large.sx == pytest.approx(2 * small.sx)


@pytest.mark.parametrize(("up", "axis"), [("x", 0), ("y", 1), ("z", 2), ("-z", 2), ("-y", 1)])
def test_up_is_up_in_the_picture(up, axis):
    camera = Orbit(40, 10, up=up).around(BALL, 100, 100)
    above = BALL.center + np.eye(3)[axis] * (-1 if up[0] == "-" else 1)
    assert projected(camera, above)[1] < 50


@pytest.mark.parametrize(
    ("choice", "complaint"),
    [
        ({"zoom": 0.0}, "a zoom of 0; it must be above 0"),
        ({"zoom": float("nan")}, "a zoom of nan"),
        ({"zoom": 1e9}, "1e-06 to 1e"),
        ({"fov": 180.0}, "a field of view of 180.0 degrees; 0 to below 180"),
        ({"fov": -1.0}, "a field of view"),
        ({"azimuth": float("inf")}, "must be finite"),
        ({"elevation": float("nan")}, "must be finite"),
        ({"up": "w"}, "up is 'w'; it can be x, y, z, -x, -y, -z"),
    ],
)
def test_an_orbit_that_is_none_is_refused(choice, complaint):
    with pytest.raises(ValueError, match=complaint):
        Orbit(**choice)


def test_the_ball_is_around_what_is_seen():
    values = np.zeros((20, 20, 20), np.float32)
    values[4:7, 5:8, 10:13] = 1.0
    ball = sphere_around(*voxels_of(values))
    assert ball.center == pytest.approx([11, 6, 5])
    assert ball.radius == pytest.approx(np.sqrt(3) + 2)


def edge(picture):
    """Largest opacity at the edges."""
    opacity = picture.rgba[..., 3]
    return max(side.max() for side in (opacity[0], opacity[-1], opacity[:, 0], opacity[:, -1]))


@pytest.mark.each_value
@pytest.mark.parametrize("classification", ["pre", "post"])
@pytest.mark.parametrize("size", [(32, 32), (90, 30), (24, 70)])
@pytest.mark.parametrize("camera", [Orbit(0, 0), Orbit(0, 0, fov=0), Orbit(45, 35, fov=0)])
def test_nothing_that_is_seen_is_cut_off_at_the_edge(classification, size, camera):
    rod, plate = np.zeros((2, 12, 12, 30), np.float32)
    rod[6, 6], plate[6] = 1, 1
    look = Appearance("0.2/white/0,0.5/white/0.9", classification=classification)
    for values in (rod, plate, plate.T):
        assert edge(render(values, look, camera, size=size)) == 0


@pytest.mark.parametrize("count", [1, 511, 512, 513, 3000])
def test_the_ball_is_centered_on_the_box_around_any_number_of_voxels(count, rng):
    voxels, volume = voxels_of(np.ones((2, 2, 2), np.float32))
    position = rng.normal(size=(count, 3)).astype(np.float32)
    ball = sphere_around(voxels._replace(position=position), volume)
    low, high = position.min(axis=0).astype(float), position.max(axis=0).astype(float)
    np.testing.assert_array_equal(ball.center, (low + high) / 2)


def test_the_ball_is_around_the_volume_where_nothing_is_seen():
    ball = sphere_around(*voxels_of(np.zeros((3, 5, 9), np.float32)))
    assert ball.center == pytest.approx([4, 2, 1])
    assert ball.radius == pytest.approx(np.linalg.norm([4, 2, 1]) + 2)


@pytest.mark.filterwarnings("ignore:overflow encountered:RuntimeWarning")
def test_a_volume_beyond_all_measure_is_refused():
    voxels, volume = voxels_of(np.eye(3, dtype=np.float32)[None].repeat(3, 0))
    huge = voxels._replace(position=voxels.position * np.float32(1e16))
    with pytest.raises(ValueError, match=r"1e.15 is the limit, so give another spacing"):
        sphere_around(huge, volume)


def test_angles_are_read_and_the_zoom_may_be_left_out():
    assert viewpoint("30/-20/1.5", 40.0, "y") == Orbit(30, -20, 1.5, 40.0, "y")
    assert viewpoint("-30/20", 40.0, "z") == Orbit(-30, 20, 1.0, 40.0, "z")
    assert viewpoint(" 1e1 / 2 ", 40.0, "z") == Orbit(10, 2, 1.0, 40.0, "z")


@pytest.mark.parametrize("text", ["", "30", "1/2/3/4", "a/b", "30/20/", "30+20"])
def test_text_that_is_no_camera_is_refused(text):
    with pytest.raises(ValueError, match="give azimuth,elevation,zoom, such as"):
        viewpoint(text, 30.0, "z")


def written(folder, text):
    (folder / "c.TOML").write_text(text)
    return viewpoint(str(folder / "c.TOML"), 10.0, "x")


def test_a_file_of_angles_has_its_own_field_of_view_and_up(tmp_path):
    assert written(tmp_path, "azimuth = 5\nup = '-y'") == Orbit(5, up="-y")


def test_a_file_with_eye_and_target_fits_any_picture(tmp_path):
    spot = written(tmp_path, "eye = [0, -9, 0]\ntarget = [0, 0, 0]\nfov = 60\nnear = 1")
    assert spot == Spot([0, -9, 0], [0, 0, 0], [0, 0, 1], 60, 1)
    camera = spot.sized(100, 300)
    assert isinstance(camera, Camera)
    assert camera.near == 1
    assert projected(camera, [0, 0, 0]) == pytest.approx([150, 50])
    edge = 9 * np.tan(np.radians(30))
    assert projected(camera, [0, 0, edge]) == pytest.approx([150, 0])
    assert projected(camera, [edge, 0, 0]) == pytest.approx([200, 50])


def test_a_file_with_a_size_keeps_it(tmp_path):
    text = "eye = [0, -9, 0]\ntarget = [0, 0, 0]\nwidth = 40\nheight = 20"
    camera = written(tmp_path, text)
    assert isinstance(camera, Camera)
    assert projected(camera, [0, 0, 0]) == pytest.approx([20, 10])


def test_a_pose_without_intrinsics_sees_the_field_of_view_asked_for(tmp_path):
    (tmp_path / "poses.txt").write_text("0 1 2 3 0 0 0 1\n5 1 2 4 0 0 0 1\n")
    spot = viewpoint(f"{tmp_path / 'poses.txt'}:1", 40.0, "z")
    camera, expected = spot.sized(30, 50), Camera.from_fov(40.0, 30, 50)
    np.testing.assert_array_equal(camera.matrix, expected.matrix)
    np.testing.assert_allclose(
        camera.world_to_camera[:3], np.eye(4)[:3] - [[0, 0, 0, n] for n in (1, 2, 4)], atol=1e-12
    )


def test_a_calibrated_camera_of_a_size_sees_the_same_in_another(tmp_path):
    text = "fx = 40\nfy = 40\ncx = 20\ncy = 10\nwidth = 40\nheight = 20\n"
    text += "world_to_camera = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]"
    camera = written(tmp_path, text).sized(40, 80)
    assert (camera.fx, camera.cx, camera.cy) == (80, 40, 20)
    assert read_shot(str(tmp_path / "c.TOML")).shape == (20, 40)


def test_angles_are_no_pose(tmp_path):
    written(tmp_path, "azimuth = 5")
    with pytest.raises(ValueError, match="angles go around something"):
        read_shot(str(tmp_path / "c.TOML"))


def test_a_calibrated_camera_is_taken_as_it_is(tmp_path):
    rows = "[[1, 0, 0, 2], [0, 1, 0, 3], [0, 0, 1, 4], [0, 0, 0, 1]]"
    for pose in (rows, rows.replace(", [0, 0, 0, 1]", "")):
        camera = written(tmp_path, f"fx = 5\nfy = 6\ncx = 7\ncy = 8\nworld_to_camera = {pose}")
        assert projected(camera, [0, 0, 0]) == pytest.approx([7 + 5 * 2 / 4, 8 + 6 * 3 / 4])


def blob(dtype=np.uint8):
    """A ball of 200 in the middle of (48, 48, 48)."""
    z, y, x = np.mgrid[:48, :48, :48] - 23.5
    return np.where(np.sqrt(x**2 + y**2 + z**2) < 14, 200, 0).astype(dtype)


@pytest.mark.parametrize(
    "places", [[(0, 0, 0)], [(47, 0, 47), (0, 47, 47)], [(24, 24, 47)], [(1, 24, 24), (0, 24, 24)]]
)
def test_a_few_voxels_far_away_do_not_make_the_others_small(places):
    values = blob()
    expected = sphere_around(*voxels_of(values))
    for place in places:
        values[place] = 210
    ball = sphere_around(*voxels_of(values))
    np.testing.assert_array_equal(ball.center, expected.center)
    assert ball.radius == expected.radius


def test_many_voxels_far_away_do():
    values = blob()
    values[:3, :3, :3] = 200
    assert sphere_around(*voxels_of(values)).radius > 24


def test_a_thin_thing_that_is_connected_counts():
    values = blob()
    values[24, 24, 38:] = 200
    expected = sphere_around(*voxels_of(values))
    assert expected.center[0] == pytest.approx((10 + 47) / 2)


@pytest.mark.sweep
@pytest.mark.parametrize("transfer", ["auto", "gray:low=0.5"])
def test_every_mode_sees_the_same_ball(transfer, rng):
    values = blob(np.int16) + rng.integers(0, 20, (48, 48, 48)).astype(np.int16)
    values[2, 3, 4] = 30000
    # What cameras look at in all modes, as the command line chooses it
    volume = as_volume(values)
    chosen = [Resampling(projection=name) for name in ("composite", "maximum", "average")]
    chosen += [Resampling(projection="additive"), Resampling(projection="first-hit", iso=150)]
    found = []
    for classify_ in ("pre", "post"):
        for resampling in chosen[: 5 if classify_ == "pre" else 1]:
            look = AppearanceChoices(transfer=transfer, classify=classify_)
            resampler = look.renderer(resampling)
            found.append(Subject.of(volume, look.appearance(volume, resampler), resampler).sphere)
    first, *others = found
    for ball in others:
        np.testing.assert_allclose(ball.center, first.center)
        assert ball.radius == pytest.approx(first.radius)
    assert first.radius < 17


@pytest.mark.each_value
@pytest.mark.parametrize("classification", ["pre", "post"])
@pytest.mark.parametrize("size", [(60, 60), (120, 40), (40, 120)])
@pytest.mark.parametrize("fov", [0.0, 30.0, 80.0])
def test_what_is_visible_fills_the_picture_and_is_not_cut_off(classification, size, fov, rng):
    values = np.zeros((20, 24, 40), np.float32)
    for z, y, x in rng.integers(2, 18, (12, 3)):
        values[z, y, 2 * x] = 1
    look = Appearance("0.2/white/0,0.5/white/0.9", classification=classification)
    volume, shape = as_volume(values), size[::-1]
    samples = Appearance("0.2/white/0,0.5/white/0.9", classification="pre")
    subject = Subject.of(volume, samples)
    orbit = filling(Orbit(30, 20, fov=fov), subject.sphere, subject.voxels, shape)
    opacity = render(volume, look, orbit, size=size).rgba[..., 3] > 1 / 510
    row, column = np.nonzero(opacity)
    filled = np.array([np.ptp(row) + 1, np.ptp(column) + 1]) / shape
    assert min(row.min(), column.min()) >= 1
    assert min(shape[0] - 1 - row.max(), shape[1] - 1 - column.max()) >= 1
    assert filled.max() > (0.6 if fov == 80 else 0.7)  # kernels reach far around single voxels


def test_a_zoom_multiplies_that_which_fills_the_picture():
    voxels, volume = voxels_of(np.ones((4, 6, 8), np.float32))
    ball = sphere_around(voxels, volume)
    one, two = (filling(Orbit(30, 20, zoom), ball, voxels, (50, 70)) for zoom in (1, 2))
    assert two.zoom == pytest.approx(2 * one.zoom)
    assert two.pan == pytest.approx((2 * one.pan[0], 2 * one.pan[1]))


def test_the_camera_that_fills_the_picture_is_said(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    words = ("render", "checker-box:size=12,block=4", "--size", "48x32")
    assert commands.ended(cli.app, *words, "-o", "a.exr", "--zoom-in") == 0
    said = re.search(r"the camera (\S+) fills the picture", capsys.readouterr().err)
    assert commands.ended(cli.app, *words, "-o", "b.exr", "--camera", said[1]) == 0
    np.testing.assert_allclose(read_image("a.exr"), read_image("b.exr"), atol=2e-3)
    np.save("ball.npy", blob(np.float32))
    for more in (("--classify", "pre"), ("--projection", "maximum")):
        by = ("render", "ball.npy", "--size", "48x32", *more)
        assert commands.ended(cli.app, *by, "-o", "c.exr", "--zoom-in") == 0
    spot = "eye = [0, -40, 0]\ntarget = [0, 0, 0]"
    (tmp_path / "c.toml").write_text(spot)
    capsys.readouterr()
    refused = commands.refused(
        cli.app, capsys, *words, "-o", "d.exr", "--zoom-in", "--camera", "c.toml"
    )
    assert "leave it out for a camera at a fixed position" in refused
