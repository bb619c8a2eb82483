"""Sparse depth: scattered samples and lines of a scanner."""

import numpy as np
import pytest

from resample.cameras.models import Camera
from resample.files.pictures import Kind, Picture
from resample_warp3d.command.inputs import DepthInput
from resample_warp3d.depth.refining.conditioning import refine
from resample_warp3d.depth.refining.resizing import fitted
from resample_warp3d.types import DepthImage
from tests.warp3d.naive_sheet import EMPTY

Y, X = np.mgrid[:96, :128] + 0.5
IS_NEAR = (abs(X - 60) < 24) & (abs(Y - 48) < 20)
TRUE = np.where(IS_NEAR, 0.5 * (1 + 0.002 * X), 0.2 * (1 + 0.004 * Y)).astype(np.float32)


@pytest.fixture
def color(rng):
    """A red thing before a blue wall, a little noisy."""
    found = np.where(IS_NEAR[..., None], (0.8, 0.3, 0.1), (0.1, 0.4, 0.7))
    return np.float32(found + 0.02 * rng.standard_normal(found.shape))


def scattered(rng, share):
    return rng.random(TRUE.shape) < share


def kept(kind, rng):
    if kind == "lines":
        return np.isin(np.arange(96), np.arange(3, 96, 6))[:, None] & (X > 0)
    return scattered(rng, kind)


def image_of(color, is_known):
    return DepthImage(color, np.where(is_known, TRUE, np.float32(0)), EMPTY)


@pytest.mark.some(1)
@pytest.mark.parametrize("kind", [0.01, 0.05, 0.2, "lines"])
def test_sparse_depth_is_interpolated_on_planes_up_to_edges_of_color(kind, color, rng, record):
    refined = refine(image_of(color, kept(kind, rng)))
    assert refined.chosen == "densify"
    error = np.abs(refined.image.nearness / TRUE - 1)
    record.error("median", np.median(error))
    record.error("wrong samples", error > 0.03)


def test_interpolated_depth_is_half_as_sure_as_samples(color, rng):
    is_known = scattered(rng, 0.05)
    refined = refine(image_of(color, is_known))
    assert (refined.confidence[is_known] == 1).all()
    assert refined.confidence[~is_known].max() <= 0.5
    np.testing.assert_allclose(refined.image.nearness[is_known], TRUE[is_known])


def test_where_no_sample_is_near_nothing_is_made_up(color, rng):
    is_known = scattered(rng, 0.05) & (Y > 40)
    found = refine(image_of(color, is_known)).image.nearness
    assert (found[:20] == 0).all()
    assert (found[48:] > 0).all()


def test_a_lone_thing_is_not_sparse(color):
    refined = refine(image_of(color, IS_NEAR & (abs(X - 60) < 12)))
    assert not refined.findings.is_sparse
    assert (refined.image.nearness[~IS_NEAR] == 0).all()


def test_sparse_depth_of_another_size_is_interpolated_in_the_picture(color, rng):
    small = np.where(scattered(rng, 0.2), TRUE, np.float32(0))[::2, ::2]
    given = DepthImage(color, np.ascontiguousarray(small), EMPTY)
    kind, camera = Kind(("R", "G", "B"), 8, is_encoded=True), Camera.from_fov(60, *TRUE.shape)
    view = DepthInput(Picture(color, kind), fitted(given), camera, None, is_fitted=True)
    for refined in (refine(given), view.refined("auto")):
        assert refined.chosen == "densify"
        assert (np.abs(refined.image.nearness / TRUE - 1) > 0.03).mean() < 0.02
