"""Between thick slices lies what moves from one to the next, along whichever axis they are."""

import numpy as np
import pytest

from benchmarks.analytic import FIELDS, sampled
from resample.cameras.viewpoints import Orbit
from resample.engine.jit import threads
from resample.painting.choices import Projection
from resample.profiles.orders import Rays
from resample.resampler import Resampler
from resample_volume import Appearance, render
from resample_volume.classification.labels import Labels
from resample_volume.rendering import Subject
from resample_volume.voxels.thin import SAME, Thin, thin_of, thinned, voxels_of


def slices(thickness, name="rings 2.0"):
    """A formula's means in slices of that thickness."""
    return sampled(FIELDS[name], thickness)


def tilted(count, step):
    """A thin wall that goes by so much from slice to slice."""
    x = np.arange(48.0)
    place = 12 + step * np.arange(count)[:, None]
    row = 200 * np.exp(-(((x - place) / 1.5) ** 2))
    return np.broadcast_to(row[:, None], (count, 24, 48)).astype(np.float32)


def test_a_wall_that_moves_from_slice_to_slice_stays_whole_between_them(record):
    found, low = thinned(tilted(6, 4.0), Thin(0, 4), is_within=False)
    x = np.arange(48.0)
    at = (np.arange(24) + 0.5) / 4 - 0.5
    truth = 200 * np.exp(-(((x - 12 - 4 * at[:, None]) / 1.5) ** 2))
    inside = slice(4, -4)
    off = np.abs(found[inside, 12] + low - truth[inside]).max()
    record.error("largest", off)  # the spline across slices is off by 150


@pytest.mark.some(1)
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_any_axis_may_be_the_thick_one(axis):
    values = tilted(6, 4.0)
    found, _ = thinned(np.moveaxis(values, 0, axis), Thin(axis, 3), is_within=False)
    first, _ = thinned(values, Thin(0, 3), is_within=False)
    assert (np.moveaxis(found, axis, 0) == first).all()


def test_slices_are_made_thin_where_they_are_thick():
    for thickness, parts in ((1, 1), (2, 1), (3, 3), (5, 4), (7, 4)):
        assert thin_of(slices(thickness)).parts == parts
    wide = slices(1)._replace(spacing=np.array([5.0, 1.0, 1.0]))
    assert thin_of(wide) == Thin(2, 4)
    assert thin_of(wide._replace(values=wide.values[:, :8])) == SAME


@pytest.mark.sweep
def test_threads_do_not_change_thin_slices():
    values = slices(5).values
    with threads(1):
        one, _ = thinned(values, Thin(0, 4), is_within=False)
    two, _ = thinned(values, Thin(0, 4), is_within=False)
    assert (one == two).all()


@pytest.mark.sweep
@pytest.mark.parametrize("kind", [np.uint8, np.int16, np.float64])
def test_thin_slices_pass_no_voxel_where_that_is_asked_for(kind):
    values = (slices(5).values / 2 + 3).astype(kind)
    found, low = thinned(values, Thin(0, 4), is_within=True)
    assert values.min() <= found.min() + low <= found.max() + low <= values.max()


def test_even_slices_stay_even():
    found, low = thinned(np.full((4, 20, 20), 7, np.int32), Thin(0, 3), is_within=False)
    assert low == 7
    assert not found.any()


def test_samples_are_those_of_their_voxels():
    sample = np.array([-1, 0, 2, 4 * 5 * 3 - 1, 4 * 5])
    assert voxels_of(sample, (3, 4, 5), SAME) is sample
    found = voxels_of(np.array([-1, *range(5 * 4 * 12)]), (3, 4, 5), Thin(0, 4))
    assert found[0] == -1
    assert (np.bincount(found[1:]) == 4).all()
    assert (np.unravel_index(found[1:], (3, 4, 5))[0] == np.repeat(range(3), 80)).all()


@pytest.mark.sweep
def test_slices_with_labels_and_means_are_splines():
    volume, look = slices(5), Appearance(light=None)
    labels = Labels(np.zeros(volume.values.shape, np.uint8), {})
    assert Subject.of(volume, look).voxels.thin == Thin(0, 4)
    assert Subject.of(volume, Appearance(light=None, labels=labels)).voxels.thin == SAME
    mean = Resampler(order=Rays(), projection=Projection.AVERAGE)
    assert Subject.of(volume, look, mean).voxels.thin == SAME


def test_slices_stay_thick_where_a_spline_is_asked_for():
    by = Resampler(order=Rays(interpolation="spline"))
    assert Subject.of(slices(5), Appearance("gray"), by).voxels.thin == SAME


def test_slices_stay_thick_where_memory_holds_no_more(monkeypatch):
    volume = slices(3)

    def held(count, what):
        if count > 16 * volume.values.size:
            raise ValueError(f"{what} does not fit")

    monkeypatch.setattr("resample_volume.voxels.thin.require_memory", held)
    assert Subject.of(volume, Appearance(light=None)).voxels.thin == SAME


def test_gaps_in_thick_slices_stay_as_large():
    values = slices(5).values.astype(np.float32) + 50
    values[:, :, :32] = np.nan
    volume = slices(5)._replace(values=values)
    cover = render(volume, Appearance(light=None), Orbit(0, 0, fov=0), size=(64, 64)).coverage
    seen = (cover > 0.5).any(axis=0)
    whole = slices(5)._replace(values=np.nan_to_num(values, nan=60.0))
    full = render(whole, Appearance(light=None), Orbit(0, 0, fov=0), size=(64, 64)).coverage
    assert abs(2 * seen.sum() - (full > 0.5).any(axis=0).sum()) <= 64


@pytest.mark.sweep
def test_a_picture_of_thick_slices_is_nearer_to_that_of_thin_ones(record):
    look = Appearance(light=None)
    thin, thick = (slices(n, "rings 1.2") for n in (1, 4))
    camera = Subject.of(thin, look).camera(Orbit(30, 20), 64, 64)
    goal, found = (render(one, look, camera, size=(64, 64)).rgba for one in (thin, thick))
    record.quality("picture", -10 * np.log10(np.mean((goal - found) ** 2)))
