import numpy as np
import pytest
import scipy.ndimage

from resample_volume.files.generated import GENERATED, checker_box, marschner_lobb, vessel_tree


@pytest.mark.parametrize("make", GENERATED.values(), ids=GENERATED)
def test_generated_volumes_are_what_renderers_take(make):
    volume = make(size=20)
    assert volume.values.shape == (20, 20, 20)
    assert volume.values.dtype in (np.uint8, np.float32)
    assert (volume.spacing > 0).all()
    assert np.array_equal(volume.direction, np.eye(3))
    assert volume.name in GENERATED


@pytest.mark.parametrize("make", GENERATED.values(), ids=GENERATED)
def test_generated_volumes_are_the_same_each_time(make):
    assert np.array_equal(make(size=20).values, make(size=20).values)


@pytest.mark.parametrize("make", GENERATED.values(), ids=GENERATED)
def test_a_size_without_voxels_is_refused(make):
    with pytest.raises(ValueError, match="size is at least 2 voxels, not 0"):
        make(size=0)


@pytest.mark.parametrize("make", GENERATED.values(), ids=GENERATED)
def test_a_size_that_cannot_fit_is_refused(make, monkeypatch):
    monkeypatch.setattr("resample.memory.physical_memory", lambda: 1 << 30)
    with pytest.raises(ValueError, match=r"needs .* GiB, this machine has 1\.0 GiB"):
        make(size=5000)


def test_the_checker_box_has_the_papers_million_voxels():
    values = checker_box().values
    assert values.size == 1_000_000
    assert np.unique(values).tolist() == [64, 192]


def test_neighboring_blocks_differ():
    values = checker_box(size=12, block=3).values
    for axis in range(3):
        assert (np.take(values, [2, 5], axis) != np.take(values, [3, 6], axis)).all()
        assert (np.take(values, [0, 3], axis) == np.take(values, [2, 5], axis)).all()


def test_a_block_without_voxels_is_refused():
    with pytest.raises(ValueError, match="block is at least 1 voxel"):
        checker_box(block=0)


def test_marschner_lobb_is_the_published_signal(rng):
    volume = marschner_lobb(size=41)
    for index in rng.integers(0, 41, (20, 3)):
        x, y, z = volume.origin + volume.spacing * index
        ripple = np.cos(2 * np.pi * 6 * np.cos(np.pi * np.hypot(x, y) / 2))
        wanted = (1 - np.sin(np.pi * z / 2) + 0.25 * (1 + ripple)) / 2.5
        assert volume.values[tuple(index[::-1])] == pytest.approx(wanted, abs=1e-6)  # float32


def test_marschner_lobb_spans_its_cube_and_range():
    volume = marschner_lobb(size=9)
    assert (volume.origin + 8 * volume.spacing).tolist() == [1, 1, 1]
    assert volume.values.min() >= 0
    assert volume.values.max() <= 1


def test_vessels_are_thin_and_connected():
    values = vessel_tree(size=96).values
    assert 0.001 < (values > 127).mean() < 0.02
    assert scipy.ndimage.label(values > 0, np.ones((3, 3, 3)))[1] == 1


@pytest.mark.sweep
def test_the_aneurysm_is_the_widest_place():
    inside = vessel_tree(size=96).values > 127
    radius = scipy.ndimage.distance_transform_edt(inside)
    assert radius.max() > 1.6 * radius[:10].max()  # the trunk enters from below
    assert scipy.ndimage.label(radius > 0.8 * radius.max())[1] == 1


def test_another_seed_is_another_tree():
    assert not np.array_equal(vessel_tree(32, seed=1).values, vessel_tree(32, seed=2).values)
