"""`--method paper` of volumes against the paper in NumPy, a voxel at a time."""

import numpy as np
import pytest

from resample import Camera, Footprint, Primitive, Resampler, Samples
from resample.profiles.reconstruction import GaussianKernel
from tests.bits import assert_threads_change_nothing
from tests.paper import twin_volume

SIZE = (28, 32)
POSE = np.column_stack([np.eye(3), [0.0, 0.0, 0.0]])
LATTICES = {
    "cubic": np.eye(3),
    "thick slices": np.diag([1.0, 1.0, 2.5]),
    "sheared": np.array([[1.0, 0.3, 0.0], [0.0, 0.9, 0.2], [0.1, 0.0, 1.1]]),
}
VIEWS = {"splats": (9.0, 30.0), "mixed": (30.0, 30.0), "points": (90.0, 25.0)}  # depth, focal px


def cloud(middle, lattice):
    rng = np.random.default_rng(3)
    place = (rng.uniform(-4, 4, (120, 3)) * [1, 1, 1.3] + [0, 0, middle]).astype(np.float32)
    color = rng.uniform(0, 1, (120, 3)).astype(np.float32)
    return Samples(place, color, rng.uniform(0.05, 1.5, 120).astype(np.float32), lattice)


def both(view, lattice, footprint=Footprint.EQUATION):
    """Frame, and what the twin paints."""
    depth, focal = VIEWS[view]
    samples = cloud(depth, LATTICES[lattice])
    camera = Camera.from_intrinsics(focal, focal, 16.0, 14.0, POSE)
    paint = Resampler(primitive=Primitive.PAPER, footprint=footprint)
    frame = paint(samples, camera, height=SIZE[0], width=SIZE[1])
    kernel = GaussianKernel()
    truth = twin_volume.render(
        [array.astype(float) for array in samples[:3]],
        samples.lattice,
        POSE,
        focal,
        (16.0, 14.0),
        SIZE,
        threshold=1.0,
        kernel=(kernel.sigma, kernel.radius),
        pixel_filter=(0.4, 1.2),
        layer=1.0,
        is_projected=footprint is Footprint.PROJECTED,
    )
    return frame, truth


@pytest.mark.sweep
@pytest.mark.parametrize("lattice", LATTICES)
@pytest.mark.parametrize("view", VIEWS)
def test_pictures_are_those_of_the_twin(view, lattice):
    frame, truth = both(view, lattice)
    assert truth[..., 3].max() > 0.02
    np.testing.assert_allclose(frame.rgba, truth, atol=5e-6)  # tables of 1024 steps, float32


@pytest.mark.sweep
def test_views_are_of_splats_of_points_and_of_both():
    shares = [both(view, "cubic")[0].statistics.splat_fraction for view in VIEWS]
    assert shares[0] == 1.0
    assert 0.1 < shares[1] < 0.9
    assert shares[2] == 0.0


@pytest.mark.sweep
def test_the_table_is_as_good_as_its_steps_are_fine():
    frame, truth = both("splats", "cubic", Footprint.CORRECTED)
    assert frame.statistics.from_table > 0
    # Rows of α lie 0.24 degrees apart, of which the nearest is taken.
    np.testing.assert_allclose(frame.rgba, truth, atol=5e-4)


@pytest.mark.sweep
def test_beyond_fifteen_degrees_the_equation_is_evaluated():
    frame, _ = both("splats", "cubic", Footprint.CORRECTED)
    counted = frame.statistics
    assert counted.from_table + counted.by_equation == counted.splats
    assert counted.by_equation > 0
    evaluated, _ = both("splats", "cubic", Footprint.EQUATION)
    assert evaluated.statistics.by_equation == counted.splats
    assert evaluated.statistics.from_table == 0


@pytest.mark.sweep
def test_ellipses_may_lie_around_the_projected_center():
    frame, truth = both("splats", "cubic", Footprint.PROJECTED)
    np.testing.assert_allclose(frame.rgba, truth, atol=2e-3)  # with the table
    assert np.abs(frame.rgba - both("splats", "cubic")[0].rgba).max() > 0.01


def test_threads_change_no_bit():
    samples = cloud(30.0, LATTICES["cubic"])
    camera = Camera.from_intrinsics(200.0, 200.0, 100.0, 80.0, POSE)
    paint = Resampler(primitive=Primitive.PAPER)
    assert_threads_change_nothing(lambda: paint(samples, camera, height=160, width=200).rgba)
