"""Fisheye sources against rays traced through a lens that is turned round here by halving."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest

from resample.cameras.models import Camera, LensModel
from resample.cameras.pixels import pixel_centers
from resample.files.images import read_image
from resample.measuring.quality import psnr
from resample_warp3d import cli
from resample_warp3d.depth.encodings import PlanarDepth, RayLength
from resample_warp3d.warping import warp
from tests import commands
from tests.commands import store
from tests.warp3d.naive_sheet import ball, camera_at, depth_image, pattern, plane, see

SHAPE = 96, 112
LENS = [0.03, -0.015, 0.004, -0.0006]
MATRIX = np.array([[34.0, 0.0, 56.0], [0.0, 34.0, 48.0], [0.0, 0.0, 1.0]])
FISHEYE = Camera(MATRIX, distortion=np.array(LENS), model=LensModel.FISHEYE)
THINGS = [ball((-0.5, 0.1, 2.5), 0.6, pattern(5.0)), plane((0.1, 0.05, 1), 4.0, pattern(1.5))]
TARGETS = {
    "beside": camera_at((0.25, 0.05, 0.1), focal=60.0, shape=(64, 72)),
    "turned": camera_at((0.1, 0.0, 0.2), 0.6, focal=60.0, shape=(64, 72)),
    "enlarged": camera_at((0.1, -0.1, 0.5), -0.2, 0.1, focal=150.0, shape=(64, 72)),
    "reduced": camera_at((0.0, 0.1, -0.5), 0.1, focal=24.0, shape=(64, 72)),
}


def angle_of(distance):
    """Angle θ that θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸) takes to a distance, by halving."""
    low, high = np.zeros_like(distance), np.full_like(distance, 0.5 * np.pi)
    for _ in range(60):
        angle = (low + high) / 2
        found = angle * (1 + sum(k * angle ** (2 * n + 2) for n, k in enumerate(LENS)))
        low, high = np.where(found < distance, angle, low), np.where(found < distance, high, angle)
    return (low + high) / 2


def rays(place):
    """Unit directions that the fisheye sees at places (..., 2) px; not numbers from 90° on."""
    x, y = np.moveaxis((place - MATRIX[:2, 2]) / np.diag(MATRIX)[:2], -1, 0)
    distance = np.hypot(x, y)
    angle = angle_of(distance)
    angle[angle > 0.5 * np.pi - 1e-9] = np.nan
    across = np.sin(angle) / np.maximum(distance, 1e-12)
    return np.stack([x * across, y * across, np.cos(angle)], axis=-1)


def traced(samples=4):
    """Color (H, W, 3) over the pixels, and length and z of the rays through their middles."""
    color, eye = 0.0, np.zeros(3)
    for step in product((np.arange(samples) + 0.5) / samples - 0.5, repeat=2):
        direction = rays(pixel_centers(SHAPE) + step)
        distance = np.array([thing.hit(eye, direction) for thing in THINGS])
        nearest = np.nan_to_num(distance.min(axis=0), nan=0.0, posinf=0.0)
        point = nearest[..., None] * np.nan_to_num(direction)
        first = np.nan_to_num(distance, nan=np.inf).argmin(axis=0)
        color = color + np.where((first == 0)[..., None], *(thing.color(point) for thing in THINGS))
    middle = rays(pixel_centers(SHAPE))
    length = np.min([thing.hit(eye, middle) for thing in THINGS], axis=0)
    return (color / samples**2).astype(np.float32), length, length * middle[..., 2]


@pytest.fixture(scope="module")
def source():
    return traced()


@pytest.mark.sweep
def test_lengths_of_rays_become_z(source):
    _, length, z = source
    is_known = np.isfinite(length)
    assert is_known.mean() > 0.75
    found = RayLength(FISHEYE).nearness(np.where(is_known, length, 0))
    expected = PlanarDepth().nearness(np.where(is_known, z, 0))
    np.testing.assert_allclose(found[is_known], expected[is_known], rtol=1e-5)
    assert not found[~is_known].any()


@pytest.mark.sweep
@pytest.mark.parametrize(
    "name",
    [
        "beside",
        *(
            pytest.param(name, marks=pytest.mark.sweep)
            for name in ("turned", "enlarged", "reduced")
        ),
    ],
)
def test_a_fisheye_shows_what_rays_see(source, name, record):
    color, _, z = source
    shown, truth = shown_and_true(name, color, z, FISHEYE)
    flat = Camera(MATRIX)
    image = depth_image(THINGS, flat, SHAPE, rays=4)
    plain, _ = shown_and_true(name, image.color, 1 / image.nearness, flat)
    both = (shown.coverage > 0.999) & (plain.coverage > 0.999)
    assert both.mean() > 0.75
    record.error("pixels not covered", shown.coverage <= 0.999)
    expected = truth.color.astype(np.float32)
    # Away from its middle a pinhole of this focal length has more pixels than a fisheye.
    found = psnr(shown.image, expected, mask=both)
    assert found > psnr(plain.image, expected, mask=both) - 3
    record.quality("picture", found)
    error = np.abs(np.log(shown.depth / truth.depth))[both]
    record.error("depth", np.median(error))
    record.error("wrong depths", ~(error < 0.02))  # the rest is the ball's rim


def shown_and_true(name, color, z, camera):
    """A picture with depth as a target sees it, and what that really sees."""
    target, shape = TARGETS[name], (64, 72)
    shown = warp(color, z, camera, target, size=shape[::-1], refine="none")
    return shown, see(THINGS, target, shape, rays=8)


@pytest.mark.sweep
@pytest.mark.parametrize("kind", ["z", "ray"])
@pytest.mark.parametrize("form", ["colmap", "ros"])
def test_fisheyes_of_files_are_warped_by_the_command(source, tmp_path, monkeypatch, kind, form):
    monkeypatch.chdir(tmp_path)
    color, length, z = source
    store("color.exr", color)
    np.save("depth.npy", np.nan_to_num(z if kind == "z" else length, posinf=0).astype(np.float32))
    numbers = [*np.diag(MATRIX)[:2], *MATRIX[:2, 2]]
    Path("info.yaml").write_text(
        f"height: 96\nwidth: 112\ndistortion_model: equidistant\nD: {LENS}\n"
        f"K: [34.0, 0, {numbers[2] - 0.5}, 0, 34.0, {numbers[3] - 0.5}, 0, 0, 1]\n"
    )
    model = " ".join(map(str, [*numbers, *LENS]))
    Path("cameras.txt").write_text(f"1 OPENCV_FISHEYE 112 96 {model}\n")
    Path("images.txt").write_text("1 1 0 0 0 0 0 0 1 color.exr\n\n")
    camera = ["--lens", "info.yaml"] if form == "ros" else ["--source-pose", "images.txt"]
    target = ["--target-intrinsics", "60,60,36,32", "--size", "72x64", "--move", "0.25,0.05,0.1"]
    words = ["render", "color.exr", "depth.npy", "--depth-kind", kind, "--refine", "none"]
    assert commands.ended(cli.app, *words, *camera, *target, "-o", "out.exr") == 0
    expected, _ = shown_and_true("beside", color, z, FISHEYE)
    found = read_image("out.exr")
    np.testing.assert_allclose(found[..., 3], expected.coverage, atol=2e-3)  # half floats
    np.testing.assert_allclose(found[..., :3], expected.image, atol=4e-3)
