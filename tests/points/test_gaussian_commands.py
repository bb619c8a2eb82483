"""3D Gaussians by commands, in pages and by `render_gaussians`."""

import json
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from resample import look_at
from resample.cameras.files import read_shot
from resample.cameras.models import Camera
from resample.cameras.pixels import Equirectangular
from resample.colors import to_srgb
from resample.files.images import read_channels
from resample.progress import Cancel
from resample_comparisons.points import mitsuba
from resample_points import (
    Gaussians,
    GaussianStyle,
    ProjectedCamera,
    cli,
    gaussian_camera,
    read_gaussians,
    render_gaussians,
    write_gaussians,
)
from resample_points.data.gaussians import colors_along
from resample_points.viewing import suits, view_of
from tests import commands, splats
from tests.shaped import twin

ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)
SMALL = ("--size", "48x36")


def scene(count=60, harmonics=15):
    """Round ones around the origin, red toward +x."""
    rng = np.random.default_rng(3)
    parts = rng.normal(size=(count, 3)), np.full((count, 3), 0.15), rng.normal(size=(count, 4))
    color = rng.normal(size=(count, 3))
    levels = rng.integers(-3000, 3000, (count, harmonics, 3)).astype(np.int16)
    arrays = (np.float32(part) for part in (*parts, rng.uniform(0.3, 1, count), color))
    return Gaussians(*arrays, levels, 1e-4)


@pytest.fixture
def file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_gaussians("scene.ply", scene())
    return Path("scene.ply")


def test_converted_scenes_look_the_same(file, capsys):
    start = read_gaussians(file)._replace(training=None)
    camera = gaussian_camera(start, size=(64, 48), azimuth=40)
    shown = render_gaussians(start, camera, size=(64, 48)).rgba
    for suffix, least in (("compressed.ply", 45), ("spz", 40), ("sog", 45)):  # SPZ rounds by 3 %
        assert ended("convert", str(file), "-o", f"a.{suffix}") == 0
        assert "60 Gaussians with harmonics of degree 3" in capsys.readouterr().err
        assert ended("convert", f"a.{suffix}", "-o", "back.ply") == 0
        again = read_gaussians("back.ply")._replace(training=None)
        assert again.up is None
        found = render_gaussians(again, camera, size=(64, 48)).rgba
        assert np.sqrt(np.mean((to_srgb(found) - to_srgb(shown)) ** 2)) < 10 ** (-least / 20), (
            suffix
        )
    assert ended("convert", str(file), "-o", "a.splat") == 0
    assert "degree 3, " in (told := capsys.readouterr().err)
    assert ".splat has no harmonics" in told


def test_a_part_of_a_scene_is_converted_and_placed(file, capsys):
    start = read_gaussians(file)
    Path("pose.txt").write_text("1 0 0 5\n0 1 0 0\n0 0 1 0\n0 0 0 1\n")
    options = ["--crop=0:,:,:", "--degree", "1", "--pose", "pose.txt", "--least-opacity", "0.5"]
    assert ended("convert", str(file), *options, "-o", "a.ply") == 0
    found = read_gaussians("a.ply")
    kept = (start.position[:, 0] >= 0) & (start.opacity >= 0.5)
    np.testing.assert_allclose(found.position, start.position[kept] + [5, 0, 0], rtol=1e-6)
    np.testing.assert_allclose(found.scale, start.scale[kept], rtol=1e-6)
    first = start.harmonics[kept, :3] * start.harmonic_step
    np.testing.assert_allclose(found.harmonics * found.harmonic_step, first, atol=1e-5)
    capsys.readouterr()
    assert "written as .ply" in refused(capsys, "convert", str(file), "-o", "a.obj")
    Path("a.xyz").write_text("0 0 0\n")
    assert "holds no 3D Gaussians" in refused(capsys, "convert", "a.xyz", "-o", "b.ply")


def toward(given, eye):
    """Unit directions from an eye to the Gaussians."""
    along = given.position - eye
    return along / np.linalg.norm(along, axis=1, keepdims=True)


@pytest.mark.parametrize("degree", [0, 3, 8, 15])
def test_colors_are_those_of_the_harmonics_toward_the_eye(degree):
    given, eye = scene(harmonics=degree), np.array([0.5, -4.0, 1.0])
    camera = Camera.from_fov(50, 36, 48, look_at(eye, (0, 0, 0)))
    ours = render_gaussians(
        given, camera, size=(48, 36), background=(0, 0, 0),
        style=GaussianStyle("bare", "rays", subpixels=1),
    )  # fmt: skip
    shapes = (*given[:4], colors_along(given, toward(given, eye)))
    truth = twin.painted(shapes, camera, (36, 48), "rays")[..., :3]
    np.testing.assert_allclose(to_srgb(ours.rgba[..., :3]), np.clip(truth, 0, 1), atol=2e-3)


def test_backgrounds_are_composited_as_training_does():
    black, white = (
        render_gaussians(scene(), camera_of(), size=(48, 36), background=[level] * 3)
        for level in (0.0, 1.0)
    )
    alone = render_gaussians(scene(), camera_of(), size=(48, 36))
    apart = to_srgb(white.rgba[..., :3]) - to_srgb(black.rgba[..., :3])
    np.testing.assert_allclose(apart, np.repeat(1 - alone.rgba[..., 3:], 3, axis=2), atol=2e-3)
    assert (black.rgba[..., 3] == 1).all()


def camera_of():
    return gaussian_camera(scene(), size=(48, 36))


def test_the_command_writes_what_the_library_renders(file):
    words = ("--camera", "30/20/1", "--up", "z", "--background", "white", *SMALL)
    assert ended("render", file, "-o", "out.png", *words) == 0
    camera = gaussian_camera(scene(), size=(48, 36), azimuth=30, elevation=20, up="z")
    frame = render_gaussians(scene(), camera, size=(48, 36), background=(1, 1, 1))
    levels = np.asarray(Image.open("out.png"))[..., :3]
    np.testing.assert_allclose(levels, 255 * np.clip(to_srgb(frame.rgba[..., :3]), 0, 1), atol=1)


@pytest.mark.sweep
def test_exr_has_both_depths_and_the_coverage(file):
    assert ended("render", file, "-o", "out.exr", *SMALL) == 0
    channels = read_channels("out.exr")
    assert {"Z", "first.Z", "value", "coverage", "A"} <= set(channels)
    solid = channels["A"] > 0.9
    assert np.isfinite(channels["value"][solid]).all()
    assert (channels["first.Z"][solid] <= channels["value"][solid] + 1e-4).all()


@pytest.mark.some(1)
@pytest.mark.parametrize("kind", ["splat", "sog", "spz"])
def test_other_formats_are_rendered(tmp_path, monkeypatch, kind):
    monkeypatch.chdir(tmp_path)
    some = splats.scene(count=40, width=8)
    written = {"splat": splats.splat_of, "spz": lambda one: splats.spz_of(one, 3)}
    content = splats.zipped(splats.sog_of(some, 2)) if kind == "sog" else written[kind](some)
    Path(f"scene.{kind}").write_bytes(content)
    assert ended("render", f"scene.{kind}", "-o", "out.png", *SMALL) == 0
    assert np.asarray(Image.open("out.png"))[..., 3].any()


@pytest.mark.some(5)
@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("--color-by", "x"), "--color-by is an option of clouds of points, and scene.ply holds"),
        (("--look", "soft"), "'trained', 'bare' or 'affine'"),
        (("--largest", "1e-6"), "none of the 60 Gaussians is within"),
        (("--trained-focal", "nothing.json"), "there is no such file"),
        (("--trained-focal", "-3"), "a focal length of -3 px; give one above 0"),
        (
            ("--order", "depth", "--panorama", "equirectangular", "--size", "64x32"),
            "order distance",
        ),
    ],
)
def test_options_that_do_not_fit_are_refused(file, words, complaint, capsys):
    assert complaint in refused(capsys, "render", file, "-o", "out.png", *words)
    assert not Path("out.png").exists()


def test_clouds_refuse_options_of_gaussians(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    np.savez("cloud.npz", position=np.random.default_rng(1).normal(size=(50, 3)))
    message = refused(capsys, "render", "cloud.npz", "-o", "out.png", "--look", "bare")
    assert "--look is an option of 3D Gaussians, and cloud.npz holds none; leave it out" in message


def test_cropping_and_joining_change_what_is_shown(file):
    assert ended("render", file, "-o", "all.png", *SMALL) == 0
    assert (
        ended(
            "render", file, "--crop", "0:9,:,:", "--least-opacity", "0.5", "-o", "some.png", *SMALL
        )
        == 0
    )
    shown = [np.asarray(Image.open(name))[..., 3].sum() for name in ("all.png", "some.png")]
    assert shown[0] > shown[1] > 0
    write_gaussians("more.ply", scene()._replace(position=scene().position + np.float32([9, 0, 0])))
    assert ended("render", file, "--also", "more.ply", "-o", "both.png", *SMALL) == 0


def test_films_and_panoramas_are_written(file):
    assert ended("animate", file, "-o", "film.gif", "--frames", "3", "--size", "24x18") == 0
    with Image.open("film.gif") as film:
        assert film.n_frames == 3
    around = ("--panorama", "fisheye:fov=200", "--size", "40x40")
    assert ended("render", file, "-o", "dome.png", *around) == 0


def test_cameras_of_training_give_views_and_the_focal_length(file, record):
    pose = look_at((0, -6, 1), (0, 0, 0))
    facts = {
        "id": 0, "img_name": "one", "width": 96, "height": 72, "fx": 100.0, "fy": 100.0,
        "position": (-pose[:3, :3].T @ pose[:3, 3]).tolist(), "rotation": pose[:3, :3].T.tolist(),
    }  # fmt: skip
    Path("cameras.json").write_text(json.dumps([facts]))
    shot = read_shot("cameras.json:one")
    np.testing.assert_allclose(shot.pose, pose, atol=1e-12)
    assert shot.shape == (72, 96)
    words = ("--camera", "cameras.json:0", "--trained-focal", "cameras.json", *SMALL)
    assert ended("render", file, "-o", "out.png", "--background", "black", *words) == 0
    near = render_gaussians(
        scene(), shot.camera, size=(96, 72), background=(0, 0, 0), style=GaussianStyle(subpixels=1)
    )
    mean = to_srgb(near.rgba[..., :3]).reshape(36, 2, 48, 2, 3).mean(axis=(1, 3))
    levels = np.asarray(Image.open("out.png"))[..., :3] / 255
    record.quality("picture", twin.psnr(levels, mean))


def test_files_of_training_cameras_that_are_damaged_are_refused(file, capsys):
    Path("cameras.json").write_text('[{"rotation": [[1]], "position": [0, 0, 0], "fx": 1}]')
    message = refused(capsys, "render", file, "--camera", "cameras.json:0", "-o", "out.png")
    assert "cameras.json: camera 0" in message


def test_pages_paint_pick_and_preview(file):
    page = view_of(file)
    assert page.about["subtitle"] == "60 Gaussians"
    painter, settings = page.painter(), {"background": "black", "look": "trained"}
    whole, quick = (
        painter.paint(settings, (48, 36), quick=quick, cancel=Cancel()) for quick in (False, True)
    )
    assert whole.levels.shape == quick.levels.shape == (36, 48, 3)
    found = painter.pick(settings, (48, 36), 24, 18)
    assert set(found) <= {"position", "depth"}
    assert suits([str(file)])
    with pytest.raises(ValueError, match=r"color.by is an option of clouds"):
        page.refuse({"color-by": "x"})


def test_cameras_of_all_kinds_are_taken_and_others_refused():
    from resample import registry

    given, size = scene(), (48, 24)
    for camera in (Equirectangular(), ProjectedCamera(registry.build("projections", "fisheye"))):
        assert render_gaussians(given, camera, size=size).rgba.any()
    with pytest.raises(ValueError, match="Gaussians are rendered by Camera, Orthographic"):
        render_gaussians(given, object(), size=size)
    cube = ProjectedCamera(registry.build("projections", "cubemap"))
    with pytest.raises(ValueError, match="projections of one part, not CubeMap"):
        render_gaussians(given, cube, size=(48, 8))


def test_less_memory_gives_the_same_bits():
    given, size = scene(400), (128, 96)
    camera = gaussian_camera(given, size=size)
    whole = render_gaussians(given, camera, size=size)
    parts = render_gaussians(given, camera, size=size, memory=250 * 132)
    np.testing.assert_array_equal(whole.rgba, parts.rgba)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"appearance": "soft"}, "appearance 'soft'; known: trained, bare, affine"),
        ({"order": "size"}, "order 'size'; known: depth, distance, rays"),
        ({"subpixels": 9}, "9 sub-pixels; give 1 to 8"),
        ({"near": -1}, "must not lie behind the eye"),
        ({"trained_focal": 0}, "a focal length of 0 px"),
    ],
)
def test_styles_out_of_range_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        GaussianStyle(**options)


def test_a_scene_that_stays_in_its_file_has_the_same_bits(tmp_path, monkeypatch):
    from resample_points import cropped_gaussians, read_gaussians
    from resample_points.data.gaussians import Crop
    from resample_points.files.gaussians.formats import stored_gaussians
    from resample_points.painting import gaussians as painting

    monkeypatch.setattr(painting, "PART", 64)
    path, given = tmp_path / "scene.ply", scene(500)
    write_gaussians(path, given)
    crop = Crop([[-1, -np.inf, -np.inf], [np.inf] * 3], 0.4, 0.2)
    whole = cropped_gaussians(read_gaussians(path), **crop._asdict())
    stored = painting.StoredGaussians(stored_gaussians(path), crop)
    camera = gaussian_camera(whole, size=(96, 72))
    one, two = (
        render_gaussians(each, camera, size=(96, 72), memory=memory)
        for each, memory in ((whole, None), (stored, 280 * 132))
    )
    for mine, theirs in zip(one[:4], two[:4], strict=True):
        np.testing.assert_array_equal(mine, theirs)


def test_what_does_not_fit_stays_in_its_file(file, monkeypatch):
    from resample_points.command import gaussians

    assert ended("render", file, "-o", "whole.png", "--camera", "0/0/0.5", *SMALL) == 0
    monkeypatch.setattr(gaussians, "free_memory", lambda: 60 * 200.0)
    assert ended("render", file, "-o", "parts.png", "--camera", "0/0/0.5", *SMALL) == 0
    assert Path("parts.png").read_bytes() == Path("whole.png").read_bytes()


def test_both_eyes_are_shown_beside_each_other(file, capsys):
    words = ("--camera", "0/0/1", "--background", "black", *SMALL)
    assert ended("render", file, "-o", "both.exr", "--eyes", "0.4", *words) == 0
    assert ended("render", file, "-o", "one.exr", *words) == 0
    both, one = (read_channels(name)["Z"] for name in ("both.exr", "one.exr"))
    assert both.shape == (36, 96)
    camera = gaussian_camera(scene(), size=(48, 36), azimuth=0, elevation=0, up="-y")
    # Mean places in both: what is as far as the middle is apart by the parallax of its depth.
    depth = float(np.median(one[np.isfinite(one)]))
    left, right = (read_channels("both.exr")["R"][:, part] for part in (np.s_[:48], np.s_[48:]))
    moves = range(-12, 13)
    scores = [np.square(left[:, 12:36] - right[:, 12 - n : 36 - n]).mean() for n in moves]
    assert abs(moves[int(np.argmin(scores))] - 0.4 * camera.fx / depth) < 2.5
    around = ("--panorama", "fisheye", "--size", "40x40")
    message = refused(capsys, "render", file, "-o", "no.png", "--eyes", "1", *around)
    assert "--eyes is for perspective cameras" in message


@pytest.mark.sweep
def test_further_scenes_are_placed_by_a_pose(file):
    np.savetxt("pose.txt", [[1, 0, 0, 9], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    write_gaussians(
        "moved.ply", scene()._replace(position=scene().position + np.float32([9, 0, 0]))
    )
    for name, also in (("posed.png", "scene.ply,pose.txt"), ("moved.png", "moved.ply")):
        assert ended("render", file, "--also", also, "-o", name, *SMALL) == 0
    one, two = (np.asarray(Image.open(name)).astype(int) for name in ("posed.png", "moved.png"))
    assert np.abs(one - two).max() <= 1


def test_methods_are_compared_with_many_rays(file, capsys, record):
    words = ("--size", "32x24", "--methods", "affine,rays", "--subpixels", "4", "--json")
    assert ended("compare", file, "-o", "sheet.png", *words) == 0
    affine, rays = json.loads(capsys.readouterr().out)
    assert rays["method"] == "rays"
    assert rays["psnr"] > affine["psnr"] + 10
    record.quality("rays", rays["psnr"])
    with Image.open("sheet.png") as sheet:
        assert sheet.width > 3 * 32


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("--methods", "gsplat"), "method 'gsplat'; known: trained, distance, rays, bare, affine"),
        (("-o", "sheet.gif"), "contact sheets are written as .png"),
        (("--panorama", "fisheye"), "methods are compared in perspective"),
    ],
)
def test_comparisons_that_cannot_be_made_are_refused(file, words, complaint, capsys):
    assert complaint in refused(capsys, "compare", file, *words)


def test_deep_pictures_composite_to_the_flat_one(file, capsys):
    from tests.deep import read_deep

    words = ("--camera", "0/0/1", "--subpixels", "2", *SMALL)
    assert ended("render", file, "-o", "deep.exr", "--deep", "6", *words) == 0
    assert ended("render", file, "-o", "flat.exr", *words) == 0
    flat = read_channels("flat.exr")
    samples = read_deep("deep.exr")
    assert max(len(pixel) for row in samples for pixel in row) > 2
    for y, x in [(18, 24), (10, 20), (25, 30), (18, 12)]:
        light = np.zeros(4)
        for sample in samples[y][x]:
            light += (1 - light[3]) * sample[:4]
        expected = [flat[name][y, x] for name in "RGBA"]
        np.testing.assert_allclose(light, expected, atol=2e-3)
    message = refused(capsys, "render", file, "-o", "no.exr", "--deep", "3", "--eyes", "1")
    assert "--deep is for one picture in the order of depth" in message
    assert ".exr" in refused(capsys, "render", file, "-o", "no.png", "--deep", "3")


def test_mitsuba_is_named_where_it_is_missing(file, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "mitsuba", None)
    message = refused(capsys, "compare", file, "--methods", "rays,mitsuba", *SMALL)
    assert "pip install 'mitsuba>=3.9'" in message


def test_mitsuba_traces_the_same_gaussians():
    pytest.importorskip("mitsuba")
    given = scene(40, harmonics=0)._replace(position=np.float32(3 * scene(40).position))
    camera = Camera(
        np.array([[40.0, 0, 20], [0, 40, 20], [0, 0, 1]]), look_at((1, -14, 2), (0, 0, 0))
    )
    eye = -camera.world_to_camera[:3, :3].T @ camera.world_to_camera[:3, 3]
    color = colors_along(given, toward(given, eye))
    try:
        found, _ = mitsuba.render(given, color, camera, (36, 48), 0.0)
    except ValueError as error:
        pytest.skip(f"{error}")
    ours = render_gaussians(
        given, camera, size=(48, 36), background=(0, 0, 0),
        style=GaussianStyle("bare", "rays", subpixels=4),
    )  # fmt: skip
    assert twin.psnr(found, to_srgb(ours.rgba[..., :3])) > 32  # of 16 rays per pixel; 33 found


def test_a_failure_of_mitsuba_is_one_line(tmp_path, monkeypatch):
    broken = tmp_path / "mitsuba.py"
    broken.write_text(
        "import os, sys\nsys.stderr.write('LLVM ERROR: Cannot select\\n')\nos.abort()\n"
    )
    monkeypatch.setattr(mitsuba, "check", lambda: None)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    camera = Camera.from_fov(50, 36, 48, look_at((0, -6, 1), (0, 0, 0)))
    with pytest.raises(ValueError, match=r"cannot run here: LLVM ERROR: Cannot select$"):
        mitsuba.render(scene(), scene().color, camera, (36, 48), 0.0)
