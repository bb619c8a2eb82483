"""Targets with lenses, of all directions and of parallel rays, against rays of their pixels."""

from functools import cache

import numpy as np
import pytest

from resample.cameras.models import Camera, Orthographic
from resample.cameras.pixels import Equirectangular, turn
from resample.measuring.quality import psnr
from resample_warp3d import SEAMLESS, mapping_between, panorama, render_together, warp
from resample_warp3d.types import Hole
from tests.warp3d.naive_sheet import ball, flat, pattern, plane
from tests.warp3d.naive_sights import traced

EYE = np.array([0.2, -0.1, 0.3])
ASIDE = EYE + np.array([0.15, 0.1, -0.1])
ROOM = [plane(axis, side, pattern(1.5)) for axis in np.eye(3) for side in (-3.0, 3.0)]
THINGS = [ball((0.3, 0.2, 2.2), 0.5, pattern(4.0)), *ROOM]
SHAPE = 96, 128
HEIGHT = 96


def pose(eye, yaw=0.0, pitch=0.0):
    placed = turn(yaw, pitch)
    placed[:3, 3] = -placed[:3, :3] @ eye
    return placed


def intrinsics(focal):
    return np.array([[focal, 0, 64], [0, focal, 48], [0, 0, 1.0]])


NEARBY = pose(EYE + np.array([0.1, 0.0, 0.05]), 0.05)
FISHEYE = Camera(intrinsics(60), NEARBY, np.array([0.02, -0.01, 0.003, 0.0]), model="fisheye")
TARGETS = {
    "pinhole": Camera.from_fov(60, *SHAPE, NEARBY),
    "lens": Camera(intrinsics(90), NEARBY, np.array([-0.2, 0.03, 0.001, -0.002, 0.0])),
    "fisheye": FISHEYE,
    "orthographic": Orthographic(50, 50, 64, 48, NEARBY),
    "equirectangular": Equirectangular(NEARBY),
}
SOURCES = {
    "pinhole": Camera.from_fov(70, *SHAPE, pose(EYE)),
    "fisheye": FISHEYE,
    "orthographic": Orthographic(60, 60, 64, 48, pose(np.array([0.1, 0.0, -1.0]), 0.1)),
}


@cache
def source(name):
    return traced(THINGS, SOURCES[name], SHAPE)


def size_of(camera):
    return (HEIGHT, 2 * HEIGHT) if isinstance(camera, Equirectangular) else SHAPE


def warped(name, target, **choices):
    choices = {"noise": 0.0, "refine": "none", "size": size_of(target)[::-1], **choices}
    return warp(*source(name), SOURCES[name], target, **choices)


@pytest.mark.sweep
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("name", SOURCES)
def test_all_cameras_see_what_rays_see(name, target, record):
    camera = TARGETS[target]
    made = warped(name, camera)
    color, depth = traced(THINGS, camera, size_of(camera))
    whole = made.coverage > 0.99
    assert whole.sum() > 400
    record.quality("picture", psnr(made.image, color, mask=whole))
    away = np.abs(np.log(made.depth / depth))[whole]
    record.error("depth", np.median(away))  # of the nearest part of a pixel
    assert (made.coverage <= 1.0 + 1e-6).all()


@pytest.mark.sweep
@pytest.mark.parametrize("name", ["pinhole", "orthographic"])
def test_what_is_beyond_the_source_is_outside(name, record):
    camera = TARGETS["fisheye"]
    made = warped(name, camera)
    _, depth = traced(THINGS, camera, SHAPE)
    columns, rows = np.meshgrid(np.arange(SHAPE[1]) + 0.5, np.arange(SHAPE[0]) + 0.5)
    at = np.stack([columns, rows], -1).reshape(-1, 2)
    back = mapping_between(SOURCES[name], TARGETS["fisheye"], SHAPE).back(at, 1 / depth.ravel())[0]
    inside = (back > 2).all(1) & (back[:, 0] < SHAPE[1] - 2) & (back[:, 1] < SHAPE[0] - 2)
    beyond = ~((back > -2).all(1) & (back[:, 0] < SHAPE[1] + 2) & (back[:, 1] < SHAPE[0] + 2))
    holes = made.holes.ravel()
    record.error("wrong causes beyond", holes[beyond] != Hole.OUTSIDE)  # by the depth beside a hole
    record.error("wrong causes inside", holes[inside] == Hole.OUTSIDE)


@pytest.mark.sweep
@pytest.mark.parametrize(
    "camera",
    [
        pytest.param(Equirectangular(pose(ASIDE, 0.0, 2.5)), id="upside down"),
        *(
            pytest.param(Equirectangular(pose(*way)), id=name, marks=pytest.mark.sweep)
            for name, *way in [
                ("the same", EYE),
                ("turned", ASIDE, 2.5),
                ("tilted", ASIDE, 0.0, 0.8),
            ]
        ),
    ],
)
def test_a_panorama_of_a_panorama_has_neither_seams_nor_poles(camera, record):
    shape = HEIGHT, 2 * HEIGHT
    eye = Equirectangular(pose(EYE))
    given = panorama(*traced(THINGS, eye, shape), eye.world_to_camera, noise=0.0, refine="none")
    made = render_together(given, camera, shape, joining=SEAMLESS).warped
    color, depth = traced(THINGS, camera, shape)
    whole = made.coverage > 0.97
    record.error("pixels not covered", ~whole)  # the rest is hidden
    record.quality(
        "picture", psnr(made.image, color, mask=whole)
    )  # rims of the ball, when the eye moves
    poles = np.zeros_like(whole)
    poles[:4] = poles[-4:] = True
    ends = np.zeros_like(whole)
    ends[:, :3] = ends[:, -3:] = True
    for name, part in (("poles", poles), ("ends", ends)):
        record.quality(name, psnr(made.image, color, mask=whole & part))
        assert made.coverage[part].min() > 0.95
    record.error("wrong depths", ~(np.abs(np.log(made.depth / depth))[whole] < 0.03))


@pytest.mark.sweep
def test_a_panorama_is_wrapped_without_a_step():
    """Turned by whole pixels, it is the same picture elsewhere."""
    shape = HEIGHT, 2 * HEIGHT
    first = warped("pinhole", Equirectangular(NEARBY))
    steps = 77
    yaw = -steps * np.pi / HEIGHT
    other = warped("pinhole", Equirectangular(turn(yaw, 0.0) @ NEARBY), size=shape[::-1])
    np.testing.assert_allclose(np.roll(first.image, steps, axis=1), other.image, atol=2e-4)
    np.testing.assert_allclose(np.roll(first.coverage, steps, axis=1), other.coverage, atol=2e-4)


@pytest.mark.sweep
def test_a_lens_that_does_nothing_changes_nothing():
    plain, camera = TARGETS["pinhole"], TARGETS["pinhole"]
    bent = Camera(camera.matrix, camera.world_to_camera, np.array([1e-12, 0, 0, 0]))
    first, second = warped("pinhole", plain), warped("pinhole", bent)
    np.testing.assert_allclose(first.image, second.image, atol=1e-4)
    np.testing.assert_allclose(first.coverage, second.coverage, atol=1e-4)
    assert (first.holes == second.holes).mean() > 0.999


@pytest.mark.sweep
@pytest.mark.parametrize(
    "target", ["equirectangular", pytest.param("fisheye", marks=pytest.mark.sweep)]
)
def test_filters_see_what_rays_see_under_them(target, record):
    camera = TARGETS[target]
    shape = size_of(camera)
    made = warped("pinhole", camera, filter="tent")
    fine = traced(THINGS, enlarged(camera), (4 * shape[0], 4 * shape[1]), count=1)[0]
    parts = (np.arange(8) + 0.5) / 4 - 1
    weight = (1 - np.abs(parts)) / (1 - np.abs(parts)).sum()
    padded = np.pad(fine, ((2, 2), (2, 2), (0, 0)), mode="edge")
    along = sum(w * padded[n : n + 4 * shape[0] : 4] for n, w in enumerate(weight))
    truth = sum(w * along[:, n : n + 4 * shape[1] : 4] for n, w in enumerate(weight))
    whole = made.coverage > 0.99
    record.quality("picture", psnr(made.image, truth.astype(np.float32), mask=whole))


def enlarged(camera):
    if isinstance(camera, Equirectangular):
        return camera
    return camera.resized((1, 1), (4, 4))


@pytest.mark.parametrize("target", ["lens", "equirectangular", "orthographic"])
def test_names_stay_names_whatever_sees_them(target):
    camera = SOURCES["pinhole"]
    _, depth = source("pinhole")
    names = (np.indices(SHAPE).sum(axis=0) // 7 % 3 + 1).astype(np.float32)
    target = TARGETS[target]
    from resample_warp3d import Hybrid

    made = warp(names, depth, camera, target, Hybrid(labels=True), size=size_of(target)[::-1])
    shown = made.coverage > 0
    value = made.image[..., 0][shown] / made.coverage[shown]
    np.testing.assert_allclose(value, np.rint(value), atol=1e-5)


@pytest.mark.sweep
def test_threads_change_no_bit():
    one, two = (warped("pinhole", TARGETS["equirectangular"], threads=n) for n in (1, 2))
    for first, second in zip(one, two, strict=True):
        np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("method", ["mesh", "paper", "mcmillan", "preview"])
def test_methods_of_the_equation_refuse_other_targets(method):
    with pytest.raises(ValueError, match="use the method hybrid"):
        warped("pinhole", TARGETS["fisheye"], method=method)


def test_a_panorama_of_another_shape_is_refused():
    with pytest.raises(ValueError, match="twice as wide as high, not 128 x 96 px"):
        warped("pinhole", TARGETS["equirectangular"], size=SHAPE[::-1])


def test_a_panorama_is_no_source_by_itself():
    with pytest.raises(ValueError, match=r"made by resample_warp3d\.panorama"):
        warp(*source("pinhole"), TARGETS["equirectangular"], SOURCES["pinhole"])


@pytest.mark.sweep
def test_far_away_parallel_depth_is_told_apart(record):
    """A box of 1 unit on the ground, from 5000 units above, as of a map."""
    ground = plane((0, 0, 1), 5001.0, pattern(0.2))
    box = plane((0, 0, 1), 5000.0, flat(1.0, 0.0, 0.0), lambda p: np.abs(p[..., :2]).max(-1) < 4)
    camera = Orthographic(4.0, 4.0, 64.0, 48.0)
    color, depth = traced([box, ground], camera, SHAPE)
    ahead = turn(0.0, 0.3)[2, :3]
    target = Orthographic(4.0, 4.0, 64.0, 48.0, pose((0.0, 0.0, 5000.0) - 100 * ahead, 0.0, 0.3))
    made = warp(color, depth, camera, target, noise=0.0, refine="none")
    truth, far = traced([box, ground], target, SHAPE)
    whole = made.coverage > 0.99
    assert whole.mean() > 0.9
    record.quality("picture", psnr(made.image, truth, mask=whole))  # the box ends half a px away
    np.testing.assert_allclose(np.median((made.depth - far)[whole]), 0.0, atol=0.1)
