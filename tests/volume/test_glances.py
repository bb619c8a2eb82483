"""A look at all values that processes share finds what one process finds, bit by bit."""

import pickle
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from resample.command import workers
from resample.command.settings import Sharing
from resample.command.workers import WorkerPool, at_work
from resample.files.images import read_image
from resample.outofcore.passes import PassContext
from resample_volume.cli import app
from resample_volume.data import scanning
from resample_volume.data.values import Bricks
from resample_volume.files.source import open_streamed
from resample_volume.types import Recording
from resample_zarr.volumes import Single
from resample_zarr.writing import Layered, write_store
from tests.commands import ended
from tests.killing import Killing


class Elsewhere:
    """Does as processes would: what it is given is pickled."""

    def __init__(self, executor):
        self.executor, self.maps = executor, []

    def map(self, job, parts):
        self.maps.append(len(parts))
        return self.executor.map(pickle.loads(pickle.dumps(job)), parts)


class Reading:
    """Reads boxes of an array."""

    def __init__(self, values):
        self.values = values

    def __call__(self, box):
        return np.ascontiguousarray(self.values[box])


def bricks_of(values, side):
    return Bricks(Reading(values), values.shape, values.dtype, side)


def noise(shape, kind, seed=3):
    rng = np.random.default_rng(seed)
    values = (40 * rng.normal(size=shape) + 90).clip(0, 250).astype(kind)
    if np.dtype(kind).kind == "f":
        values[rng.random(shape) < 0.02] = np.nan
        values[rng.random(shape) < 0.01] = np.inf
    return values


def same(found, given):
    for name, part, other in zip(given._fields, found, given, strict=True):
        assert np.array_equal(part, other, equal_nan=np.asarray(part).dtype.kind == "f"), name
        assert getattr(part, "dtype", None) == getattr(other, "dtype", None)


@pytest.mark.sweep
@given(
    shape=st.tuples(*[st.integers(1, 30)] * 3),
    side=st.tuples(*[st.integers(1, 12)] * 3),
    kind=st.sampled_from(["uint8", "int16", "float32", "int32"]),
    sampled=st.sampled_from([2e6, 300.0]),
)
def test_parts_put_together_are_what_one_process_finds(shape, side, kind, sampled):
    values = noise(shape, kind)
    with pytest.MonkeyPatch.context() as patch, ThreadPoolExecutor(3) as executor:
        patch.setattr(scanning, "SAMPLED", sampled)
        alone, shared = bricks_of(values, side), bricks_of(values, side)
        elsewhere = Elsewhere(executor)
        shared.helpers = lambda: PassContext(elsewhere, 1)
        same(shared.statistics, alone.statistics)
        assert shared.reads == alone.reads
        assert elsewhere.maps[0] == min(alone.count[0], scanning.PARTS)
        step = scanning.step_of(values.size)
        assert np.array_equal(
            alone.statistics.some,
            values[::step, ::step, ::step],
            equal_nan=values.dtype.kind == "f",
        )


def stored(folder, values):
    path = folder / "noise.zarr"
    recording = Recording(Single(values), np.ones(3), np.zeros(3), np.eye(3), "noise")
    write_store(path, recording, Layered(chunk=8, is_layered=False))
    return path


def test_other_processes_get_the_ends_of_bricks_and_no_more_of_their_statistics():
    bricks = bricks_of(noise((16, 16, 16), "float32"), (8, 8, 8))
    ends = bricks.statistics.least, bricks.statistics.greatest
    copy = pickle.loads(pickle.dumps(bricks))
    assert "statistics" not in vars(copy)
    np.testing.assert_equal(vars(copy)["ends"], ends)


@pytest.mark.sweep
@pytest.mark.slow
def test_a_killed_worker_costs_a_look_its_own_part_alone(tmp_path):
    path = stored(tmp_path, noise((40, 24, 16), "float32"))
    small = [replace(open_streamed(path).values[0, 0], side=(8, 8, 8)) for _ in range(2)]
    (tmp_path / "marks").mkdir()
    with at_work(Sharing(workers=2)) as crew:
        killing = Killing(crew.executor, tmp_path / "marks", 1, is_late=True)
        small[0].helpers = lambda: PassContext(killing, 1)
        same(small[0].statistics, small[1].statistics)
    assert killing.redone(0)


def hired(monkeypatch):
    """Executors of threads, which commands that are run from now on hire in place of processes."""
    executors = []

    @contextmanager
    def hiring(sharing, threads=None):
        with ThreadPoolExecutor(2) as executor:
            executors.append(Elsewhere(executor))
            crew = WorkerPool(
                executors[-1], sharing.workers or 1, threads or 1, None, is_local=True
            )
            yield lambda: crew

    monkeypatch.setattr(workers, "worker_pools", hiring)
    return executors


def test_a_command_has_its_workers_look_at_a_store(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(scanning, "LEAST", 0)
    stored(tmp_path, noise((40, 24, 16), "uint8"))
    common = ["render", "noise.zarr", "--size", "24", "--transfer", "150..190"]
    common += ["--fit", "volume"]
    assert ended(app, *common, "-o", "one.exr") == 0
    for file in Path().glob(".noise.zarr.survey-*"):
        file.unlink()
    executors = hired(monkeypatch)
    assert ended(app, *common, "--workers", "2", "-o", "two.exr") == 0
    assert len(executors[0].maps) == 2  # the survey and the rows
    assert np.array_equal(read_image("one.exr"), read_image("two.exr"))
    assert "shared by 2 processes" in capsys.readouterr().err
    assert ended(app, *common[:-1], "visible", "--workers", "2", "-o", "c.exr") == 0
    assert ended(app, *common[:-1], "visible", "-o", "d.exr") == 0
    assert np.array_equal(read_image("c.exr"), read_image("d.exr"))
