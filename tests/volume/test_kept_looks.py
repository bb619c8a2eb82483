"""What pictures of a look depend on is kept: later commands ask for nothing that is hidden."""

import os
from dataclasses import replace

import numpy as np
import pytest

from resample.cameras.viewpoints import Orbit
from resample.outofcore import caching as facts
from resample.outofcore import samples
from resample_volume.classification.labels import Labels, Rule
from resample_volume.data.recordings import volume_at
from resample_volume.files.source import open_streamed
from resample_volume.files.stores import statistics_cache
from resample_volume.files.stores.chunks import Single
from resample_volume.files.stores.writing import Layered, write_store
from resample_volume.outofcore import caching
from resample_volume.outofcore.caching import cached, cached_visible
from resample_volume.types import Recording
from resample_volume.windows import Budget, paint_streamed, streamed_subject
from tests.volume.dense import SIZE, assert_same, whole_of
from tests.volume.of_voxels import of_voxels

SOLID = of_voxels("100/white/0,180/white/0.95")
LABELS = Labels(np.ones((32, 32, 32), np.uint8), {1: Rule((1, 0, 0))})


@pytest.fixture(autouse=True)
def in_small_steps(monkeypatch, tmp_path):
    monkeypatch.setattr(statistics_cache, "LEAST", 0)
    monkeypatch.setattr(samples, "LEAST", 500)
    monkeypatch.setenv("HYBRID_RESAMPLE_CACHE", str(tmp_path / "cache"))


@pytest.fixture
def store(tmp_path, rng):
    return written(tmp_path / "store.zarr", rng.integers(180, 255, (32, 32, 32)).astype(np.uint8))


def written(path, values, side=16):
    recording = Recording(Single(values), np.ones(3), np.zeros(3), np.eye(3), "solid")
    write_store(path, recording, Layered(chunk=side, is_layered=False))
    for file in path.rglob("*"):
        os.utime(file, (1e9, 1e9))
    return path


def opened(path, side=16):
    """A volume in a store, as a new command has it, and the bricks that are read of it."""
    volume = volume_at(open_streamed(path), None, None)
    read, values = [], volume.values

    def at(box):
        read.append(tuple(part.start for part in box))
        return values.read(box)

    bricks = replace(values, read=at, side=(side,) * 3)
    bricks.pin_bricks(0)
    return volume._replace(values=bricks), read


def painted(path, look, viewpoint, memory=5_000_000, side=16):
    """A picture, and the bricks that were read for it after the first pass."""
    volume, read = opened(path, side)
    volume.values.statistics  # noqa: B018
    first, media, spent = len(read), [(volume, look)], Budget(memory, 2)
    subject = streamed_subject(media, "visible", budget=spent)
    camera = subject.camera(viewpoint, *SIZE)
    frame, _ = paint_streamed(media, subject, camera, SIZE, spent)
    return frame, read[first:]


def in_memory(path, look, viewpoint):
    volume, _ = opened(path)
    return whole_of([(volume._replace(values=volume.values.whole()), look)], "visible", viewpoint)


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("light", "most", "layers", "memory"),
    [
        (None, 0.85, 5, 5_000_000),
        pytest.param(
            *(SOLID.light, 1.0, 8, 7_000_000),
            marks=pytest.mark.sweep,
        ),
    ],
)
def test_a_later_command_asks_for_nothing_hidden(light, most, layers, memory, tmp_path, rng):
    values = rng.integers(180, 255, (64, 8 * layers, 64)).astype(np.uint8)
    path = written(tmp_path / "cube.zarr", values, side=8)
    look = replace(SOLID, transfer="100/white/0,180/white/1", light=light)
    first, before = painted(path, look, Orbit(10, 20, 3.0), memory, 8)
    assert_same(first, in_memory(path, look, Orbit(10, 20, 3.0)))
    assert set(before) == {(8 * z, 8 * y, 8 * x) for z, y, x in np.ndindex(8, layers, 8)}
    again, read = painted(path, look, Orbit(200, -30, 3.0), memory, 8)
    assert_same(again, in_memory(path, look, Orbit(200, -30, 3.0)))
    assert len(set(read)) < most * len(set(before))
    assert len(read) < 0.5 * len(before)


@pytest.mark.sweep
@pytest.mark.parametrize(
    "look",
    [
        pytest.param(replace(SOLID, gradient_opacity=(0.1, 0.6)), id="gradient opacity"),
        *(
            pytest.param(
                look,
                id=name,
                marks=pytest.mark.sweep,
            )
            for name, look in [
                ("labels", replace(SOLID, labels=LABELS)),
                ("clipped", replace(SOLID, clip=("1/0.3/-0.5/-3",), crop="2:29,:,:25")),
            ]
        ),
    ],
)
def test_looks_that_depend_on_more_have_the_same_bits(look, store):
    painted(store, look, Orbit(10, 20, 1.5))
    again, _ = painted(store, look, Orbit(200, -30, 1.5))
    assert_same(again, in_memory(store, look, Orbit(200, -30, 1.5)))


@pytest.mark.sweep
def test_other_looks_are_looked_at_themselves(store):
    painted(store, SOLID, Orbit(10, 20, 1.5))
    other = of_voxels("100/white/0,240/white/0.2")
    again, read = painted(store, other, Orbit(10, 20, 1.5))
    assert_same(again, in_memory(store, other, Orbit(10, 20, 1.5)))
    assert len(set(read)) == 2 * 2 * 2


@pytest.mark.sweep
def test_a_store_that_has_changed_is_looked_at_anew(store):
    painted(store, SOLID, Orbit(10, 20, 1.5))
    values = opened(store)[0].values.whole()
    values[:, :20] = 0
    changed = written(store.with_name("other.zarr"), values)
    for file in changed.rglob("*"):
        if file.is_file():
            file.replace(store / file.relative_to(changed))
    again, _ = painted(store, SOLID, Orbit(10, 20, 1.5))
    assert_same(again, in_memory(store, SOLID, Orbit(10, 20, 1.5)))


@pytest.mark.sweep
@pytest.mark.parametrize(
    "damage",
    [
        None,
        *(pytest.param(each, marks=pytest.mark.sweep) for each in (b"", b"no archive")),
    ],
)
def test_what_is_damaged_is_found_again(damage, store, tmp_path):
    first, _ = painted(store, SOLID, Orbit(10, 20, 1.5))
    files = list((tmp_path / "cache" / "looks").iterdir())
    assert files
    for file in files:
        file.write_bytes(file.read_bytes()[:-40] if damage is None else damage)
    again, _ = painted(store, SOLID, Orbit(10, 20, 1.5))
    assert_same(again, first)
    volume, _ = opened(store)
    assert all(caching.facts()._read(file) is not None for file in files)
    assert cached_visible(volume, "another look") is None


@pytest.mark.sweep
def test_nothing_is_kept_where_nothing_can_be_written(store, tmp_path):
    (tmp_path / "cache").write_text("a file")
    first, _ = painted(store, SOLID, Orbit(10, 20, 1.5))
    assert_same(first, in_memory(store, SOLID, Orbit(10, 20, 1.5)))


@pytest.mark.sweep
def test_no_more_is_kept_than_there_is_room_for(store, tmp_path, monkeypatch):
    painted(store, SOLID, Orbit(10, 20, 1.5))
    looks = tmp_path / "cache" / "looks"
    before = {file: file.stat().st_size for file in looks.iterdir()}
    monkeypatch.setattr(caching, "MOST_BYTES", sum(before.values()))
    painted(store, replace(SOLID, light=None), Orbit(10, 20, 1.5))
    after = {file: file.stat().st_size for file in looks.iterdir()}
    assert after.keys() - before.keys()
    assert sum(after.values()) <= sum(before.values())


@pytest.mark.sweep
def test_small_volumes_are_looked_at_each_time(store, tmp_path, monkeypatch):
    monkeypatch.setattr(statistics_cache, "LEAST", 1 << 23)
    painted(store, SOLID, Orbit(10, 20, 1.5))
    assert not (tmp_path / "cache" / "looks").exists()


def test_what_is_kept_comes_back_as_it_was(store):
    steep = caching.Steep(
        np.array([np.inf] * 3, np.float32), np.ones(3, np.float32), np.zeros((2, 2)), np.float32(2)
    )
    looked = caching.VisibleBlocks((None, steep), np.arange(3), np.arange(3, 6))
    for given in (looked, 0.1, caching.Sphere(np.arange(3.0), np.inf), None):
        volume, _ = opened(store)
        assert cached(volume, ("a name", repr(given)), lambda: given, lasts=True) is given  # noqa: B023
        volume, _ = opened(store)
        again = cached(volume, ("a name", repr(given)), pytest.fail, lasts=True)
        assert repr(again) == repr(given)
        assert type(again) is type(given)


def test_what_is_cached_depends_on_the_code_that_scans_and_classifies(store, monkeypatch):
    packages = []
    monkeypatch.setattr(facts, "source_fingerprint", lambda *names: packages.extend(names) or "")
    cached(opened(store)[0], "a name", lambda: 0.5, lasts=True)
    assert {"resample_volume.voxels", "resample_volume.classification"} <= set(packages)
    monkeypatch.setattr(facts, "source_fingerprint", lambda *_: "other code")
    assert cached(opened(store)[0], "a name", lambda: 1.5, lasts=True) == 1.5
