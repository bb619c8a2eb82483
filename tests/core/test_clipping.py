"""Clipping planes cut the reconstructed field exactly along every ray."""

import numpy as np
import pytest

from resample.cameras.models import Camera
from resample.cameras.poses import look_at
from resample.painting.choices import Primitive
from resample.profiles.orders import EverySample
from resample.profiles.reconstruction import GaussianKernel
from resample.types import Samples
from resample_comparisons.volume.painting import AxisSheets, ImageSheets
from tests import naive
from tests.bits import assert_same
from tests.samples import CAMERAS as SEEN
from tests.samples import EYE, POSE, SIDE, block, cloud, painter, reordered, shuffled

CAMERAS = {
    **SEEN,
    "near plane": Camera.from_fov(40.0, height=SIDE, width=SIDE, world_to_camera=POSE, near=8.4),
}


def through(point, normal):
    """Plane with that normal through a point."""
    normal = np.asarray(normal, float)
    return (*normal, -normal @ np.asarray(point, float))


PLANES = {
    "oblique": [(0.3, 0.8, -0.2, 0.1)],
    "not of length 1": [(30.0, 80.0, -20.0, 10.0)],
    "facing the eye": [(-6.0, 5.0, -4.0, 0.5)],
    "away from the eye": [(6.0, -5.0, 4.0, 0.5)],
    "through the eye": [through(EYE, (0.5, 0.5, -0.1))],
    "a slice": [(1.0, 0.0, 0.0, 0.4), (-1.0, 0.0, 0.0, 0.3)],
    "a corner": [(1.0, 0, 0, 0.2), (0, -1.0, 0, 0.3), (0, 0.2, 1.0, 0.4)],
    "nothing left": [(1.0, 0.0, 0.0, -0.3), (-1.0, 0.0, 0.0, -0.3)],
}
ORDERS = [EverySample(), AxisSheets(), ImageSheets(0.7)]
IN_ORDERS = [  # others composite every sample
    (form, order)
    for form in Primitive
    for order in (ORDERS if form in (Primitive.HYBRID, Primitive.SPLATS) else ORDERS[:1])
]
BY_CENTER = (Primitive.POINTS, Primitive.PAPER, Primitive.INFLATE, Primitive.EWA)
MIRRORED = look_at((1, 2, 3), (0, 0, 0))[:3, :3] @ np.diag([0.8, -1.2, 1.0])


def draw(samples, camera, clip=None, *, side=SIDE, **choices):
    choices = {"primitive": Primitive.SPLATS, **choices}
    return painter(**choices)(samples, camera, height=side, width=side, clip=clip)


# Exactly.


@pytest.mark.sweep
@pytest.mark.parametrize("planes", PLANES.values(), ids=PLANES)
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_transmittance_is_that_of_the_part_of_the_ray_that_is_kept(planes, camera, rng):
    samples = cloud(rng, lattice=MIRRORED)
    integral = naive.all_line_integrals(
        samples,
        camera,
        GaussianKernel(),
        height=SIDE,
        width=SIDE,
        between=naive.kept_by(camera, planes, height=SIDE, width=SIDE),
    )
    truth = np.exp(-(integral * samples.extinction[:, None, None]).sum(axis=0))
    drawn = 1 - draw(samples, camera, planes).rgba[..., 3]
    # Opaque from 1e-4 on; table of 256 × 256 steps.
    np.testing.assert_allclose(drawn, truth, atol=1e-4)


def test_parts_on_either_side_of_a_plane_make_the_whole(rng):
    samples, camera = cloud(rng), CAMERAS["narrow"]
    plane = np.array(PLANES["oblique"][0])
    parts = [
        1 - draw(samples, camera, [side]).rgba[..., 3].astype(float) for side in (plane, -plane)
    ]
    whole = 1 - draw(samples, camera).rgba[..., 3]
    np.testing.assert_allclose(parts[0] * parts[1], whole, atol=1e-4)  # as above


@pytest.mark.some(3)
@pytest.mark.parametrize(("primitive", "order"), IN_ORDERS, ids=str)
@pytest.mark.parametrize("camera", ["narrow", "inside", "parallel"])
def test_planes_that_remove_nothing_change_no_bit(camera, primitive, order, rng):
    samples, camera = cloud(rng, 200), CAMERAS[camera]
    beyond = [(*axis, 12.0) for sign in (-1, 1) for axis in sign * np.eye(3)]
    chosen = {"primitive": primitive, "order": order, "side": 24}
    whole, clipped = draw(samples, camera, **chosen), draw(samples, camera, beyond, **chosen)
    assert_same(whole, clipped)


@pytest.mark.some(14)
@pytest.mark.parametrize(("primitive", "order"), IN_ORDERS, ids=str)
def test_planes_that_remove_all_leave_nothing(primitive, order, rng):
    frame = draw(cloud(rng), CAMERAS["narrow"], [(0, 0, 1, -9)], primitive=primitive, order=order)
    assert not frame.rgba.any()
    assert not frame.coverage.any()
    assert np.isinf(frame.depth).all()


@pytest.mark.some(4)
@pytest.mark.parametrize("planes", PLANES.values(), ids=PLANES)
@pytest.mark.parametrize(
    ("primitive", "order"),
    [*((form, ORDERS[0]) for form in BY_CENTER), (Primitive.HYBRID, ImageSheets(0.7))],
    ids=str,
)
def test_others_leave_out_the_samples_whose_centers_are_cut_away(primitive, order, planes, rng):
    samples, camera = cloud(rng, 200, lattice=MIRRORED), CAMERAS["narrow"]
    given = np.array(planes)
    away = samples.position.astype(float) @ given[:, :3].T + given[:, 3]
    kept = reordered(samples, np.flatnonzero((away > 0).all(axis=1)))
    chosen = {"primitive": primitive, "order": order, "subpixels": 1}
    cut, rest = draw(samples, camera, planes, **chosen), draw(kept, camera, **chosen)
    np.testing.assert_allclose(cut.rgba, rest.rgba, atol=1e-6)


# Minified.


@pytest.mark.some(1)
@pytest.mark.parametrize("scale", [0.4, 0.12, 0.035])
def test_a_minified_block_is_cut_where_its_supersampled_splats_are(scale):
    samples = block(21, 0.05)
    camera = Camera.from_intrinsics(
        90 * scale, 90 * scale, 8.13, 8.21, look_at((70, -50, 30), (0, 0, 0))
    )
    planes = [(0.3, -0.9, 0.2, 2.3), (-0.7, 0.1, 0.5, 6.1)]
    truth = draw(samples, camera, planes, subpixels=16).rgba[..., 3]
    hybrid = draw(samples, camera, planes, primitive=Primitive.HYBRID)
    assert truth.max() > 0.05
    # Points are kept or left out as wholes: half a voxel is 2.5 % of the optical depth.
    np.testing.assert_allclose(hybrid.rgba[..., 3], truth, atol=0.05 * truth.max())


def test_a_near_plane_through_a_minified_block_does_as_a_clipping_plane():
    samples, pose = block(13, 0.08), look_at((0, -80, 0), (0, 0, 0))
    near = Camera.from_intrinsics(15.0, 15.0, 8.13, 8.21, pose, near=78.2)
    plain = Camera.from_intrinsics(15.0, 15.0, 8.13, 8.21, pose)
    chosen = {"primitive": Primitive.HYBRID}
    cut = draw(samples, near, **chosen).rgba[..., 3]
    clipped = draw(samples, plain, [(0, 1, 0, 1.8)], **chosen).rgba[..., 3]
    assert 0.2 < clipped.max() < 0.6
    np.testing.assert_allclose(cut, clipped, atol=0.02)  # points are kept as wholes


# Bits.


@pytest.mark.some(2)
@pytest.mark.parametrize(("primitive", "order"), IN_ORDERS, ids=str)
def test_neither_threads_nor_the_order_of_samples_change_a_bit(primitive, order, rng):
    samples, planes = cloud(rng, 300, 0.5 * np.eye(3)), np.array(PLANES["a corner"])
    other = shuffled(samples, rng)
    resample = painter(primitive=primitive, order=order)
    for camera in (
        CAMERAS["narrow"],
        CAMERAS["inside"],
        Camera.from_intrinsics(3.0, 3.0, 20, 20, POSE),
    ):
        size = {"height": 40, "width": 40}
        first = resample(samples, camera, **size, threads=1, clip=planes)
        second = resample(other, camera, **size, threads=2, clip=planes[::-1])
        assert_same(first, second)


# What is refused.


@pytest.mark.parametrize(
    "wrong",
    [
        (1.0, 0.0, 0.0),
        (1.0, 0.0, 0.0, 0.0, 1.0),
        np.ones((4, 3)),
        np.ones((2, 2)),
        np.ones((2, 1, 4)),
        [(0.0, 0.0, 0.0, 1.0)],
        [(np.nan, 0.0, 1.0, 1.0)],
        [(0.0, 0.0, 1.0, np.inf)],
    ],
    ids=str,
)
def test_what_are_no_planes_is_refused_in_one_line(wrong, rng):
    with pytest.raises(ValueError, match="clipping planes are") as raised:
        draw(cloud(rng), CAMERAS["narrow"], wrong)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("planes", [None, [], np.zeros((0, 4))])
def test_no_planes_cut_nothing(planes, rng):
    samples, camera = cloud(rng), CAMERAS["narrow"]
    assert draw(samples, camera, planes).rgba.tobytes() == draw(samples, camera).rgba.tobytes()


@pytest.mark.parametrize("depth", [3.9, 4.0, 4.1])
def test_the_paper_s_form_shows_voxels_whose_centers_lie_behind_all_planes(depth):
    """Those on the near plane or on a clipping plane are not shown."""
    samples = Samples(*(np.array([row], np.float32) for row in ((0, 0, depth), (1, 1, 1))),
                      np.ones(1, np.float32), np.eye(3))  # fmt: skip
    for near, planes in ((4.0, None), (1e-3, [(0.0, 0.0, 1.0, -4.0)])):
        camera = Camera.from_intrinsics(9.0, 9.0, 8.0, 8.0, np.eye(4), near)
        seen = draw(samples, camera, planes, primitive=Primitive.PAPER).coverage.any()
        assert seen == (depth > 4.0)
