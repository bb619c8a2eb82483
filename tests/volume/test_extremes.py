"""Maxima and minima show values that voxels have, or that lie between those around a place."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from resample.cameras.viewpoints import Orbit
from resample.painting.choices import Projection
from resample.painting.splines import levels_of_samples
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


@pytest.mark.parametrize("is_least", [False, True])
@pytest.mark.parametrize("shape", [(1, 1, 1), (2, 3, 5), (33, 34, 35), (70, 3, 4)])
def test_blocks_are_bounded_by_the_samples_around_their_cells(shape, is_least):
    values = np.random.default_rng(7).integers(0, 200, shape).astype(np.int16)
    levels = levels_of_samples(values, is_least)
    signed = -values if is_least else values
    most = np.full([count // 2 + 1 for count in shape], -np.inf)
    for at in np.ndindex(most.shape):
        # Two cells lie between three samples.
        most[at] = signed[tuple(slice(max(0, 2 * n - 1), 2 * n + 2) for n in at)].max()
    found = levels.leaf / levels.per_value + levels.low
    assert (found >= most - 1e-9).all()
    assert (found <= most + 1.01 / levels.per_value).all()
    assert levels.block.max() == levels.leaf.max()
    assert levels.block.shape == tuple(-(-count // 8) for count in levels.leaf.shape)


@pytest.mark.parametrize("projection", [Projection.MAXIMUM, Projection.MINIMUM])
@pytest.mark.parametrize("per_voxel", [0.5, 0.125])
def test_extremes_from_afar_come_to_the_means_of_many_rays(projection, per_voxel, record):
    rng = np.random.default_rng(7)
    values = gaussian_filter(rng.normal(size=(96, 96, 96)), 2.0)
    values = np.rint(127 + 40 * values / values.std()).clip(0, 255).astype(np.uint8)
    side, shown = round(96 * 3**0.5 * per_voxel) + 2, []
    for paint in (
        Resampler(order=Rays(quality="usual"), projection=projection),
        Resampler(order=Rays(step=0.5, quality="best"), projection=projection, subpixels=16),
    ):
        orbit, size = Orbit(30, 20, fov=0), (side, side)
        frame = render(as_volume(values), PLAIN, orbit, size=size, resampler=paint)
        shown.append(np.where(frame.coverage > 0.99, frame.value, np.nan))
        if paint.subpixels is None:
            assert frame.statistics.subpixels == 2  # per side of a pixel
    error = np.nanmean((shown[0] - shown[1]) ** 2) / 255**2
    record.quality("values", -10 * np.log10(error))
