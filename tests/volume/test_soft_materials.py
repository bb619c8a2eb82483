"""What `auto` shows of thin and soft materials before dense ones, where they have a peak."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from resample_volume.classification.presets import VEIL, load_transfer, transfer_for
from resample_volume.classification.value_statistics import survey
from resample_volume.data.scanning import Histogram, peak_between
from resample_volume.inputs import as_volume

SIDE = 48


def away(x=0.0, y=0.0, z=0.0):
    """Distances from a place in shares of half the side."""
    grid = np.mgrid[:SIDE, :SIDE, :SIDE] / (SIDE / 2) - 1
    return np.sqrt(((grid.T - np.array([z, y, x])) ** 2).sum(axis=-1).T)


def scanned(values, noise):
    """Values as a scanner has them: blurred, with noise."""
    return gaussian_filter(values, 0.6) + np.random.default_rng(3).normal(0, noise, values.shape)


def tree(leaf=70.0):
    """Air, thin leaves, wood and soil."""
    values = np.full((SIDE,) * 3, 8.0)
    for radius in (0.15, 0.25, 0.35, 0.45):
        values[np.abs(away(z=0.4) - radius) < 0.03] = leaf
    values[(np.hypot(*(np.mgrid[:SIDE, :SIDE] / (SIDE / 2) - 1)) < 0.1) & (away() < 0.7)] = 125
    values[away(z=-0.55) < 0.38] = 200
    return np.clip(scanned(values, 4), 0, 255).astype(np.uint8)


def chest(lung=-800.0, noise=25.0):
    """Lungs and bones in flesh, Hounsfield units."""
    values = np.full((SIDE,) * 3, -1000.0)
    values[away() < 0.9] = 40.0
    for side in (-0.4, 0.4):
        values[away(x=side) < 0.33] = lung
    values[away(y=0.6) < 0.15] = 700.0
    return scanned(values, noise).astype(np.int16)


def shown(values, name="auto"):
    """Opacities and colors of values that `auto` gives them."""
    volume = as_volume(values)
    look = transfer_for(name, volume)
    span = survey(volume).whole
    return lambda at: (look.opacities([at], span)[0], look.colors([at], span)[0])


def test_leaves_are_a_veil_of_their_own_color_before_wood_and_soil():
    found = shown(tree())
    opacity, color = found(70.0)
    assert opacity == pytest.approx(VEIL, abs=0.02)
    assert color[1] > 1.5 * max(color[0], color[2])
    assert found(20.0)[0] == 0  # the noise of air, 3 standard deviations from it
    soil, brown = found(200.0)
    assert soil > 0.7
    assert brown[0] > brown[1] > brown[2]


def test_edges_of_dense_things_alone_are_no_material():
    found = shown(tree(leaf=8.0))
    assert found(60.0)[0] == 0


def test_what_dense_things_are_embedded_in_stays_transparent():
    values = np.full((SIDE,) * 3, 0.0)
    values[away() < 0.95] = 30
    values[away() < 0.4] = 150
    found = shown(np.clip(scanned(values, 2), 0, 255).astype(np.uint8))
    assert found(30.0)[0] == 0
    assert found(150.0)[0] > 0.4


def test_what_is_all_around_stays_transparent():
    values = tree().astype(float)
    values[[0, -1]] = 70
    assert shown(values.astype(np.uint8))(70.0)[0] == 0


@pytest.mark.parametrize("added", [0, 1024])
def test_lungs_are_seen_in_flesh(added):
    values = chest() + added
    found, plain = shown(values), shown(values, "ct")
    assert found(-800.0 + added)[0] == pytest.approx(0.05, abs=0.01)
    assert plain(-800.0 + added)[0] == 0
    assert found(-950.0 + added)[0] == 0
    assert 0 < found(40.0 + added)[0] < plain(40.0 + added)[0] < 0.1
    assert found(700.0 + added)[0] == plain(700.0 + added)[0]


@pytest.mark.parametrize("values", [chest(lung=40.0), chest(noise=120.0)])
def test_without_clear_lungs_a_scan_looks_as_it_did(values):
    look = transfer_for("auto", as_volume(values)._replace(units="hu"))
    assert look == load_transfer("ct")


def test_a_peak_is_between_two_valleys():
    value = np.arange(256.0)
    count = 1e5 * np.exp(-(value**2) / 50) + 900 * np.exp(-((value - 70) ** 2) / 200)
    count += 5000 * np.exp(-((value - 200) ** 2) / 200) + 10
    levels = Histogram(value, count.astype(np.int64))
    peak = peak_between(levels, 130, 130, 0.9)
    assert peak.value == pytest.approx(70, abs=2)
    assert 20 < peak.before < 50
    assert 90 < peak.after < 131
    flat = Histogram(value, (count - 900 * np.exp(-((value - 70) ** 2) / 200)).astype(np.int64))
    assert peak_between(flat, 130, 130, 0.9) is None


def test_chance_makes_no_material():
    rng = np.random.default_rng(3)
    parts = rng.normal(0, 0.3, 20000), rng.exponential(8.0, 500), rng.normal(60, 0.5, 2000)
    value = np.sort(np.concatenate(parts))
    known = Histogram(value, np.full(value.size, 64))
    assert peak_between(known, 40, 40, 0.9, 1) is not None
    assert peak_between(known, 40, 40, 0.9, 64) is None
