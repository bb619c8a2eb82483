"""The methods that the paper compares itself with, each against what its authors say it does."""

import sys
from functools import cache

import numpy as np
import pytest

from resample.cameras.models import Camera, Orthographic
from resample.cameras.poses import look_at
from resample.measuring.quality import rms
from resample.painting.choices import Footprint, Primitive, footprints_of
from resample.profiles.reconstruction import GaussianKernel, variance
from resample.resampler import Resampler
from resample.types import Samples
from resample_comparisons.volume.painting import EWA_VARIANCE
from tests.benchmarks.splat_scenes import CRUST, checker_box, checker_truth, distant, object_psnr
from tests.samples import painter

SIDE = 28  # px
KERNEL = GaussianKernel()
WIDENED = (Primitive.INFLATE, Primitive.EWA)
LATTICE = look_at((1, 2, 3), (0, 0, 0))[:3, :3] @ np.diag([0.7, 1, -1.4])


def one_sample(place, lattice=None, extinction=0.1):
    return Samples(
        np.array([place], np.float32),
        np.ones((1, 3), np.float32),
        np.array([extinction], np.float32),
        np.eye(3) if lattice is None else lattice,
    )


def optical_depth(samples, camera, *, side=SIDE, **choices):
    """What a picture says of the ray through each pixel, (H, W)."""
    frame = painter(**choices)(samples, camera, height=side, width=side)
    return -np.log1p(-frame.rgba[..., 3].astype(float))


def moments(picture):
    """Sum, mean place and covariance of a picture, px."""
    place = np.stack(np.meshgrid(*[np.arange(picture.shape[0]) + 0.5] * 2), axis=-1).reshape(-1, 2)
    weight = picture.ravel() / picture.sum()
    middle = weight @ place
    return picture.sum(), middle, (place - middle).T @ (weight[:, None] * (place - middle))


def parallel(scale):
    """Camera along z with `scale` px per scene unit, off the middle of a pixel."""
    return Orthographic(scale, scale, SIDE / 2 + 0.13, SIDE / 2 - 0.21, near=-50.0)


# Disc: Mueller and Yagel 1996.


# Inflate: Swan et al. 1997.


@pytest.mark.parametrize("scale", [0.9, 0.5, 0.2, 0.05])
def test_inflated_kernels_are_as_wide_as_if_a_pixel_apart(scale):
    samples = one_sample((0.0, 0.0, 0.0), extinction=0.1)
    drawn = optical_depth(samples, parallel(scale), primitive=Primitive.INFLATE)
    _, _, covariance = moments(drawn)
    # The sum over pixels stands for an integral: within 1 % at this width.
    np.testing.assert_allclose(covariance, variance(KERNEL) * np.eye(2), atol=0.015)


@pytest.mark.parametrize("primitive", WIDENED)
@pytest.mark.parametrize("scale", [3.0, 0.9, 0.5, 0.2])
def test_widened_kernels_keep_their_energy(primitive, scale):
    samples = one_sample((0.0, 0.0, 0.0), LATTICE, 0.1)
    total, _, _ = moments(optical_depth(samples, parallel(scale), primitive=primitive))
    mass = 0.1 * abs(np.linalg.det(LATTICE)) * scale**2
    assert total == pytest.approx(mass, rel=0.05)  # ripple of a narrow kernel's sum over pixels


@pytest.mark.parametrize("scale", [1.5, 4.0])
def test_nothing_is_inflated_above_a_pixel(scale):
    samples = one_sample((0.1, 0.2, 0.3), LATTICE)
    affine = {"primitive": Primitive.SPLATS, "footprint": Footprint.EXACT}
    plain = optical_depth(samples, parallel(scale), **affine)
    inflated = optical_depth(samples, parallel(scale), primitive=Primitive.INFLATE)
    np.testing.assert_allclose(inflated, plain, atol=1e-7)


# EWA: Zwicker et al. 2001.


@pytest.mark.parametrize("scale", [4.0, 1.0, 0.3])
def test_an_ewa_splat_has_the_covariance_of_its_projection_and_the_pixels_filter(scale):
    samples = one_sample((0.0, 0.0, 0.0), LATTICE)
    drawn = optical_depth(samples, parallel(scale), primitive=Primitive.EWA)
    projected = (scale * LATTICE)[:2]
    expected = variance(KERNEL) * projected @ projected.T + EWA_VARIANCE * np.eye(2)
    _, _, covariance = moments(drawn)
    np.testing.assert_allclose(covariance, expected, atol=0.01 + 0.005 * scale**2)  # sums of pixels


def test_an_ewa_splat_in_perspective_has_the_covariance_of_its_jacobian():
    """J V Jᵀ + V_h, J the projection's derivative at the center, which is not far off the axis."""
    x, y, z = center = np.array([4.0, -3.0, 60.0])
    focal = 50.0
    camera = Camera.from_intrinsics(
        focal, focal, SIDE / 2 - focal * x / z + 0.1, SIDE / 2 - focal * y / z
    )
    jacobian = focal * np.array([[1 / z, 0, -x / z**2], [0, 1 / z, -y / z**2]])
    expected = variance(KERNEL) * jacobian @ LATTICE @ LATTICE.T @ jacobian.T
    expected += EWA_VARIANCE * np.eye(2)
    drawn = optical_depth(one_sample(center, LATTICE), camera, primitive=Primitive.EWA)
    total, middle, covariance = moments(drawn)
    np.testing.assert_allclose(covariance, expected, atol=0.01)
    np.testing.assert_allclose(middle, [SIDE / 2 + 0.1, SIDE / 2], atol=0.01)
    area = abs(np.linalg.det(LATTICE)) * focal**2 * np.linalg.norm(center) / z**3
    assert total == pytest.approx(0.1 * area, rel=0.01)


@pytest.mark.parametrize("primitive", WIDENED)
def test_widened_splats_become_plain_ones_as_they_grow(primitive):
    samples = one_sample((0.0, 0.0, 0.0))
    camera = Orthographic(60.0, 60.0, 14.0, 14.0, near=-50)
    affine = {"primitive": Primitive.SPLATS, "footprint": Footprint.EXACT}
    plain = optical_depth(samples, camera, **affine)
    np.testing.assert_allclose(
        optical_depth(samples, camera, primitive=primitive), plain, atol=1e-4
    )


# Together with other choices.


@pytest.mark.parametrize(
    ("primitive", "footprint"),
    [
        (form, model)
        for form in Primitive
        for model in Footprint
        if model not in footprints_of(form)
    ],
)
def test_a_footprint_that_does_not_go_with_a_primitive_is_refused(primitive, footprint):
    with pytest.raises(ValueError, match=rf"{primitive} goes with the footprint .*, not"):
        Resampler(primitive=primitive, footprint=footprint)


def test_widened_primitives_and_the_papers_have_footprints_of_their_own():
    common = footprints_of(Primitive.SPLATS)
    own = {form for form in Primitive if footprints_of(form) != common}
    assert own == {*WIDENED, Primitive.PAPER}


# Aliasing.


MORE = pytest.mark.sweep
ALIASING = (Primitive.HYBRID, Primitive.SPLATS, *WIDENED)


@cache
def drawn(form, scale, subpixels=None):
    """The checker box in the distance, RGBA."""
    resample = painter(primitive=form, subpixels=subpixels)
    return distant(scale).by(resample, checker_box(0.9, CRUST[0.9])).rgba


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.parametrize("scale", [pytest.param(0.5, marks=MORE), 0.25])
def test_all_rivals_alias_less_than_plain_splats_and_hybrid_least(scale):
    """Against 8 × 8 rays per pixel through the very same kernels: blur is no aliasing."""
    alias = {
        form: 255 * rms(drawn(form, scale), drawn(form, scale, subpixels=8)) for form in ALIASING
    }
    shown = {str(form): round(value, 2) for form, value in alias.items()}
    sys.stdout.write(f"\nchecker box, {scale} px per voxel, levels from own 8 × 8: {shown}\n")
    for form in WIDENED:
        assert alias[form] < 0.6 * alias[Primitive.SPLATS], form
        assert alias[form] > 3 * alias[Primitive.HYBRID], form


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.parametrize("scale", [pytest.param(0.5, marks=MORE), 0.25])
def test_hybrid_is_nearest_to_the_truth(scale, record):
    """Wide kernels blur, and make the edges of what is opaque fat."""
    truth = checker_truth(0.9, scale)
    quality = {form: object_psnr(drawn(form, scale), truth) for form in Primitive}
    opacity = {form: drawn(form, scale)[..., 3].sum() / truth[..., 3].sum() for form in Primitive}
    for name, found in (("dB", quality), ("opacity", opacity)):
        shown = {str(form): round(float(value), 3) for form, value in found.items()}
        sys.stdout.write(f"\nchecker box, {scale} px per voxel, {name}: {shown}\n")
    hybrid = quality.pop(Primitive.HYBRID)
    record.quality("hybrid", hybrid)
    assert all(value < hybrid - 5 for value in quality.values())  # dB
    assert opacity[Primitive.HYBRID] == pytest.approx(1, abs=1e-3)
    assert all(1.01 < opacity[form] < 1.15 for form in WIDENED)
