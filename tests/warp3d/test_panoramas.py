"""Panoramas against rays traced in all directions."""

from functools import cache

import numpy as np
import pytest

from resample.measuring.quality import psnr
from resample_warp3d.views.multi_source import render_together
from resample_warp3d.views.panoramas import SEAMLESS, faces, panorama
from tests.warp3d.naive_sheet import ball, camera_at, pattern, plane, see

HEIGHT = 192
EYE = np.array([0.2, -0.1, 0.3])
ROOM = [plane(axis, side, pattern(1.5)) for axis in np.eye(3) for side in (-3.0, 3.0)]
THINGS = [ball((0.3, 0.2, 2.2), 0.5, pattern(4.0)), *ROOM]
SIZE = 64, 80


def camera(yaw, pitch, eye):
    pose = np.eye(4)
    a, b = np.cos([yaw, pitch])
    c, d = np.sin([yaw, pitch])
    pose[:3, :3] = np.array([[1, 0, 0], [0, b, d], [0, -d, b]]) @ np.array(
        [[a, 0, -c], [0, 1, 0], [c, 0, a]]
    )
    pose[:3, 3] = -pose[:3, :3] @ eye
    return camera_at(focal=50.0, shape=SIZE).moved(pose)


@cache
def traced(samples=4):
    """Color and length of rays, pixel by pixel of longitudes and latitudes."""
    color, width = 0.0, 2 * HEIGHT
    for n in range(samples * samples + 1):  # the last one is the middle's
        u, v = (
            (0.5, 0.5)
            if n == samples**2
            else ((n % samples + 0.5) / samples, (n // samples + 0.5) / samples)
        )
        y, x = np.mgrid[:HEIGHT, :width]
        east = (x + u) * 2 * np.pi / width - np.pi
        south = (y + v) * np.pi / HEIGHT - np.pi / 2
        ray = np.stack(
            [np.cos(south) * np.sin(east), np.sin(south), np.cos(south) * np.cos(east)], -1
        )
        distance = np.array([thing.hit(EYE, ray) for thing in THINGS])
        length = distance.min(axis=0)
        if n < samples**2:
            point = EYE + length[..., None] * ray
            first = distance.argmin(axis=0)
            shown = np.array([thing.color(point) for thing in THINGS])
            color = color + np.take_along_axis(shown, first[None, ..., None], 0)[0]
    return (color / samples**2).astype(np.float32), length


@cache
def sources():
    pose = np.eye(4)
    pose[:3, 3] = -EYE
    return panorama(*traced(), pose, noise=0.0, refine="none")


def seen(target):
    """What is made of the panorama, and what is really there."""
    made = render_together(sources(), target, SIZE, joining=SEAMLESS).warped
    return made, see(THINGS, target, SIZE, rays=6)


VIEWS = {  # yaw to the right and pitch upwards, rad
    "ahead": (0, 0),
    "between": (np.pi / 4, 0),
    "behind": (np.pi, 0),
    "above": (0.3, 1.57),
    "below": (1.0, -1.2),
    "corner": (-2.3, 0.7),
}


@pytest.mark.sweep
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(
            name,
            marks=pytest.mark.sweep
            if name in ("between", "below", "corner")  # parts of others
            else (),
        )
        for name in VIEWS
    ],
)
def test_all_around_there_are_no_seams(name, record):
    made, truth = seen(camera(*VIEWS[name], EYE))
    record.quality("picture", psnr(made.image, truth.color.astype(np.float32)))
    assert made.coverage.min() > 0.94
    record.error("pixels not covered", made.coverage <= 0.97)
    record.error(
        "wrong depths", ~(np.abs(np.log(made.depth / truth.depth)) < 0.02)
    )  # the rest is rims


@pytest.mark.sweep
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(
            name,
            marks=pytest.mark.sweep
            if name in ("ahead", "behind", "below")  # parts of others
            else (),
        )
        for name in VIEWS
    ],
)
def test_an_eye_that_moves_sees_what_rays_see(name, record):
    made, truth = seen(camera(*VIEWS[name], EYE + np.array([0.15, 0.1, -0.1])))
    whole = made.coverage > 0.97
    record.error("pixels not covered", ~whole)  # the rest is hidden from the panorama
    record.quality("picture", psnr(made.image, truth.color.astype(np.float32), mask=whole))
    record.error("wrong depths", ~(np.abs(np.log(made.depth / truth.depth))[whole] < 0.02))


@pytest.mark.sweep
def test_faces_see_every_pixel_where_its_ray_goes():
    color, length = traced()
    for image, camera in faces(color, length):
        place, nearness = image.place, image.nearness
        ray = np.concatenate([place / camera.fx, np.ones((*nearness.shape, 1))], axis=2)
        point = (ray / nearness[..., None]) @ camera.world_to_camera[:3, :3]
        at = np.linalg.norm(point, axis=2)
        column = np.arctan2(point[..., 0], point[..., 2]) * HEIGHT / np.pi + HEIGHT - 0.5
        row = np.arcsin(point[..., 1] / at) * HEIGHT / np.pi + HEIGHT / 2 - 0.5
        n, m = np.rint(row).astype(int), np.rint(column).astype(int) % (2 * HEIGHT)
        np.testing.assert_allclose(row, n, atol=1e-4)
        np.testing.assert_allclose(at, length[n, m], rtol=1e-5)
        np.testing.assert_array_equal(image.color, color[n, m])


@pytest.mark.parametrize("height", [16, 17, 18, 21])
def test_faces_see_all_there_is(height):
    count = 2 * height**2
    color = np.arange(count, dtype=np.float32).reshape(height, 2 * height, 1)
    cut = faces(color, np.ones((height, 2 * height)))
    shown = [np.unique(image.color) for image, _ in cut]
    assert len(shown) == 6
    assert all((image.nearness > 0).all() for image, _ in cut)  # ahead of its camera
    np.testing.assert_array_equal(np.unique(np.concatenate(shown)), np.arange(count))


def test_what_has_no_depth_is_unknown():
    length = np.ones((16, 32))
    length[2:6, 3:30] = [0, -1, np.nan] * 9
    length[9] = np.inf
    unknown = sum((image.nearness == 0).sum() for image, _ in faces(np.ones((16, 32, 3)), length))
    assert unknown > 4 * 27 + 32
    assert all(np.isfinite(image.nearness).all() for image, _ in faces(length[..., None], length))


@pytest.mark.parametrize(
    ("color", "length", "complaint"),
    [
        ((16, 30, 3), (16, 30), r"H x 2 H pixels, 16 or more high, not \(16, 30\)"),
        ((16, 32, 3), (8, 16), r"not \(16, 32\) and \(8, 16\)"),
        ((2, 4, 3), (2, 4), "16 or more high"),
        ((16, 32, 3), (16, 32, 1), r"and \(16, 32, 1\)"),
    ],
)
def test_what_is_no_panorama_is_refused(color, length, complaint):
    with pytest.raises(ValueError, match=complaint):
        panorama(np.ones(color, np.float32), np.ones(length))


def test_a_panorama_without_depth_is_refused():
    with pytest.raises(ValueError, match="no depth at all"):
        panorama(np.ones((16, 32, 3), np.float32), np.zeros((16, 32)))
