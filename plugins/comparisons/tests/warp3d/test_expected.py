import numpy as np

from resample_comparisons.warp3d.expected import edges_in_view, expected_nearness
from resample_warp3d.depth.equation import of_rectified
from resample_warp3d.types import DepthImage, Equation

SHAPE = (12, 20)
NOWHERE = np.empty((0, 0, 2))


def image_of(nearness):
    color = np.zeros((*nearness.shape, 3), np.float32)
    return DepthImage(color, np.asarray(nearness, np.float32), NOWHERE)


def test_the_nearest_sample_of_a_pixel_is_expected():
    nearness = np.full(SHAPE, 1.0)
    nearness[:, 10] = 3.0
    found = expected_nearness(image_of(nearness), of_rectified(1.0), SHAPE)
    assert found[4, 7] == 3.0
    assert found[4, 5] == 1.0


def test_samples_without_depth_are_expected_nowhere():
    nearness = np.zeros(SHAPE)
    nearness[3, 4] = 1.0
    found = expected_nearness(image_of(nearness), of_rectified(0.5), SHAPE)
    assert np.argwhere(found).tolist() == [[3, 3], [3, 4]]


def test_points_behind_the_eye_are_expected_nowhere():
    behind = Equation(np.eye(3), np.array([0.0, 0.0, -2.0]))
    assert not expected_nearness(image_of(np.ones(SHAPE)), behind, SHAPE).any()


def test_an_even_slope_is_no_edge():
    nearness = np.broadcast_to(np.linspace(1.0, 1.2, SHAPE[1]), SHAPE)
    assert not edges_in_view(image_of(nearness), of_rectified(1.0), SHAPE).any()
