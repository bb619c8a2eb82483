"""Samples in parts on a disk, painted window by window, have the bits of samples in memory."""

import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from resample import Camera, Resampler
from resample.command.settings import Sharing
from resample.command.workers import at_work
from resample.outofcore import samples
from resample.outofcore.boxes import PartBoxes
from resample.outofcore.bricks import BrickArray, LruCache, bricks_in_memory, with_neighbours
from resample.outofcore.passes import PassContext, counts_by_digit, passed, ranked
from resample.outofcore.samples import (
    BYTES_PER_SAMPLE,
    PictureQuery,
    SampleSource,
    paint_samples,
)
from resample.outofcore.windows import Budget, WindowTask, spans_within, split_windows
from resample.types import Samples
from resample.watching import report

LAYERS = ("rgba", "depth", "first_depth", "coverage")
SIZE = 40, 160  # height and width, px
CAMERA = Camera.from_fov(30, *SIZE)
PARTS, COUNT = 8, 6000
LATTICE = 0.08 * np.eye(3)


class Scattered(SampleSource):
    """An application: samples in as many files as parts, of which it knows the bounds."""

    lattice = LATTICE

    def __init__(self, folder, ends):
        self.folder, self.ends = folder, ends

    def bounds(self, number):
        low, high = self.ends[number].swapaxes(0, 1)
        return PartBoxes(low, high, beyond=np.linalg.norm(self.lattice, axis=1))

    def load(self, number, count):
        self.reads += len(number)
        found = np.concatenate([np.load(self.folder / f"{n}.npy") for n in number])
        assert len(found) == count
        return Samples(*np.split(found[:, :6], 2, axis=1), found[:, 6].copy(), self.lattice)


class Elsewhere:
    """Does as processes would: what it is given is pickled."""

    def __init__(self, executor):
        self.executor, self.maps = executor, []

    def map(self, job, parts):
        self.maps.append(len(parts))
        return self.executor.map(pickle.loads(pickle.dumps(job)), pickle.loads(pickle.dumps(parts)))


WIDE, DEEP = ((-2, -0.5, 2), (2, 0.5, 2.5)), ((-0.6, -0.6, 2), (0.6, 0.6, 10))


def scattered(folder, rng, box=WIDE, along=0, opacity=(1, 60)):
    """Samples in parts along an axis, in files; their source and sizes, and all of them."""
    position = rng.uniform(*box, (COUNT, 3))
    extinction = rng.uniform(*opacity, (COUNT, 1))
    every = np.concatenate([position, rng.random((COUNT, 3)), extinction], axis=1)
    every = every[np.argsort(position[:, along])].astype(np.float32)
    parts, bounds = np.array_split(every, PARTS), []
    for n, part in enumerate(parts):
        np.save(folder / f"{n}.npy", part)
        bounds.append((part[:, :3].min(0), part[:, :3].max(0)))
    sizes = np.array([len(part) for part in parts])
    whole = Samples(*np.split(every[:, :6], 2, axis=1), every[:, 6].copy(), LATTICE)
    return Scattered(folder, np.array(bounds, np.float64)), sizes, whole


def assert_whole(found, whole, paint, camera=CAMERA, size=SIZE):
    wanted = paint(whole, camera, height=size[0], width=size[1])
    assert wanted.coverage.max() > 0.5
    for name in LAYERS:
        assert getattr(found, name).tobytes() == getattr(wanted, name).tobytes(), name


@pytest.mark.some(1)
@pytest.mark.parametrize(
    ("memory", "workers"), [(1 << 30, None), (170_000, None), (170_000, 1), (170_000, 2)]
)
def test_samples_in_files_have_the_bits_of_samples_in_memory(memory, workers, rng, tmp_path):
    (source, sizes, whole), paint = scattered(tmp_path, rng), Resampler()
    with ThreadPoolExecutor(workers or 1) as executor:
        elsewhere = Elsewhere(executor)
        spent = Budget(memory, executor=elsewhere if workers else None)
        found, windows = paint_samples(source, sizes, PictureQuery(paint, CAMERA, SIZE), spent)
    assert (windows > 1) == (memory < 1 << 30)
    assert found.statistics.samples == COUNT
    assert not workers or elsewhere.maps == [PARTS, windows]
    assert_whole(found, whole, paint)


@pytest.mark.sweep
@pytest.mark.slow
def test_two_processes_paint_samples_in_files_with_the_same_bits(rng, tmp_path):
    (source, sizes, whole), paint = scattered(tmp_path, rng), Resampler()
    (tmp_path / "windows").mkdir()
    with at_work(Sharing(workers=2)) as crew:
        spent = Budget(170_000, 1, tmp_path / "windows", crew.executor)
        found, windows = paint_samples(source, sizes, PictureQuery(paint, CAMERA, SIZE), spent)
    assert len(list((tmp_path / "windows").iterdir())) == windows > 1
    assert_whole(found, whole, paint)


def test_windows_load_no_more_samples_than_fit(rng, tmp_path, monkeypatch):
    (source, sizes, whole), paint, loaded = scattered(tmp_path, rng), Resampler(), []
    load = Scattered.load

    def counting(self, number, count):
        loaded.append(count)
        return load(self, number, count)

    monkeypatch.setattr(Scattered, "load", counting)
    picture = PictureQuery(paint, CAMERA, SIZE)
    found, windows = paint_samples(source, sizes, picture, Budget(170_000))
    assert len(loaded) == PARTS + windows  # a survey, and each window once
    assert max(loaded) * BYTES_PER_SAMPLE <= 170_000
    assert_whole(found, whole, paint)
    with pytest.raises(ValueError, match=r"px shows \d+ samples, more than fit in the allowed"):
        paint_samples(source, sizes, picture, Budget(20_000))


def test_parts_that_others_hide_are_not_loaded(rng, tmp_path, monkeypatch):
    monkeypatch.setattr(samples, "LEAST", 100)
    monkeypatch.setattr(samples, "BYTES_PER_SAMPLE", 1 << 20)  # so that windows are in steps
    source, sizes, whole = scattered(tmp_path, rng, DEEP, 2, (3e4, 4e4))
    paint, camera, size = Resampler(), Camera.from_fov(6, 40, 40), (40, 40)
    picture = PictureQuery(paint, camera, size)
    found, windows = paint_samples(source, sizes, picture, Budget(20_000_000))
    assert windows == 1
    assert source.reads < PARTS + 5  # a survey, and the nearest parts
    assert_whole(found, whole, paint, camera, size)


def test_no_samples_are_a_transparent_picture(tmp_path):
    source = Scattered(tmp_path, np.zeros((2, 2, 3)))
    picture = PictureQuery(Resampler(), CAMERA, SIZE)
    found, windows = paint_samples(source, np.zeros(2, int), picture, Budget(1 << 20))
    assert (windows, found.rgba.shape, found.rgba.any()) == (0, (*SIZE, 4), False)


@pytest.mark.parametrize("fewest", [1, 6])
def test_windows_make_up_the_picture_in_whole_tiles(fewest):
    def bounds(window):
        x0, y0, x1, y1 = window
        none = np.zeros(0, np.int32)
        fits = (x1 - x0) * (y1 - y0) <= 3000
        return WindowTask(window, none, none, step=1) if fits else None

    shown = np.zeros((75, 100), int)
    tasks = split_windows((75, 100), 16, bounds, fewest)
    for x0, y0, x1, y1 in (task.window for task in tasks):
        assert x0 % 16 == y0 % 16 == 0
        shown[y0:y1, x0:x1] += 1
    assert (shown == 1).all()
    assert len(tasks) >= fewest


def test_spans_of_tiles_have_as_many_members_as_fit_or_a_single_tile():
    start = np.cumsum([0, 3, 0, 4, 20, 1, 1, 0])
    assert list(spans_within(start, 7)) == [(0, 3), (3, 4), (4, 7)]
    assert list(spans_within(start, 1)) == [(0, 1), (2, 3), (3, 4), (4, 5), (5, 7)]


@pytest.mark.parametrize("shape", [(7,), (5, 8), (4, 5, 6), (3, 4, 2, 5)])
def test_bricks_of_any_dimension_give_the_values_of_the_array(shape, rng):
    values = rng.integers(0, 99, shape)
    bricks = BrickArray(values.__getitem__, shape, values.dtype, (2, 3, 2, 4)[: len(shape)])
    assert (bricks.whole() == values).all()
    assert bricks.reads == len(bricks.all()) == np.prod(bricks.count)
    box = tuple(slice(1, size) for size in shape)
    assert (bricks.part(box) == values[box]).all()
    at = tuple(rng.integers(0, size, 9) for size in shape)
    assert (bricks.at(at) == values[at]).all()
    again = bricks.within(None, LruCache(values.nbytes))
    for _ in range(2):
        assert (again.part(box) == values[box]).all()
    assert again.reads == len(bricks.all())


def test_bricks_that_are_needed_together_are_those_of_two_layers():
    is_chosen = np.zeros((5, 5), bool)
    is_chosen[2, 2] = True
    near = with_neighbours(is_chosen)
    assert near.sum() == 9
    assert bricks_in_memory(near) == 6


@pytest.mark.parametrize(("kind", "digits"), [(np.uint32, 2), (np.uint64, 4)])
def test_numbers_of_a_rank_are_found_by_counting_16_bits_at_a_time(kind, digits, rng):
    number = rng.integers(0, np.iinfo(kind).max, 500, kind) >> kind(3)

    def counted(prefix, digit):
        return sum(counts_by_digit(part, prefix, digit) for part in np.array_split(number, 3))

    ranks = [0, 1, 250, 251, 499]
    assert ranked(ranks, counted, digits) == np.sort(number)[ranks].tolist()


def test_a_pass_tells_its_progress_by_the_sizes_of_parts():
    shares = []
    context = PassContext(tell=shares.append).portion(0.5, 1.0)
    assert list(passed(abs, [-1, 2], context, [3, 1])) == [1, 2]
    assert shares == [0.875, 1.0]


def test_processes_of_a_machine_share_bricks_so_that_none_is_read_twice(rng, tmp_path, monkeypatch):
    monkeypatch.setenv("HYBRID_RESAMPLE_CACHE", str(tmp_path))
    values = rng.integers(0, 99, (7, 9)).astype(np.int16)
    bricks = BrickArray(values.__getitem__, values.shape, values.dtype, (2, 4))
    bricks.pin_bricks(1000)
    bricks.brick((0, 0))
    bricks.share_bricks()
    other = pickle.loads(pickle.dumps(bricks)).anew()
    assert (other.whole() == values).all()
    assert other.reads == len(bricks.all()) - 1
    assert (bricks.whole() == values).all()
    assert bricks.reads == 1
    assert not list(tmp_path.iterdir())  # the file has no name


def test_bricks_are_read_where_a_file_of_others_has_none_of_them(rng, tmp_path, monkeypatch):
    monkeypatch.setenv("HYBRID_RESAMPLE_CACHE", str(tmp_path))
    values = rng.random((8, 8))
    bricks = BrickArray(values.__getitem__, values.shape, values.dtype, (4, 4))
    bricks.pin_bricks(400)  # of which two have a place
    bricks.share_bricks()
    assert (bricks.whole() == values).all()
    bricks.shared._sums[0] += 1  # not complete
    assert (bricks.whole() == values).all()
    monkeypatch.setattr(bricks.shared, "token", b"of another machine")
    assert pickle.loads(pickle.dumps(bricks)).shared is None
    bricks.pin_bricks(0)
    assert (bricks.shared, bricks.pinned_bytes) == (None, 0)


def test_bricks_are_not_shared_where_no_file_can_be_written(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("HYBRID_RESAMPLE_CACHE", str(tmp_path / "file"))
    bricks = BrickArray(np.ones(9).__getitem__, (9,), np.dtype(float), (4,))
    bricks.pin_bricks(1000)
    bricks.share_bricks()
    assert bricks.shared is None
    assert bricks.whole().all()


@pytest.mark.parametrize("sizes", [None, (1, 3)])
def test_a_pass_tells_how_much_of_all_its_parts_is_done(sizes):
    """Parts count by their sizes, or alike, and as a share of what the pass is a part of."""
    told, ends = [], [0.25, 1.0] if sizes else [0.5, 1.0]

    def job(part):
        report(1, 2)
        return 2 * part

    context = PassContext(tell=told.append)
    assert list(passed(job, [3, 4], context, sizes)) == [6, 8]
    wanted = [0.5 * ends[0], ends[0], 0.5 * (ends[0] + ends[1]), ends[1]]
    assert told == wanted
    told.clear()
    list(passed(job, [3, 4], context.portion(0.2, 0.6), sizes))
    assert told == pytest.approx([0.2 + 0.4 * share for share in wanted])
    assert PassContext().portion(0.2, 0.6).tell is None
