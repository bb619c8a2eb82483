"""Samples in parts on a disk, painted window by window, have the bits of samples in memory."""

import pickle

import numpy as np
import pytest

from resample import Camera
from resample.outofcore.bricks import BrickArray
from resample.outofcore.passes import PassContext, counts_by_digit, passed, ranked, spans_within
from resample.progress import report

LAYERS = ("rgba", "depth", "first_depth", "coverage")
SIZE = 40, 160  # height and width, px
CAMERA = Camera.from_fov(30, *SIZE)
PARTS, COUNT = 8, 6000
LATTICE = 0.08 * np.eye(3)


class Elsewhere:
    """Does as processes would: what it is given is pickled."""

    def __init__(self, executor):
        self.executor, self.maps = executor, []

    def map(self, job, parts):
        self.maps.append(len(parts))
        return self.executor.map(pickle.loads(pickle.dumps(job)), pickle.loads(pickle.dumps(parts)))


WIDE, DEEP = ((-2, -0.5, 2), (2, 0.5, 2.5)), ((-0.6, -0.6, 2), (0.6, 0.6, 10))


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
    assert (bricks.shared, bricks.pinned.most) == (None, 0)


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
