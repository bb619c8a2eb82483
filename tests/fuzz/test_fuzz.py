"""The fuzzer's own run in the tests: fixed seeds, in a process that is limited, without a fault."""

import random
from functools import partial

import numpy as np
import pytest

from resample import Camera, Scatter
from resample_points import Cloud, framed, render_cloud
from resample_texture import warp
from resample_volume import Volume, render
from resample_warp3d import warp as warp_depth
from tests.fuzz import arrays, faulty, files, lines
from tests.fuzz.corpus import corpus
from tests.fuzz.mutations import mutated
from tests.fuzz.pool import READ, Setup, attempted, tried_all
from tests.fuzz.readers import READERS
from tests.processes import PATIENCE

LINES = 18  # one of each command
FILES, ARRAYS = 2000, 480  # about 10 s together, on one core; `make fuzz` tries far more
SOME_FILES, SOME_ARRAYS = 400, 80


def faults(setup, seeds):
    return [one for one in tried_all(setup, seeds, np.inf) if one.is_fault]


def is_packed(case):
    """Whether a case is a cloud whose bytes are packed, for which a kernel is compiled."""
    return any(b"DATA binary_compressed" in content for content in case.files.values())


@pytest.mark.sweep
@pytest.mark.parametrize("count", [SOME_FILES, pytest.param(FILES, marks=pytest.mark.sweep)])
def test_changed_files_are_read_or_refused_in_one_line(count):
    cases, seeds = corpus(), range(count)
    if count == SOME_FILES:
        seeds = [seed for seed in seeds if not is_packed(cases[seed % len(cases)])]
    assert faults(Setup(files.make, seconds=PATIENCE), seeds) == []


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.parametrize("count", [SOME_ARRAYS, pytest.param(ARRAYS, marks=pytest.mark.sweep)])
def test_odd_arrays_and_numbers_give_results_or_clear_errors(count):
    seeds = range(count)
    if (
        count == SOME_ARRAYS
    ):  # particles have painters compiled once more, for points of a size each
        seeds = [seed for seed in seeds if arrays.call_of(seed) is not arrays.particles_of]
    assert faults(Setup(arrays.make, seconds=PATIENCE, allowed=(TypeError,)), seeds) == []


@pytest.mark.sweep
@pytest.mark.slow
def test_odd_command_lines_are_refused_in_one_line():
    setup = Setup(partial(lines.make, is_quick=True), seconds=PATIENCE)
    assert faults(setup, range(LINES)) == []


@pytest.mark.sweep
def test_what_the_fuzzer_is_to_find_it_finds():
    found = [
        *tried_all(Setup(faulty.make, seconds=PATIENCE), range(3), np.inf),
        *tried_all(Setup(faulty.make, seconds=2.0), range(3, 4), np.inf),
    ]
    for case, result in zip(found, faulty.FOUND, strict=True):
        assert case.result.startswith(result)


@pytest.mark.parametrize(
    "case",
    [pytest.param(case, marks=pytest.mark.sweep if is_packed(case) else ()) for case in corpus()],
    ids=lambda case: f"{case.reader}-{next(iter(case.files))}",
)
def test_files_of_the_corpus_are_read(case, tmp_path):
    files.put(tmp_path, case.files)
    read = READERS[case.reader]
    first = tmp_path / next(iter(case.files))
    assert attempted(lambda _seed, _folder: read(first), 0, tmp_path, ()) == READ


@pytest.mark.sweep
def test_a_seed_stands_for_one_change():
    case = corpus()[0]
    assert mutated(random.Random(5), case.files) == mutated(random.Random(5), case.files)


# Volumes whose numbers are absurd ended the process


@pytest.mark.parametrize(
    ("spacing", "match"),
    [
        ([1e-30] * 3, "choose another unit"),
        ([1e30] * 3, "choose another unit"),
        ([5e-324] * 3, "choose another unit"),
        ([1.0, 1.0, 1e-9], "at most"),
        ([1.0, 1.0, 0.0], "above 0"),
        ([1.0, np.nan, 1.0], "above 0"),
        ([1.0, 1.0], "numbers"),
    ],
)
def test_volumes_with_absurd_spacings_are_refused(spacing, match):
    values = np.arange(336, dtype=np.uint8).reshape(6, 7, 8)
    volume = Volume(values, np.array(spacing), np.zeros(3), np.eye(3), "odd")
    with pytest.raises(ValueError, match=match):
        render(volume, size=(24, 20))


# Values are what counts, not how they lie


def plain(values, _folder):
    return values


def mapped(values, folder):
    path = folder / f"{values.dtype}{len(list(folder.iterdir()))}.npy"  # others are still mapped
    np.save(path, values)
    return np.load(path, mmap_mode="r")


def swapped(values, _folder):
    return values.astype(values.dtype.newbyteorder())


def column_major(values, _folder):
    return np.asfortranarray(values)


def stepped(values, _folder):
    return np.repeat(values, 2, axis=0)[::2]


LAYOUTS = (mapped, swapped, column_major, stepped)


def pictures(laid, folder):
    """What every application makes of values that lie in one way."""
    rng = np.random.default_rng(4)
    volume = laid(rng.integers(0, 4000, (6, 7, 8)).astype(np.uint16), folder)
    yield render(volume, size=(24, 20)).rgba
    whole = Volume(volume, np.ones(3), np.zeros(3), np.eye(3), "odd")
    yield render(whole, size=(24, 20)).rgba
    picture = laid(rng.integers(0, 65535, (12, 14, 3)).astype(np.uint16), folder)
    yield warp(picture, [[0.9, -0.2, 3], [0.2, 0.9, 0]], (12, 14)).image
    color, depth = rng.random((16, 18, 3), np.float32), 2 + rng.random((16, 18))
    camera = Camera.from_fov(50, 16, 18)
    yield warp_depth(laid(color, folder), laid(depth, folder), camera, camera).image
    place = laid(rng.random((60, 3), np.float32), folder)
    nothing = np.zeros((0, 3), np.float32)
    cloud = Cloud(place, nothing, nothing, np.zeros(0, np.float32))
    yield render_cloud(cloud, framed(cloud, size=(24, 20)), size=(24, 20)).rgba
    yield Scatter()(
        laid(20 * rng.random((30, 2)), folder), rng.random(30), radius=1.5, shape=(20, 24)
    ).value


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.parametrize("laid", LAYOUTS)
def test_maps_and_other_layouts_and_byte_orders_give_the_same_bits(laid, tmp_path):
    for expected, found in zip(pictures(plain, tmp_path), pictures(laid, tmp_path), strict=True):
        assert np.array_equal(np.asarray(expected), np.asarray(found), equal_nan=True)
        assert np.asarray(found).dtype.newbyteorder("=") == np.asarray(expected).dtype
