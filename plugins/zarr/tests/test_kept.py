"""What a first pass over a store finds is kept, and asked for as long as the store stays."""

import os
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.sparse import Bubbles
from resample.files import writing
from resample.files.writing import replacing
from resample_volume.calls import render
from resample_volume.data import scanning
from resample_volume.data.recordings import volume_at
from resample_volume.files.source import open_streamed
from resample_volume.types import Recording
from resample_zarr.volumes import Single
from resample_zarr.writing import Layered, write_store

LOOK = "60/#804020/0,120/#e0a060/0.5,240/white/0.9"


@pytest.fixture(autouse=True)
def any_size(monkeypatch, tmp_path):
    monkeypatch.setattr(scanning, "LEAST", 0)
    monkeypatch.setenv("HYBRID_RESAMPLE_CACHE", str(tmp_path / "cache"))


def written(folder, values, *, chunk=16):
    path = folder / "store.zarr"
    recording = Recording(Single(values), np.ones(3), np.zeros(3), np.eye(3), "store")
    write_store(path, recording, Layered(chunk=chunk, is_layered=False))
    return aged(path)


def aged(path, by=60.0):
    """A store whose files were last written to some seconds ago."""
    for file in path.rglob("*"):
        known = file.stat()
        os.utime(file, (known.st_atime - by, known.st_mtime - by))
    return path


def opened(path, side=16):
    volume = volume_at(open_streamed(path), None, None)
    return volume._replace(values=replace(volume.values, side=(side,) * 3))


def looked_at(path):
    """What is known of a store, and how many bricks were read for that."""
    bricks = opened(path).values
    return bricks.statistics, bricks.reads


@pytest.mark.sweep
@pytest.mark.parametrize("kind", ["uint8", "int16", "float32"])
def test_a_second_command_does_not_look_at_all_bricks_again(kind, tmp_path, rng):
    values = rng.normal(90, 30, (20, 40, 33)).clip(0, 255).astype(kind)
    path = written(tmp_path, values)
    first, reads = looked_at(path)
    assert reads >= 2 * 3 * 3
    second, again = looked_at(path)
    assert again == 0
    for part, other in zip(second, first, strict=True):
        assert np.array_equal(part, other)
        assert getattr(part, "dtype", None) == getattr(other, "dtype", None)


@pytest.mark.sweep
def test_bricks_of_another_size_and_values_without_padding_are_looked_at_by_themselves(tmp_path):
    path = written(tmp_path, np.arange(32**3, dtype=np.int16).reshape(32, 32, 32))
    looked_at(path)
    other = opened(path, side=32).values
    assert other.statistics.least.shape == (1, 1, 1)
    assert other.reads == 1
    less = opened(path).values.without([5.0], 7)
    assert less.statistics.least.min() == 0
    assert less.reads == 8


def test_a_store_that_has_changed_is_looked_at_again(tmp_path):
    path = written(tmp_path, np.ones((16, 16, 16), np.uint8))
    assert looked_at(path)[0].greatest.max() == 1
    chunk = next(file for file in path.rglob("*") if file.name == "0" and file.is_file())
    os.utime(chunk)
    assert looked_at(path)[1] == 1


def test_a_store_that_may_change_unseen_is_not_kept(tmp_path):
    path = aged(written(tmp_path, np.ones((16, 16, 16), np.uint8)), by=-60)
    assert looked_at(path)[1] == looked_at(path)[1] == 1
    assert not list(tmp_path.glob(".*"))


def test_what_is_kept_and_damaged_is_not_believed(tmp_path):
    path = written(tmp_path, np.ones((16, 16, 16), np.uint8))
    looked_at(path)
    (own,) = tmp_path.glob(".store.zarr.survey-*.npz")
    whole = own.read_bytes()
    for damaged in (b"", whole[:-50], whole.replace(b"least", b"worst")):
        own.write_bytes(damaged)
        assert looked_at(path)[1] == 1


def test_beside_a_store_that_must_not_be_written_to_the_cache_keeps_it(tmp_path, monkeypatch):
    def refusing(path):
        if path.parent == tmp_path:
            raise PermissionError("read-only")
        return replacing(path)

    monkeypatch.setattr(writing, "replacing", refusing)
    path = written(tmp_path, np.ones((16, 16, 16), np.uint8))
    assert [looked_at(path)[1] for _ in range(2)] == [1, 0]
    assert len(list((tmp_path / "cache" / "surveys").iterdir())) == 1


@pytest.mark.sweep
def test_pictures_of_sparse_volumes_decode_few_bricks_twice(tmp_path):
    path = written(tmp_path, Bubbles(128).bricks(16))
    frames, reads = [], []
    for _ in range(2):
        volume = opened(path)
        frames.append(render(volume, LOOK, size=(40, 40)))
        reads.append(volume.values.reads)
    assert reads[0] - 8**3 == reads[1] < 0.6 * 8**3  # walls are thick beside such bricks
    assert np.array_equal(frames[0].rgba, frames[1].rgba)
