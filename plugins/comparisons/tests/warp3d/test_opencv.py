import cv2
import numpy as np
import pytest

from resample_comparisons.warp3d.opencv import OpenCv
from resample_warp3d.types import Equation
from tests.warp3d import naive_warp
from tests.warp3d.naive_warp import EQUATIONS, IDENTITY, random_source

needs_warp_frame = pytest.mark.skipif(
    not hasattr(cv2, "warpFrame"), reason="this OpenCV has no cv2.warpFrame (5.0 brought it)"
)


@needs_warp_frame
def test_identity_is_exact_in_any_number_of_channels():
    source = random_source(channels=7)
    picture = OpenCv()(source, IDENTITY, (20, 24))
    is_known = source.nearness > 0
    np.testing.assert_array_equal(picture.image, np.where(is_known[..., None], source.color, 0))
    np.testing.assert_array_equal(picture.coverage, is_known)


@pytest.mark.some(1)
@needs_warp_frame
@pytest.mark.parametrize("shape", [(20, 24), (30, 33), (9, 40)])
@pytest.mark.parametrize("name", EQUATIONS)
def test_it_is_a_z_buffer_half_a_pixel_to_the_left_and_above(name, shape):
    equation, source = EQUATIONS[name], random_source()
    half = np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1]])
    shifted = Equation(half @ equation.matrix, half @ equation.epipole)
    expected = naive_warp.nearest_pixels(source, shifted, shape)
    given = OpenCv()(source, equation, shape)
    # It computes in float32: a sample at a pixel's border may go to the next. Of samples that are
    # equally near it keeps another one, so colors are not compared.
    is_other = abs(given.nearness - expected.nearness) > 1e-5 * expected.nearness
    assert np.mean(is_other) <= 0.005


def test_a_distorted_source_is_refused():
    with pytest.raises(ValueError, match="undistort it, or use mcmillan-zbuffer"):
        OpenCv()(random_source(is_placed=True), IDENTITY, (20, 24))


def test_an_older_opencv_is_named(monkeypatch):
    monkeypatch.delattr(cv2, "warpFrame", raising=False)
    with pytest.raises(LookupError, match=r"has no cv2\.warpFrame; install"):
        OpenCv()(random_source(), IDENTITY, (20, 24))
