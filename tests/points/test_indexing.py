"""Which point a pixel shows: by rows of the cloud, under any camera."""

from functools import partial

import numpy as np
import pytest

from resample.cameras.models import Camera, Orthographic
from resample.cameras.pixels import Equirectangular
from resample_points import Cloud, CloudScene, cli, index_cloud, prepare_cloud
from tests import commands

ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)
NONE = np.empty((0, 3))
SIZE = (24, 16)
ORDER = np.random.default_rng(3).permutation(24 * 16)


def wall(depth, camera):
    """Points at the centers of all pixels (H × W, 3), at a depth."""
    x, y = np.meshgrid(np.arange(24) + 0.5, np.arange(16) + 0.5)
    if isinstance(camera, Orthographic):
        return np.stack([(x - 12) / 5, (y - 8) / 5, np.full_like(x, depth)], axis=2).reshape(-1, 3)
    ray = np.stack([x, y, np.ones_like(x)], axis=2) @ np.linalg.inv(camera.matrix).T
    return (depth * ray).reshape(-1, 3)


@pytest.mark.parametrize("camera", [Camera.from_fov(40, 16, 24), Orthographic(5, 5, 12, 8)])
def test_a_pixel_shows_the_point_at_its_center_and_not_the_one_behind(camera):
    front, back = wall(2.0, camera), wall(3.0, camera)
    place = np.concatenate([back, front[ORDER]])
    found = index_cloud(Cloud(place, NONE, NONE, np.empty(0)), camera, size=SIZE)
    np.testing.assert_array_equal(found.ravel()[ORDER], 384 + np.arange(384))


def test_rows_are_those_of_the_cloud_also_where_points_are_left_out():
    camera = Camera.from_fov(40, 16, 24)
    place = np.concatenate([np.full((5, 3), np.nan), wall(2.0, camera)[ORDER]])
    surfels = prepare_cloud(Cloud(place, NONE, NONE, np.empty(0)))
    found = CloudScene(surfels).indices(camera, size=SIZE)
    np.testing.assert_array_equal(found.ravel()[ORDER], 5 + np.arange(384))


def test_pixels_that_show_nothing_have_none():
    camera = Camera.from_fov(40, 16, 24)
    place = wall(2.0, camera).reshape(16, 24, 3)[:, :8].reshape(-1, 3)
    found = index_cloud(Cloud(place, NONE, NONE, np.empty(0)), camera, size=SIZE)
    assert found[:, 10:].max() == -1
    np.testing.assert_array_equal(found[:, :8], np.arange(128).reshape(16, 8))


def test_a_panorama_shows_points_in_their_directions():
    n = np.arange(4000) + 0.5
    z, turn = 1 - 2 * n / 4000, np.pi * (1 + 5**0.5) * n
    place = np.stack(
        [np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], axis=1
    )
    found = index_cloud(Cloud(place, NONE, NONE, np.empty(0)), Equirectangular(), size=(64, 32))
    longitude, latitude = (
        (np.arange(64) - 31.5) / 64 * 2 * np.pi,
        (15.5 - np.arange(32)) / 32 * np.pi,
    )
    lon, lat = np.meshgrid(longitude, latitude)
    ray = np.stack([np.cos(lat) * np.sin(lon), -np.sin(lat), np.cos(lat) * np.cos(lon)], axis=2)
    cosine = (place[found] * ray).sum(axis=2)[2:-2]
    assert cosine.min() > np.cos(0.04)  # nearest points are within 0.03


def test_the_command_writes_them_beside_the_picture(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    camera = Camera.from_fov(40, 16, 24)
    np.savetxt("a.xyz", wall(2.0, camera)[ORDER])
    pose = ["--intrinsics", f"{camera.fx},{camera.fy},12,8", "--pose", "eye.txt", "--size", "24x16"]
    np.savetxt("eye.txt", np.eye(4))
    assert ended("render", "a.xyz", *pose, "-o", "o.png", "--index", "o.npy") == 0
    np.testing.assert_array_equal(np.load("o.npy").ravel()[ORDER], np.arange(384))
    said = refused(capsys, "render", "a.xyz", "-o", "p.png", "--index", "o.txt")
    assert "numbers of points are written as .npy" in said
