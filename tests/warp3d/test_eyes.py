"""Two eyes for a depth image: how far apart they are by default."""

from types import SimpleNamespace

import numpy as np
import pytest

from resample_warp3d.command import stereo
from resample_warp3d.command.parallax import Parallax
from resample_warp3d.command.stereo import Eyes, StereoRendering

WIDTH, FOCAL = 200, 150.0
USUAL = Parallax.usual()


def taken(nearness):
    """An image whose nearness all lies in two groups, but for some strays."""
    pinhole = SimpleNamespace(matrix=np.diag([FOCAL, FOCAL, 1.0]))
    known = np.repeat(np.array(nearness, np.float32), 500)
    image = SimpleNamespace(nearness=known)
    return [
        SimpleNamespace(views=[SimpleNamespace(shape=(10, WIDTH), pinhole=pinhole, image=image)])
    ]


@pytest.mark.parametrize(("far", "middle", "near"), [(0.1, 0.2, 0.5), (0.1, 0.4, 0.5)])
def test_a_flat_picture_has_a_parallax_of_1_5_percent_of_its_width_at_most(far, middle, near):
    """On the side of the screen where it is larger; the screen is in the middle."""
    found = Eyes.of(taken([far, middle, near]), USUAL)
    assert found.zero == pytest.approx(middle)
    assert found.gain * max(near - middle, middle - far) == pytest.approx(0.015 * WIDTH)
    assert found.apart == pytest.approx(found.gain / FOCAL)


def test_eyes_and_screen_are_where_they_are_asked_for():
    found = Eyes.of(taken([0.1, 0.2, 0.5]), Parallax(eyes=0.06, zero_plane=4.0))
    assert (found.gain, found.zero, found.apart) == pytest.approx((0.06 * FOCAL, 0.25, 0.06))


@pytest.mark.parametrize(
    ("far", "near", "range_"), [(0.1, 0.5, 0.4), (0.0, 1.0, 1.0), (0.4, 0.5, 0.25)]
)
def test_pictures_of_directions_have_a_parallax_of_two_degrees(monkeypatch, far, near, range_):
    """From the nearest things to the farthest, or to twice the distance of the nearest."""
    monkeypatch.setattr(stereo, "_lengths", lambda _: 1.0)
    monkeypatch.setattr(stereo, "_known", lambda *_: np.repeat([far, near], 500))
    found = Eyes.around(taken([1.0]), USUAL)
    assert found.apart * range_ == pytest.approx(np.radians(2.0))
    assert Eyes.around(taken([1.0]), Parallax(eyes=0.06)).apart == 0.06


def test_parallax_is_told_in_px_and_degrees(monkeypatch):
    told = []
    monkeypatch.setattr(stereo, "say", told.append)
    Eyes.of(taken([0.1, 0.2, 0.5]), Parallax(eyes=0.1, zero_plane=5.0))
    monkeypatch.setattr(stereo, "_lengths", lambda _: 1.0)
    monkeypatch.setattr(stereo, "_known", lambda *_: np.repeat([0.1, 0.5], 500))
    Eyes.around(taken([1.0]), Parallax(eyes=0.1))
    assert told == [
        "the eyes are 0.1 apart, the screen is 5 away: parallax from -1.5 to 4.5 px, "
        "-0.50 to 1.49 degrees where the picture is 60 degrees wide; comfortable are 3.0 px, "
        "1 degree; that tires eyes",
        "the eyes are 0.1 apart: parallax from 0.57 to 2.86 degrees",
    ]


@pytest.mark.parametrize("places", [(-1.0, 0.0), (0.0, 1.0), (-0.5, 0.5)])
def test_the_eyes_of_a_panorama_are_on_both_sides_of_the_head(places):
    """Those of half a sphere are where they are from the source."""
    pose = np.eye(4)
    source = SimpleNamespace(camera=SimpleNamespace(world_to_camera=pose))
    apart, asked = Eyes(0.0, 0.0, 0.06), SimpleNamespace(positions=places)
    first, second = StereoRendering._targets(asked, source, apart, "top-bottom", 64)
    assert (first.right, second.right) == pytest.approx((-0.03, 0.03))
    first, second = StereoRendering._targets(asked, source, apart, "vr180", 64)
    for camera, place in zip((first, second), places, strict=True):
        at = np.linalg.inv(camera.world_to_camera)[:3, 3]
        np.testing.assert_allclose(at, [0.06 * place, 0, 0], atol=1e-12)
