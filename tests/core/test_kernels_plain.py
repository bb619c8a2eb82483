"""A few pictures so small that kernels can paint them as plain Python (NUMBA_DISABLE_JIT=1)."""

import numpy as np
import pytest

from resample.cameras.models import Camera, Orthographic
from resample.painting.choices import Opacity, Primitive, footprints_of
from resample.profiles.reconstruction import GaussianKernel
from resample.types import Samples
from tests import naive
from tests.samples import painter

SIDE = 8  # px


def two(spacing=1.0):
    return Samples(
        np.array([(0.3, -0.2, 6.0), (-0.4, 0.1, 7.0)], np.float32),
        np.array([(1.0, 0.5, 0.0), (0.0, 0.5, 1.0)], np.float32),
        np.array([1.0, 2.0], np.float32),
        spacing * np.eye(3),
    )


def draw(samples, camera, **choices):
    return painter(**choices)(samples, camera, height=SIDE, width=SIDE)


@pytest.mark.parametrize(
    "camera", [Camera.from_intrinsics(8.0, 8.0, 4.1, 3.9), Orthographic(1.5, 1.5, 4.1, 3.9)]
)
def test_splats_are_the_kernels_along_the_rays(camera):
    samples = two()
    frame = draw(samples, camera, primitive=Primitive.SPLATS)
    kernel = GaussianKernel()
    integral = naive.all_line_integrals(samples, camera, kernel, height=SIDE, width=SIDE)
    alpha = 1 - np.exp(-integral * samples.extinction[:, None, None])
    truth = naive.composite(alpha, samples.color, samples.position[:, 2])
    np.testing.assert_allclose(frame.rgba, truth, atol=1e-5)  # tables of 1024 steps


@pytest.mark.parametrize("primitive", [Primitive.HYBRID, Primitive.SPLATS])
def test_samples_of_a_size_each_are_those_of_a_lattice_that_wide(primitive):
    camera, scale = Camera.from_intrinsics(8.0, 8.0, 4.1, 3.9, near=6.5), np.array([0.5, 0.5])
    samples = two()._replace(extinction=np.array([0.001, 0.002], np.float32))
    frame = draw(samples._replace(scale=scale), camera, primitive=primitive)
    other = draw(samples._replace(lattice=0.5 * samples.lattice), camera, primitive=primitive)
    np.testing.assert_allclose(frame.rgba, other.rgba, rtol=2e-3, atol=1e-8)
    assert frame.rgba.max() > 1e-4


def test_a_sphere_around_the_eye_is_integrated_from_the_eye_on():
    samples = two()._replace(position=np.array([(0.3, 0, 0.5), (0, 0.2, 1.5)], np.float32))
    camera = Camera.from_intrinsics(4.0, 4.0, 4.1, 3.9)
    frame = draw(samples, camera, primitive=Primitive.SPLATS)
    kernel = GaussianKernel()
    integral = naive.all_line_integrals(samples, camera, kernel, height=SIDE, width=SIDE)
    truth = np.exp(-(integral * samples.extinction[:, None, None]).sum(axis=0))
    np.testing.assert_allclose(1 - frame.rgba[..., 3], truth, atol=1e-4)


@pytest.mark.parametrize(
    ("primitive", "model"), [(form, model) for form in Primitive for model in footprints_of(form)]
)
@pytest.mark.parametrize("focal", [1.0, 6.0])
def test_every_choice_paints_something_sensible(primitive, model, focal):
    frame = draw(
        two(), Camera.from_intrinsics(focal, focal, 4.1, 3.9), primitive=primitive, footprint=model
    )
    assert 0 <= frame.rgba.min() <= frame.rgba.max() <= 1
    seen = frame.depth[frame.rgba[..., 3] > 1e-3]
    assert ((seen > 5.99) & (seen < 7.01)).all()
    assert frame.statistics.points + frame.statistics.splats == 2


def test_the_order_of_many_samples_does_not_change_a_bit():
    """More than insertion sort takes, with ties and duplicates."""
    rng = np.random.default_rng(7)
    samples = Samples(
        rng.integers(0, 3, (60, 3)).astype(np.float32) + np.array([-1, -1, 60], np.float32),
        rng.choice([0.2, 0.7], (60, 3)).astype(np.float32),
        rng.choice([0.1, 0.2], 60).astype(np.float32),
        np.eye(3),
    )
    order = rng.permutation(60)
    shuffled = Samples(*(samples[n][order] for n in range(3)), lattice=samples.lattice)
    camera = Camera.from_intrinsics(30.0, 30.0, 4.1, 3.9)
    first, again = (draw(one, camera, subpixels=1) for one in (samples, shuffled))
    assert first.rgba.tobytes() == again.rgba.tobytes()


@pytest.mark.sweep
def test_linear_opacity_is_linear_in_the_line_integral():
    sample = Samples(*(column[:1] for column in two()[:3]), lattice=np.eye(3))
    camera = Camera.from_intrinsics(8.0, 8.0, 4.1, 3.9)
    frame = draw(sample, camera, primitive=Primitive.SPLATS, opacity=Opacity.LINEAR)
    kernel = GaussianKernel()
    integral = naive.all_line_integrals(sample, camera, kernel, height=SIDE, width=SIDE)[0]
    np.testing.assert_allclose(frame.rgba[..., 3], (1 - np.exp(-1)) * integral, atol=1e-5)
