"""Maxima and minima show values that voxels have, or that lie between those around a place."""

import numpy as np
import pytest

from resample.cameras.viewpoints import Orbit
from resample.painting.choices import Projection
from resample.profiles.orders import Rays
from resample.resampler import Resampler
from resample_volume import Appearance, as_volume, render

SIZE = (48, 48)  # px
FRONT = Orbit(0, 0, fov=0)
ROUNDING = 0.05  # data units, of 16 bits that hold coefficients of 8
PLAIN = Appearance(light=None)


def measured(values, projection, order=None, orbit=FRONT):
    """Values that pixels show, NaN where there are none."""
    paint = Resampler(order=order or Rays(), projection=projection)
    frame = render(as_volume(values), PLAIN, orbit, size=SIZE, resampler=paint)
    return np.where(frame.coverage > 0.99, frame.value, np.nan)


def test_a_cube_beside_a_bright_voxel_shows_its_own_value():
    values = np.zeros((24, 24, 24), np.int16)
    values[8:16, 8:16, 8:16] = 255
    values[12, 12, 18] = 1000
    shown = measured(values, Projection.MAXIMUM)
    cube = shown[20:28, 20:28]
    assert cube.max() <= 255 + 1e-3
    assert cube.min() > 250
    assert measured(values, Projection.MAXIMUM, Rays(interpolation="spline"))[20:28].max() > 280


@pytest.mark.parametrize("quality", ["best", "usual", "fast"])
@pytest.mark.parametrize(
    "kind",
    [
        pytest.param(
            np.uint8,  # has kernels of its own
            marks=pytest.mark.sweep,
        ),
        np.int16,
        np.float32,
    ],
)
@pytest.mark.parametrize("projection", [Projection.MAXIMUM, Projection.MINIMUM])
def test_extremes_of_noise_stay_within_the_columns_that_pixels_see(projection, kind, quality):
    rng = np.random.default_rng(5)
    values = rng.integers(-128 if kind == np.int16 else 0, 255, (12, 12, 12)).astype(kind)
    shown = measured(values, projection, Rays(quality=quality))
    row, column, seen = _columns(shown)
    found = shown[seen]
    assert found.size > 400
    # Seen from the front, z upward, a pixel's rays go along y through 2 x 2 columns at a time.
    if projection is Projection.MAXIMUM:
        most = _around(values.max(axis=1)[::-1], np.maximum)
        assert (found <= most[row, column] + ROUNDING).all()
    else:
        least = _around(values.min(axis=1)[::-1], np.minimum)
        assert (found >= least[row, column] - ROUNDING).all()
    assert values.min() <= found.min() <= found.max() <= values.max()


def _around(plane, take):
    """The most (or least) of 3 x 3 about each column."""
    wide = np.pad(plane, 1, mode="edge")
    best = wide[1:-1, 1:-1]
    for down in range(3):
        for right in range(3):
            best = take(best, wide[down : down + plane.shape[0], right : right + plane.shape[1]])
    return best


def _columns(shown):
    """Nearest columns of pixels that are wholly within the volume."""
    seen = np.isfinite(shown)
    rows, columns = (np.flatnonzero(seen.any(axis=axis)) for axis in (1, 0))
    per = 12 / (columns[-1] - columns[0] + 1)
    row, column = np.nonzero(seen)
    at = [
        np.clip((n - first + 0.5) * per, 0, 11.99).astype(int)
        for n, first in ((row, rows[0]), (column, columns[0]))
    ]
    return at[0], at[1], seen


@pytest.mark.parametrize("projection", [Projection.MAXIMUM, Projection.MINIMUM])
def test_no_extreme_lies_beyond_all_samples(projection):
    values = np.zeros((16, 16, 16), np.float32)
    values[4:12, 4:12, 4:12] = 3272
    shown = measured(values, projection, orbit=Orbit(20, 30))
    assert 0 <= np.nanmin(shown) <= np.nanmax(shown) <= 3272


def test_an_interpolation_that_is_none_is_refused():
    with pytest.raises(ValueError, match="monotone, spline are known"):
        Rays(interpolation="linear")
