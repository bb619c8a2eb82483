"""All applications' scenes share previews, picking and cancellation."""

from contextlib import contextmanager

import numpy as np
import pytest

from resample import Cancel, CancelledError, cancellable
from resample.cameras.models import Camera
from resample.progress import watched_cancel
from resample.scene import AnyScene, lines_of, pixel_at, place_at, preview_size
from resample_points import Cloud, CloudScene, render_cloud
from resample_texture import PictureScene
from resample_volume import Scene
from resample_warp3d import DepthScene

CAMERA = Camera.from_fov(60, 30, 40)
SIZE = (40, 30)


class Numbers(AnyScene):
    """Pictures of one number, which record how they were asked for."""

    def __init__(self):
        self.asked = []

    def render(self, number, *, size=SIZE, quality="final", cancel=None):
        with self._rendering(quality, cancel) as is_preview:
            self.asked.append((number, size, is_preview))
            if watched_cancel().is_cancelled:
                raise CancelledError
            return -number if is_preview else number

    def sample_ids(self, number):
        ids = np.full((30, 40, 2), -1)
        ids[4, 7] = number, 2 * number
        return ids


def plane():
    """Points of the plane z = 3."""
    x, y = np.meshgrid(np.linspace(-3, 3, 60), np.linspace(-3, 3, 60))
    place = np.stack([x, y, np.full_like(x, 3.0)], axis=2).reshape(-1, 3)
    return Cloud(place, np.empty((0, 3)), np.ones((3600, 3)), np.empty(0))


def scenes():
    y, x = np.indices((30, 40))
    picture = np.stack([5 * x, 7 * y, 2 * (x + y)], axis=2).astype(np.uint8)
    ramp = np.indices((24, 24, 24), np.uint8).sum(axis=0).astype(np.uint8)
    return {
        "cloud": (CloudScene(plane()), (CAMERA,)),
        "depth": (DepthScene(picture, np.full((30, 40), 2.0), CAMERA), (CAMERA,)),
        "picture": (PictureScene(picture), ([[1, 0.01, 0], [0, 1.02, 0]],)),
        "volume": (Scene(ramp), ("gray", (30, 20))),
    }


@pytest.fixture(scope="module", params=["cloud", "depth", "picture", "volume"])
def scene(request):
    return scenes()[request.param]


def test_a_preview_comes_before_the_picture():
    scene = Numbers()
    assert list(scene.finer(3)) == [-3, 3]
    scene.prepare(4)
    assert scene.asked == [(3, SIZE, True), (3, SIZE, False), (4, (16, 16), False)]


@pytest.mark.some(3)
def test_an_unknown_quality_is_refused(scene):
    seen, view = scene
    with pytest.raises(ValueError, match="it can be final or preview"):
        seen.render(*view, size=SIZE, quality="best")


def test_what_is_seen_at_a_point_is_an_index_or_none():
    assert Numbers().pick(7.9, 4.1, 3) == (3, 6)
    assert Numbers().pick(8, 4, 3) is None


def test_positions_beyond_the_edge_are_of_the_last_pixel():
    assert pixel_at(SIZE, 40.0, 30.0) == (29, 39)
    assert preview_size((41, 30)) == (21, 15)


@pytest.mark.parametrize("way", ["scene", "given", "around"])
def test_a_scene_stops_for_itself_and_for_whoever_asks(way):
    scene, given, around = Numbers(), Cancel(), Cancel()

    class Stopped(Numbers):
        def __init__(self):
            super().__init__()
            self.stop = {"scene": self.cancel, "given": given.cancel, "around": around.cancel}[way]

        def render(self, _number, *, cancel=None):
            with self._rendering("final", cancel):
                self.stop()
                return watched_cancel().is_cancelled

    with cancellable(around):
        assert Stopped().render(1, cancel=given if way == "given" else None)
    assert scene.render(1) == 1
    assert given.is_cancelled == (way == "given")  # what is given is not the scene's to set


@pytest.mark.sweep
def test_cancelling_stops_the_pictures_that_are_begun_and_no_later_one(scene, monkeypatch):
    seen, view = scene
    entered = seen._rendering

    @contextmanager
    def begun(*words):
        with entered(*words) as is_preview:
            seen.cancel()  # as from another thread
            yield is_preview

    with monkeypatch.context() as patched:
        patched.setattr(seen, "_rendering", begun)
        with pytest.raises(CancelledError):
            seen.render(*view, size=(400, 300))
    seen.render(*view, size=SIZE)


@pytest.mark.some(2)
def test_previews_have_the_size_of_pictures(scene):
    seen, view = scene
    quick, whole = seen.preview(*view, size=(41, 30)), seen.render(*view, size=(41, 30))
    parts = [getattr(one, "rgba", getattr(one, "image", None)) for one in (quick, whole)]
    assert parts[0].shape == parts[1].shape
    assert np.abs(np.float64(parts[0]) - parts[1]).mean() < 0.1 * np.ptp(parts[1])


def test_pictures_and_depth_images_tell_their_sample():
    known = scenes()
    for name in ("picture", "depth"):
        seen, view = known[name]
        assert seen.pick(7.5, 4.5, *view, size=SIZE) == (4, 7)


def test_a_cloud_has_the_bits_of_a_call_and_tells_its_place():
    seen, _ = scenes()["cloud"]
    frame = seen.render(CAMERA, size=SIZE)
    np.testing.assert_array_equal(frame.rgba, render_cloud(plane(), CAMERA, size=SIZE).rgba)
    assert not frame.statistics.is_preview
    assert seen.preview(CAMERA, size=SIZE).statistics.is_preview
    found = seen.pick(30.5, 10.5, CAMERA, size=SIZE)
    assert found.depth == pytest.approx(3, rel=1e-6)
    u, v = CAMERA.fx * found.position[0] / 3, CAMERA.fy * found.position[1] / 3
    assert (u + CAMERA.cx, v + CAMERA.cy) == pytest.approx((30.5, 10.5), abs=1e-4)
    assert seen.pick(0.5, 0.5, Camera.from_fov(140, 30, 40), size=SIZE) is None


def test_lines_and_places_agree():
    eye = Camera.from_fov(50, 30, 40).moved(np.diag([1.0, -1.0, -1.0, 1.0]))
    start, step = lines_of(eye.view(), np.array([[3.5, 8.5]]))
    np.testing.assert_allclose(place_at(eye, 3.5, 8.5, 2.0), (start + 2 * step)[0], atol=1e-12)
    assert place_at(eye, 3.5, 8.5, np.inf) is None
