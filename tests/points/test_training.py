"""Gaussians from afar are as wide as training saw them: by its cameras, or estimated."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from conftest import real
from resample import look_at
from resample.cameras.models import Camera
from resample.colors import to_srgb
from resample_points import (
    Gaussians,
    GaussianStyle,
    cli,
    read_gaussians,
    render_gaussians,
    write_gaussians,
)
from resample_points.data.gaussians import some_gaussians
from tests import commands
from tests.shaped import twin

ended = partial(commands.ended, cli.app)
SIZE = (400, 300)
SCANS = ("guitar.compressed.ply", "biker.compressed.ply", "playbot/0_0/meta.json")


def flakes(count=4000, radius=1.0):
    """Opaque flakes on a sphere, of sizes as training leaves them."""
    rng = np.random.default_rng(4)
    place = rng.normal(size=(count, 3))
    place *= radius / np.linalg.norm(place, axis=1, keepdims=True)
    scale = radius * 0.004 * np.exp(rng.normal(0, 0.8, (count, 3)))
    parts = place, scale, rng.normal(size=(count, 4)), rng.uniform(0.5, 1, count)
    return Gaussians(*(np.float32(part) for part in (*parts, rng.normal(size=(count, 3)))))


def view(given, focal, away=2.6):
    """A camera that sees the middle nine tenths of a scene, of a picture 400 px wide at 330 px."""
    low, high = np.quantile(given.position.astype(float), (0.05, 0.95), axis=0)
    middle, radius = (low + high) / 2, np.linalg.norm(high - low) / 2
    ahead = np.array([0.6, -0.3, 0.75]) / np.linalg.norm([0.6, -0.3, 0.75])
    pose = look_at(middle - ahead * radius * away, middle, up=(0, -1, 0))
    shrunken = focal / 330
    matrix = np.array([[focal, 0, 200 * shrunken], [0, focal, 150 * shrunken], [0, 0, 1.0]])
    return Camera(matrix, pose)


def shown(given, focal, size, **choices):
    """A picture over black, as it is displayed."""
    frame = render_gaussians(
        given, view(given, focal), size=size, background=(0, 0, 0), style=GaussianStyle(**choices)
    )
    return to_srgb(frame.rgba[..., :3])


@pytest.mark.parametrize("name", SCANS)
def test_scans_from_afar_are_the_mean_of_the_usual_picture_without_an_option(name, record):
    given = read_gaussians(real(f"splats/{name}"))
    near = shown(given, 660.0, (800, 600))
    usual = shown(given, 660.0, (800, 600), trained_focal=660.0)
    np.testing.assert_array_equal(near, usual)
    for times in (4, 8):
        small = 800 // times, 600 // times
        mean = usual.reshape(small[1], times, small[0], times, 3).mean(axis=(1, 3))
        far = shown(given, 660.0 / times, small)
        record.quality(f"{times} times out", twin.psnr(far, mean))


def test_a_picture_does_not_depend_on_the_unit_of_length():
    one = flakes()
    expected = shown(one, 330.0, SIZE)
    assert expected.any()
    for radius in (1e-3, 1e4):
        found = shown(flakes(radius=radius), 330.0, SIZE)
        assert np.abs(found - expected).max() < 1 / 255


def test_cameras_beside_a_scene_tell_how_wide_its_gaussians_are(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("model/point_cloud/iteration_9").mkdir(parents=True)
    name = "model/point_cloud/iteration_9/point_cloud.ply"
    write_gaussians(name, flakes())
    assert read_gaussians(name).training.is_estimated
    words = "render", name, "--camera", "0,0", "--size", "24x18", "-o", "out.png"
    assert ended(*words) == 0
    assert "pixels of training are estimated as" in capsys.readouterr().err
    facts = {
        "id": 0, "img_name": "one", "width": 3200, "height": 72, "fx": 1000.0, "fy": 1000.0,
        "position": [0, 0, -5.0], "rotation": np.eye(3).tolist(),
    }  # fmt: skip
    Path("model/cameras.json").write_text(json.dumps([facts]))
    training = read_gaussians(name).training
    assert not training.is_estimated
    assert training.focal == 500.0  # of pictures that trainers shrink to 1600 px
    assert training.distance == pytest.approx(5.0, abs=0.1)
    assert ended(*words) == 0
    assert "training" not in capsys.readouterr().err
    assert np.asarray(Image.open("out.png")).any()
    Path("model/cameras.json").write_text("[{}]")
    assert read_gaussians(name).training.is_estimated


def test_an_estimate_has_no_order_and_is_kept_by_parts_of_a_scene():
    given = flakes()
    turned = some_gaussians(given, np.arange(len(given.opacity))[::-1])
    one, two = (render_gaussians(each, view(given, 40), size=(48, 36)) for each in (given, turned))
    np.testing.assert_array_equal(one.rgba, two.rgba)


def test_pixels_of_training_keep_their_size_where_a_camera_walks_away():
    training = read_gaussians(real("splats/guitar.compressed.ply")).training
    near, far = (
        Camera.from_fov(50, *SIZE[::-1], look_at(training.middle - [0, 0, away], training.middle))
        for away in (4.0, 12.0)
    )
    assert training.focal_for(far) == pytest.approx(3 * training.focal_for(near), rel=1e-6)


@pytest.mark.parametrize("name", ["sample:knot-points", "sample:knot-gaussians"])
def test_an_empty_picture_is_said(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    away = np.eye(4)
    away[2, 3] = -1000.0  # the scene is behind the eye
    np.save("pose.npy", away)
    assert ended("render", name, "--camera", "pose.npy", "--size", "24x18", "-o", "out.png") == 0
    assert "out.png: the picture is empty" in capsys.readouterr().err
    assert not np.asarray(Image.open("out.png"))[..., 3].any()
