"""What is refused at the door, and what is let in although there is nothing to see."""

import numpy as np
import pytest

from resample.cameras.models import Camera
from resample.painting.choices import Primitive
from resample.painting.scenes import check_samples
from resample.resampler import Resampler
from resample.types import Samples

CAMERA = Camera.from_intrinsics(20.0, 20.0, 8.0, 8.0)


def samples(count=3, **changes):
    given = Samples(
        np.tile(np.array([0, 0, 10], np.float32), (count, 1)),
        np.full((count, 3), 0.5, np.float32),
        np.full(count, 0.7, np.float32),
        np.eye(3),
    )
    return given._replace(**changes)


def draw(given, height=16, width=16, **choices):
    return Resampler(**choices)(given, CAMERA, height=height, width=width)


@pytest.mark.parametrize(
    "changes",
    [
        {"position": np.zeros((2, 3))},
        {"position": np.zeros((3, 2))},
        {"color": np.zeros((3, 4))},
        {"color": np.zeros(3)},
        {"extinction": np.zeros((3, 1))},
        {"extinction": np.zeros(4)},
        {"extinction": np.float32(1.0)},
    ],
    ids=str,
)
def test_arrays_that_do_not_fit_are_refused(changes):
    with pytest.raises(ValueError, match="do not fit"):
        check_samples(samples(**changes))


@pytest.mark.parametrize("name", ["position", "color", "extinction"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_are_refused(name, bad):
    given = samples()
    array = getattr(given, name).copy()
    array.flat[1] = bad
    with pytest.raises(ValueError, match=f"{name} is not finite"):
        draw(given._replace(**{name: array}))


def test_a_negative_extinction_is_refused():
    with pytest.raises(ValueError, match="0 or more"):
        draw(samples(extinction=np.array([1, -1e-3, 1])))


SINGULAR = {
    "zero": np.zeros((3, 3)),
    "flat": np.diag([1.0, 1.0, 0.0]),
    "dependent": np.arange(1.0, 10.0).reshape(3, 3),
    "dependent but for rounding": 0.1 * np.arange(1.0, 10.0).reshape(3, 3),
    "nan": np.full((3, 3), np.nan),
    "shape": np.eye(4),
}


@pytest.mark.parametrize("lattice", SINGULAR.values(), ids=SINGULAR)
def test_a_singular_lattice_is_refused(lattice):
    with pytest.raises(ValueError, match="lattice"):
        draw(samples(lattice=lattice))


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_a_small_or_large_lattice_is_not_singular(scale):
    check_samples(samples(lattice=scale * np.eye(3)))


@pytest.mark.parametrize(
    ("height", "width"), [(0, 16), (16, 0), (-1, 16), (1_000_000, 1_000_000), (2**29, 1)]
)
def test_a_picture_of_no_size_or_too_large_a_size_is_refused(height, width):
    with pytest.raises(ValueError, match="pixels"):
        draw(samples(), height, width)
    with pytest.raises(ValueError, match="pixels"):
        Resampler().footprints(samples(), CAMERA, height=height, width=width)


@pytest.mark.parametrize("threshold", [-0.1, np.nan])
def test_a_threshold_below_zero_is_refused(threshold):
    with pytest.raises(ValueError, match="0 or more"):
        Resampler(threshold=threshold)


@pytest.mark.parametrize("subpixels", [0, 33, -1])
def test_a_grid_that_is_too_coarse_or_too_fine_is_refused(subpixels):
    with pytest.raises(ValueError, match="1 to 32"):
        Resampler(subpixels=subpixels)


@pytest.mark.parametrize("primitive", list(Primitive))
def test_no_samples_make_an_empty_picture(primitive):
    frame = draw(samples(0), 5, 7, primitive=primitive)
    assert frame.rgba.shape == (5, 7, 4)
    assert not frame.rgba.any()
    assert np.isinf(frame.depth).all()
    assert np.isinf(frame.first_depth).all()
    assert not frame.coverage.any()
    assert frame.statistics.samples == 0


def test_no_samples_have_no_footprints():
    assert Resampler(primitive="paper").footprints(samples(0), CAMERA, height=5, width=7).size == 0


@pytest.mark.parametrize("distance", [10.0, 200.0])
@pytest.mark.parametrize("primitive", list(Primitive))
def test_transparent_samples_are_not_seen(primitive, distance):
    place = np.full((3, 3), (0, 0, distance), np.float32)
    frame = draw(samples(position=place, extinction=np.zeros(3)), primitive=primitive)
    assert frame.rgba.max() < 1e-6  # float32 sums of sub-pixels
    assert np.isinf(frame.depth).all()
    assert np.isinf(frame.first_depth).all()


@pytest.mark.parametrize(
    ("primitive", "distance"),
    [
        (Primitive.HYBRID, 10.0),
        (Primitive.HYBRID, 200.0),
        (Primitive.SPLATS, 10.0),
        (Primitive.POINTS, 200.0),
        (Primitive.PAPER, 200.0),
    ],
)
def test_coverage_counts_samples_however_transparent(primitive, distance):
    place = np.full((3, 3), (0, 0, distance), np.float32)
    faint, dense = (
        draw(samples(position=place, extinction=np.full(3, tau)), primitive=primitive)
        for tau in (1e-4, 0.1)
    )
    assert faint.coverage.max() > 1e-3
    np.testing.assert_allclose(faint.coverage, dense.coverage, atol=1e-5)  # float32 sums


@pytest.mark.parametrize("extinction", [1e-3, 1.0, 1e3, 1e30])
@pytest.mark.parametrize("primitive", list(Primitive))
def test_no_extinction_is_too_high(primitive, extinction):
    frame = draw(samples(extinction=np.full(3, extinction)), primitive=primitive)
    assert np.isfinite(frame.rgba).all()
    assert 0 < frame.rgba[8, 8, 3] <= 1
    assert frame.depth[8, 8] == pytest.approx(10, rel=2e-3)  # where rays pass the center


@pytest.mark.parametrize("dtype", [np.float64, np.int32])
def test_arrays_of_other_types_are_converted(dtype):
    given = samples(color=np.ones((3, 3)), extinction=np.ones(3))
    other = Samples(*(array.astype(dtype) for array in given[:3]), lattice=np.eye(3, dtype=int))
    assert draw(other).rgba.tobytes() == draw(given).rgba.tobytes()


def test_a_strided_view_of_arrays_will_do():
    many = samples(6)
    every_other = Samples(*(array[::2] for array in many[:3]), lattice=np.asfortranarray(np.eye(3)))
    assert draw(every_other).rgba.tobytes() == draw(samples(3)).rgba.tobytes()


@pytest.mark.parametrize("name", ["position", "color", "extinction", "lattice", "scale"])
def test_masked_arrays_are_arrays_and_what_is_masked_is_not_finite(name):
    given = samples(scale=np.ones(3, np.float32))
    array = getattr(given, name)
    whole = given._replace(**{name: np.ma.masked_invalid(array)})
    assert draw(whole).rgba.tobytes() == draw(given).rgba.tobytes()
    masked = np.ma.MaskedArray(array, np.arange(array.size).reshape(array.shape) == 1)
    with pytest.raises(ValueError, match=r"not finite|finite number|singular|finite"):
        draw(given._replace(**{name: masked}))


def test_what_was_given_is_left_alone():
    given = samples()
    before = [array.copy() for array in given[:4]]
    draw(given)
    for array, copy in zip(given[:4], before, strict=True):
        np.testing.assert_array_equal(array, copy)


def test_progress_reaches_one_and_may_stop_the_work():
    told = []
    Resampler()(samples(), CAMERA, height=16, width=16, progress=told.append)
    assert told[-1] == 1.0
    assert told == sorted(told)

    def stop(_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Resampler()(samples(), CAMERA, height=16, width=16, progress=stop)


@pytest.mark.parametrize(("height", "width"), [(1, 1), (1, 40), (33, 7)])
def test_any_shape_of_picture_will_do(height, width):
    frame = draw(samples(), height, width)
    assert frame.rgba.shape == (height, width, 4)
    assert frame.depth.shape == frame.coverage.shape == (height, width)
