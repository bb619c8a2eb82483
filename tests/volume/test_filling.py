"""Missing values of a field get the nearest known one, in memory and in a file."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_edt

from resample.memory.mapped import array_in_file, is_in_file
from resample_volume.voxels.gathered import _without_gaps


def known_ones(shape, share, seed):
    """Values of which a share is known, each another one."""
    rng = np.random.default_rng(seed)
    values = rng.permutation(np.prod(shape)).reshape(shape).astype(np.float32)
    return np.where(rng.random(shape) < share, values, rng.choice([np.nan, np.inf], shape))


@pytest.mark.sweep
@given(
    shape=st.tuples(*[st.integers(1, 12)] * 3),
    share=st.sampled_from([0.01, 0.05, 0.2, 0.6, 0.97]),
    seed=st.integers(0, 99),
)
@example((12, 12, 12), 0.02, 7)
@example((1, 1, 9), 0.2, 3)
def test_gaps_get_what_scipy_finds_to_be_nearest(shape, share, seed):
    values = known_ones(shape, share, seed)
    known = np.isfinite(values)
    filled, flags = _without_gaps(values)
    if known.all():
        assert filled is values
        return
    assert np.array_equal(flags, np.pad(known.astype(np.uint8), 2, mode="edge").reshape(-1))
    if not known.any():
        assert not filled.any()
        return
    assert filled.dtype == values.dtype
    nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
    assert np.array_equal(filled, values[tuple(nearest)])


@pytest.mark.parametrize("even", [False, True])
def test_of_voxels_that_are_as_near_the_first_is_taken(even):
    values = np.full((9, 9, 9), np.nan)
    if even:
        values[::4, ::4, ::4] = np.arange(27).reshape(3, 3, 3)
    else:
        values[4, 4, ::8], values[4, ::8, 4], values[::8, 4, 4] = (1, 2), (3, 4), (5, 6)
    nearest = distance_transform_edt(np.isnan(values), return_distances=False, return_indices=True)
    assert np.array_equal(_without_gaps(values)[0], values[tuple(nearest)])


def test_of_values_in_a_file_all_is_in_one(tmp_path, monkeypatch):
    monkeypatch.setenv("HYBRID_RESAMPLE_CACHE", str(tmp_path))
    for share in (0.3, 0.0):
        values = known_ones((9, 8, 7), share, 5)
        there = array_in_file(values.shape, values.dtype, 1 << 20, "values")
        there[...] = values
        for found, wanted in zip(_without_gaps(there), _without_gaps(values), strict=True):
            assert is_in_file(found)
            assert found.dtype == wanted.dtype
            assert np.array_equal(found, wanted)
