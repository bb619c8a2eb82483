"""Particles beside line integrals through each of them, and what is refused."""

import numpy as np
import pytest

from resample import Camera, Orthographic, Primitive, particles
from resample.profiles.reconstruction import BSplineKernel, GaussianKernel
from tests import naive
from tests.samples import painter

SIDE = 24
SIZE = {"height": SIDE, "width": SIDE}
POSE = np.array([[0.8, 0, 0.6, 0.5], [0, 1, 0, -0.2], [-0.6, 0, 0.8, 1.0], [0, 0, 0, 1]])
CAMERA = Camera.from_intrinsics(20.0, 24.0, 12.3, 11.6, POSE)
PARALLEL = Orthographic(4.0, 4.4, 12.3, 11.6, POSE)
MORE = pytest.mark.sweep
KERNELS = [GaussianKernel(), pytest.param(BSplineKernel(), marks=MORE)]


def spheres(count=40):
    """Places around the view's axis, colors, opacities and radii from 1 px to 13 px."""
    rng = np.random.default_rng(6)
    place = rng.uniform([-2, -2, 4], [2, 2, 9], (count, 3))
    position = (place - POSE[:3, 3]) @ POSE[:3, :3]
    opacity, radius = rng.uniform(0, 0.7, count), np.exp(rng.uniform(-0.7, 1, count))
    return position, rng.uniform(0, 1, (count, 3)), opacity, radius


@pytest.mark.sweep
@pytest.mark.parametrize("camera", [CAMERA, PARALLEL], ids=["perspective", "parallel"])
@pytest.mark.parametrize("kernel", KERNELS)
def test_a_radius_each_is_painted_as_line_integrals_say_nearest_first(kernel, camera):
    position, color, opacity, radius = spheres()
    resampler = painter(primitive=Primitive.SPLATS, reconstruction=kernel)
    samples = particles(position, color, opacity, radius, reconstruction=kernel)
    # Opacity (N, SIDE, SIDE) of spheres by the line integrals of each, with its own radius
    result = []
    for place, share, size in zip(position, opacity, radius, strict=True):
        shape = size / kernel.radius * np.eye(3)
        center = naive.in_camera(camera, place[None])[0]
        ahead = Camera.from_intrinsics(1.0, 1.0, 0.5, 0.5)  # whose only pixel looks at the center
        through = naive.line_integrals(
            ahead, np.array([0, 0, 100 * size]), shape, kernel, height=1, width=1
        )[0, 0]
        integral = naive.line_integrals(camera, center, shape, kernel, **SIZE)
        result.append(-np.expm1(np.log1p(-share) * integral / through))
    alpha = np.array(result)
    truth = naive.composite(alpha, color, naive.in_camera(camera, position)[:, 2])
    assert truth[..., 3].max() > 0.8
    picture = resampler(samples, camera, **SIZE).rgba
    np.testing.assert_allclose(picture, truth, atol=1e-4)  # painters stop at 1e-4 of the light


@pytest.mark.sweep
def test_neither_order_nor_threads_change_a_bit():
    given = spheres(500)
    order = np.random.default_rng(2).permutation(500)
    one = painter()(particles(*given), CAMERA, threads=1, **SIZE)
    two = painter()(particles(*(part[order] for part in given)), CAMERA, threads=2, **SIZE)
    for first, second in zip(one[:4], two[:4], strict=True):
        np.testing.assert_array_equal(first, second)


def test_one_radius_is_that_of_each():
    position, color, opacity, _ = spheres()
    each = np.full(len(position), 0.8)
    for given, expected in zip(
        particles(position, color, opacity, 0.8), particles(position, color, opacity, each),
        strict=True,
    ):  # fmt: skip
        np.testing.assert_array_equal(given, expected)


def test_no_particles_take_no_light():
    nothing = particles(np.zeros((0, 3)), [1, 1, 1], 0.5, 1.0)
    assert nothing.position.shape == (0, 3)
    assert not painter()(nothing, CAMERA, height=4, width=5).rgba.any()


def test_particles_far_away_or_behind_take_no_light():
    far = [[0, 0, 1e12], [1e12, 0, 1e6], [0, 0, -1e12]]
    samples = particles(far, [1, 1, 1], 0.5, [1e-3, 1e-4, 1e-2])
    assert not painter()(samples, CAMERA, height=4, width=5).rgba.max() > 1e-6


@pytest.mark.sweep
def test_radii_may_differ_by_many_powers_of_ten():
    """The smallest take no light, and the largest fills the picture."""
    position = np.array([[0, 0, 4.0], [0.5, 0, 5], [0, 0, 8e6]]) @ POSE[:3, :3]
    samples = particles(position, np.eye(3), [0.9, 0.9, 0.9], [1e-9, 0.3, 6e6])
    frame = painter()(samples, CAMERA, **SIZE)
    assert np.isfinite(frame.rgba).all()
    assert frame.rgba[..., 0].max() < 1e-6
    assert frame.rgba[..., 1].max() > 0.5
    assert frame.rgba[..., 2].max() > 0.5


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"position": np.zeros((3, 2))}, r"positions are \(N, 3\)"),
        ({"position": np.full((3, 3), np.nan)}, "position is not finite"),
        ({"color": [1, 1]}, "do not fit"),
        ({"opacity": 1.0}, "below 1"),
        ({"opacity": [0.1, 0.2]}, "opacity is one finite number or 3"),
        ({"radius": [1, 2]}, "radius is one finite number or 3"),
        ({"radius": [1, 2, 0]}, "above 0"),
        ({"radius": -1}, "above 0"),
        ({"radius": np.inf}, "radius is one finite number or 3"),
        ({"radius": [1e-45, 1e-45, 1e300]}, "finite|choose another unit"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(changes, message):
    given = {"position": np.ones((3, 3)), "color": [1, 1, 1], "opacity": 0.5, "radius": 1.0}
    with pytest.raises(ValueError, match=message) as refused:
        particles(**{**given, **changes})
    assert "\n" not in str(refused.value)
