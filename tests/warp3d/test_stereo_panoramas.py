"""Omnidirectional stereo pairs and VR180 against rays from each pixel's own eye."""

from functools import cache, partial
from pathlib import Path

import cv2
import numpy as np
import pytest

from resample.files.formats import WriteOptions
from resample.files.images import read_image
from resample.files.pictures import Kind, Picture
from resample.files.saving import write_picture
from resample.measuring.quality import psnr
from resample_warp3d import cli
from resample_warp3d.projection_models import StereoPanorama, project, unproject
from tests import commands
from tests.warp3d.test_panoramas import EYE, THINGS

ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)
APART, ROWS, RAYS = 0.12, 64, 3
MERGING = np.radians([60, 75])  # latitudes between which the eyes join


def write_image(name, color):
    """Write a picture (H, W, 3) of linear light."""
    kind = Kind(("R", "G", "B"), 32, is_encoded=False)
    write_picture(Path(name), Picture(np.asarray(color, np.float32), kind), WriteOptions())


@cache
def traced(right, rows=ROWS):
    """Color of the true panorama of an eye, and ray lengths at the pixels' centers."""
    total = 0.0
    steps = [(n % RAYS + 0.5) / RAYS for n in range(RAYS**2)]
    for u, v in [*zip(steps, np.sort(steps), strict=True), (0.5, 0.5)]:
        # Eyes and rays of a stereo panorama, as in Peleg, Ben-Ezra and Pritch 2001
        y, x = np.mgrid[:rows, : 2 * rows]
        east, north = (x + u) * np.pi / rows - np.pi, np.pi / 2 - (y + v) * np.pi / rows
        ray = [np.cos(north) * np.sin(east), -np.sin(north), np.cos(north) * np.cos(east)]
        share = np.clip((abs(north) - MERGING[0]) / np.ptp(MERGING), 0, 1)
        out = right * np.cos(share * np.pi / 2)
        eye = [out * np.cos(east), np.zeros_like(east), -out * np.sin(east)]
        eyes, rays = EYE + np.stack(eye, -1), np.stack(ray, -1)
        distance = np.array([thing.hit(eyes, rays) for thing in THINGS])
        length, first = distance.min(axis=0), distance.argmin(axis=0)
        point = eyes + length[..., None] * rays
        shown = np.array([thing.color(point) for thing in THINGS])
        color = np.take_along_axis(shown, first[None, ..., None], 0)[0]
        last, total = color, total + color
    return ((total - last) / RAYS**2).astype(np.float32), length


@pytest.fixture
def panorama(tmp_path, monkeypatch):
    """The working folder, with pano.exr and length.npy."""
    monkeypatch.chdir(tmp_path)
    color, length = traced(0.0, 2 * ROWS)
    write_image("pano.exr", color)
    np.save("length.npy", length)
    return ["stereo", "pano.exr", "length.npy", "--depth-kind", "z", "--refine", "none",
            "--no-fill", "--source-projection", "equirectangular", "--eyes", APART]  # fmt: skip


@pytest.mark.sweep
def test_each_column_of_a_stereo_panorama_is_seen_from_its_own_eye(panorama, record):
    size = ["--size", f"{2 * ROWS}x{ROWS}"]
    assert ended(*panorama, *size, "--layout", "top-bottom", "-o", "out.exr") == 0
    both = read_image("out.exr")
    assert both.shape == (2 * ROWS, 2 * ROWS, 4)
    made = {-0.5: both[:ROWS], 0.5: both[ROWS:]}  # the left eye's picture is on top
    between, _ = traced(0.0)
    for side, picture in made.items():
        truth, _ = traced(side * APART)
        whole = picture[..., 3] > 0.97
        record.error(f"pixels not covered at {side}", ~whole)
        record.quality(f"picture at {side}", psnr(picture[..., :3], truth, mask=whole))
        assert psnr(between, truth, mask=whole) < 40


def test_positions_of_a_stereo_panorama_lead_back(rng, record):
    eye, shape = StereoPanorama(right=0.3), (180, 360)
    place = rng.random((500, 2)) * (360, 180)
    nearness = 0.01 + 0.5 * rng.random(500)
    back, again = project(eye, shape, *unproject(eye, shape, place, nearness))
    apart = np.abs(back - place)
    # Latitudes are found in steps.
    record.error("largest, px", np.minimum(apart, 360 - apart).max())
    np.testing.assert_allclose(again, nearness, rtol=1e-6)


def test_points_between_the_eyes_are_not_seen():
    eye = StereoPanorama(right=0.3)
    place, _ = project(eye, (180, 360), np.array([0.1, 0.0, 0.1]), np.array(1.0))
    assert np.isnan(place).all()


def square(column, row, z=2.0, shape=(60, 80), focal=40.0):
    """Write c.exr, a white square of 4 px around a place on a black wall at z."""
    color = np.zeros((*shape, 3), np.float32)
    color[row - 2 : row + 2, column - 2 : column + 2] = 1
    write_image("c.exr", color)
    np.save("z.npy", np.full(shape, z, np.float32))
    camera = f"{focal},{focal},{shape[1] / 2},{shape[0] / 2}"
    return ["stereo", "c.exr", "z.npy", "--depth-kind", "z", "--intrinsics", camera]


def middle(picture):
    """Where the light of a picture is: x and y, px."""
    light = picture[..., 0].astype(float)
    y, x = np.mgrid[: light.shape[0], : light.shape[1]] + 0.5
    return np.array([(x * light).sum(), (y * light).sum()]) / light.sum()


@pytest.mark.sweep
@pytest.mark.parametrize("layout", ["vr180", "vr180-fisheye"])
@pytest.mark.parametrize(("made", "left"), [("right", 0.0), ("left", -0.4), ("both", -0.2)])
def test_vr180_shows_directions_ahead_of_each_eye(tmp_path, monkeypatch, made, left, layout):
    monkeypatch.chdir(tmp_path)
    words = [
        *square(60, 24),
        "--eye-distance",
        0.4,
        "--layout",
        layout,
        "--size",
        "180",
        "--eyes",
        made,
    ]
    assert ended(*words, "-o", "out.exr") == 0
    both = read_image("out.exr")
    assert both.shape == (180, 360, 3)
    x, y, z = (60 - 40) / 40 * 2.0, (24 - 30) / 40 * 2.0, 2.0
    for picture, at in ((both[:, :180], left), (both[:, 180:], left + 0.4)):
        right = x - at
        east = np.degrees(np.arctan2(right, z))
        north = np.degrees(np.arctan2(-y, np.hypot(right, z)))
        expected = 90 + east, 90 - north
        if layout == "vr180-fisheye":  # a degree from the axis is a pixel
            aside = np.hypot(right, y)
            angle = np.degrees(np.arctan2(aside, z))
            expected = 90 + angle * right / aside, 90 + angle * y / aside
        np.testing.assert_allclose(middle(picture), expected, atol=0.1)


def test_the_half_sphere_of_a_fisheye_fills_a_circle(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = square(40, 30)
    write_image("c.exr", np.ones((60, 80, 3), np.float32))
    words += ["--layout", "vr180-fisheye", "--size", "64", "-o", "out.png"]
    assert ended(*words) == 0
    left = read_image("out.png")[:, :64]
    assert left[32, 32].min() == 1
    assert left[:9, :9].max() == left[-9:, -9:].max() == 0


def test_vr180_of_a_lens_shows_straight_directions(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    lens = (-0.2, 0.05, 0.001, -0.002)
    words = [*square(64, 20)[:-2], "--lens", ",".join(map(str, (40, 40, 40, 30, *lens)))]
    words += ["--eyes", 0.4, "--layout", "vr180", "--size", "180", "-o", "out.exr"]
    assert ended(*words) == 0
    matrix = np.array([[40.0, 0, 40], [0, 40, 30], [0, 0, 1]])
    place = np.array([[[63.5, 19.5]]])  # OpenCV counts from the first pixel's center
    x, y = 2.0 * cv2.undistortPoints(place, matrix, np.array(lens)).ravel()
    east = np.degrees(np.arctan2(x - 0.4, 2.0))
    north = np.degrees(np.arctan2(-y, np.hypot(x - 0.4, 2.0)))
    right = read_image("out.exr")[:, 180:]
    np.testing.assert_allclose(middle(right), (90 + east, 90 - north), atol=0.2)


@pytest.mark.sweep
def test_vr180_is_black_beside_the_source(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = square(40, 30)
    write_image("c.exr", np.ones((60, 80, 3), np.float32))
    assert ended(*words, "--layout", "vr180", "--size", "64", "-o", "out.png") == 0
    both = read_image("out.png")
    assert both.shape == (64, 128, 3)
    assert both[:, :8].max() == both[:4].max() == 0
    assert both[32, 32].min() == 1


@pytest.mark.sweep
def test_vr180_of_a_panorama_is_its_middle(panorama, record):
    words = [*panorama, "--layout", "vr180", "--size", ROWS, "-o", "out.exr"]
    assert ended(*words) == 0
    both, (truth, _) = read_image("out.exr"), traced(0.0)
    first = both[:, :ROWS]
    ahead = truth[:, ROWS // 2 : -ROWS // 2]
    record.quality("picture", psnr(first[..., :3], ahead, mask=first[..., 3] > 0.97))


@pytest.mark.sweep
def test_panoramas_take_relative_depth(panorama):
    np.save("rel.npy", 1 / np.load("length.npy"))
    panorama[2], panorama[4] = "rel.npy", "relative"
    assert ended(*panorama, "--size", "32x16", "-o", "out.png") == 0
    assert read_image("out.png").shape == (16, 32, 4)


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--layout", "vr180", "--size", "64x32"], "each eye of vr180 has a square"),
        (
            ["--layout", "vr180", "--zero-plane", "2"],
            "--zero-plane, --divergence and --convergence belong to flat pictures",
        ),
        (["--size", "64"], "--size belongs to --layout vr180 or quilt and to panoramas"),
        (["--layout", "vr180", "--depth-kind", "pair"], "need depth, by --depth-kind"),
        (["--source-projection", "equirectangular", "--fov", "60"], "--fov is for a pinhole"),
    ],
)
def test_what_does_not_go_together_is_refused(tmp_path, monkeypatch, capsys, words, complaint):
    monkeypatch.chdir(tmp_path)
    given = square(40, 30)
    given = given[: -2 if "--source-projection" in words else None]
    given = given[:3] if "--depth-kind" in words else given
    assert complaint in refused(capsys, *given, *words, "-o", "out.png")
    assert not Path("out.png").exists()


@pytest.mark.parametrize(
    ("latitude", "share"),
    [(0.0, 1.0), (59.9, 1.0), (67.5, 0.5**0.5), (75.1, 0.0), (90.0, 0.0), (-67.5, 0.5**0.5)],
)
def test_eyes_join_between_two_latitudes(latitude, share):
    """The eye is on its circle up to 60 degrees, and in the middle from 75 degrees on."""
    up, along = np.sin(np.radians(latitude)), np.cos(np.radians(latitude))
    at = StereoPanorama(right=0.3).eye_of(np.array([[0.0, up, along], [along, up, 0.0]]))
    np.testing.assert_allclose(np.linalg.norm(at, axis=1), 0.3 * share, atol=1e-3)
