"""Particles beside line integrals through each of them, and what is refused."""

import numpy as np
import pytest

from resample import Camera, Orthographic, Primitive, Resampler, absorbed, particles
from resample.profiles.reconstruction import BSplineKernel, GaussianKernel
from tests import naive

SIDE = 24
POSE = np.array([[0.8, 0, 0.6, 0.5], [0, 1, 0, -0.2], [-0.6, 0, 0.8, 1.0], [0, 0, 0, 1]])
CAMERA = Camera.from_intrinsics(20.0, 24.0, 12.3, 11.6, POSE)
KERNELS = [GaussianKernel(), BSplineKernel()]


def spheres(count=40):
    """Places around the view's axis, opacities and radii from 1 px to 13 px."""
    rng = np.random.default_rng(6)
    seen = rng.uniform([-2, -2, 4], [2, 2, 9], (count, 3))
    position = (seen - POSE[:3, 3]) @ POSE[:3, :3]
    return position, rng.uniform(0, 0.7, count), np.exp(rng.uniform(-0.7, 1, count))


def taken(position, opacity, radius, camera, kernel):
    """Opacity (SIDE, SIDE) of spheres by the line integrals of each, with its own radius."""
    depth = np.zeros((SIDE, SIDE))
    for place, share, size in zip(position, opacity, radius, strict=True):
        shape = size / kernel.radius * np.eye(3)
        center = naive.in_camera(camera, place[None])[0]
        ahead = Camera.from_intrinsics(1.0, 1.0, 0.5, 0.5)  # whose only pixel looks at the center
        through = naive.line_integrals(
            ahead, np.array([0, 0, 100 * size]), shape, kernel, height=1, width=1
        )[0, 0]
        integral = naive.line_integrals(camera, center, shape, kernel, height=SIDE, width=SIDE)
        depth += -np.log1p(-share) * integral / through
    return 1 - np.exp(-depth)


@pytest.mark.parametrize("kernel", KERNELS)
def test_a_radius_each_is_painted_as_line_integrals_say(kernel):
    given = spheres()
    resampler = Resampler(primitive=Primitive.SPLATS, reconstruction=kernel)
    picture = absorbed(*given, CAMERA, size=(SIDE, SIDE), resampler=resampler)
    truth = taken(*given, CAMERA, kernel)
    assert truth.max() > 0.8
    np.testing.assert_allclose(picture, truth, atol=1e-4)  # painters stop at 1e-4 of the light


def test_neither_order_nor_threads_change_a_bit():
    position, opacity, radius = spheres(500)
    order = np.random.default_rng(2).permutation(500)
    one = absorbed(position, opacity, radius, CAMERA, size=(SIDE, SIDE), threads=1)
    two = absorbed(
        position[order], opacity[order], radius[order], CAMERA, size=(SIDE, SIDE), threads=2
    )
    np.testing.assert_array_equal(one, two)


def test_particles_of_one_radius_take_as_much_as_those_of_a_radius_each():
    position, opacity, _ = spheres()
    together = particles(position, [0.2, 0.5, 0.9], opacity, 0.8)
    frame = Resampler(primitive=Primitive.SPLATS)(together, CAMERA, height=SIDE, width=SIDE)
    each = absorbed(
        position, opacity, 0.8, CAMERA, size=(SIDE, SIDE),
        resampler=Resampler(primitive=Primitive.SPLATS),
    )  # fmt: skip
    np.testing.assert_allclose(frame.rgba[..., 3], each, atol=1e-4)
    np.testing.assert_allclose(frame.rgba[..., 2], 0.9 * each, atol=1e-4)


def test_no_particles_take_no_light():
    assert not absorbed(np.zeros((0, 3)), 0.5, 1.0, CAMERA, size=(4, 5)).any()
    assert particles(np.zeros((0, 3)), [1, 1, 1], 0.5, 1.0).position.shape == (0, 3)


def test_particles_far_away_or_behind_take_no_light():
    far = [[0, 0, 1e12], [1e12, 0, 1e6], [0, 0, -1e12]]
    assert not absorbed(far, 0.5, 1e-3, CAMERA, size=(4, 5)).max() > 1e-6


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"position": np.zeros((3, 2))}, r"positions are \(N, 3\)"),
        ({"position": np.full((3, 3), np.nan)}, "position is not finite"),
        ({"opacity": 1.0}, "below 1"),
        ({"opacity": [0.1, 0.2]}, "opacity is one finite number or 3"),
        ({"radius": [1, 2]}, "radius is one finite number or 3"),
        ({"radius": [1, 2, 0]}, "above 0"),
        ({"camera": Orthographic(1.0, 1.0, 0.0, 0.0)}, "camera in perspective"),
        ({"camera": Camera.from_intrinsics(1.0, 1.0, 0, 0, near=0.1)}, "near plane at 0"),
        ({"size": (0, 4)}, "at least 1"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(changes, message):
    given = {"position": np.ones((3, 3)), "opacity": 0.5, "radius": 1.0, "camera": CAMERA}
    with pytest.raises(ValueError, match=message) as refused:
        absorbed(**{"size": (4, 4), **given, **changes})
    assert "\n" not in str(refused.value)


def test_colors_share_one_radius():
    with pytest.raises(ValueError, match="share one radius"):
        particles(np.ones((2, 3)), [1, 1, 1], 0.5, [1.0, 2.0])
