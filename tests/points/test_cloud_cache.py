"""What is measured of clouds is kept, told apart, bounded, and never trusted blindly."""

import os

import numpy as np
import pytest

from resample.memory import mapped
from resample_points.data.cloud import Cloud
from resample_points.geometry import spacing
from resample_points.geometry.spacing import prepare_cloud

NOTHING = np.zeros((0, 3), np.float32)


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """Folder of the cache, in which small clouds are kept, too."""
    monkeypatch.setenv(mapped.FOLDER_VARIABLE, str(tmp_path))
    monkeypatch.setattr(spacing, "LEAST_POINTS", 1)
    return tmp_path / "clouds"


@pytest.fixture
def measured(monkeypatch):
    """How many points were measured each time."""
    counts, measure = [], spacing._measured

    def counting(position, *rest):
        counts.append(len(position))
        measure(position, *rest)

    monkeypatch.setattr(spacing, "_measured", counting)
    return counts


def _cloud(seed=0, color=NOTHING, normal=NOTHING, radius=None):
    position = np.random.default_rng(seed).normal(size=(500, 3)).astype(np.float32)
    return Cloud(position, normal, color, np.zeros(0, np.float32) if radius is None else radius)


def _same(one, two):
    for first, second in zip(one, two, strict=True):
        np.testing.assert_array_equal(first, second)


def test_a_cloud_is_measured_once(kept, measured):
    first = prepare_cloud(_cloud(), cache=True)
    second = prepare_cloud(_cloud(), cache=True)
    assert measured == [500]
    assert len(list(kept.iterdir())) == 1
    _same(first, second)
    _same(first, prepare_cloud(_cloud()))


def test_nothing_is_kept_unless_asked_for(kept, measured):
    prepare_cloud(_cloud())
    prepare_cloud(_cloud())
    assert measured == [500, 500]
    assert not kept.exists()


def test_colors_and_order_need_no_measuring_again(kept, measured, rng):
    color = rng.random((500, 3)).astype(np.float32)
    plain = prepare_cloud(_cloud(), cache=True)
    mixed = rng.permutation(500)
    colored = _cloud(color=color)
    other = Cloud(colored.position[mixed], NOTHING, color[mixed], colored.radius)
    found = prepare_cloud(other, cache=True)
    assert measured == [500]
    _same(found, prepare_cloud(colored)._replace(source=found.source))
    np.testing.assert_array_equal(mixed[found.source], plain.source)
    np.testing.assert_array_equal(found.axes, plain.axes)
    assert len(list(kept.iterdir())) == 1


@pytest.mark.sweep
@pytest.mark.usefixtures("kept")
def test_what_discs_depend_on_is_told_apart(measured, rng):
    normal = rng.normal(size=(500, 3)).astype(np.float32)
    moved = _cloud()._replace(position=_cloud().position * np.float32(1.5))
    for cloud in (_cloud(), _cloud(1), moved, _cloud(normal=normal), _cloud(normal=-normal)):
        _same(prepare_cloud(cloud, cache=True), prepare_cloud(cloud))
    prepare_cloud(_cloud(), cache=True, largest=np.inf)
    assert measured == [500] * 11


def test_other_sources_measure_again(kept, measured, monkeypatch):
    prepare_cloud(_cloud(), cache=True)
    monkeypatch.setattr(spacing, "source_fingerprint", lambda *_: "others")
    prepare_cloud(_cloud(), cache=True)
    assert measured == [500, 500]
    assert len(list(kept.iterdir())) == 2


@pytest.mark.parametrize("content", [b"", b"\x93NUMPY", b"no array", b"flip", None])
def test_a_damaged_file_is_made_anew(kept, measured, content):
    good = prepare_cloud(_cloud(), cache=True)
    (path,) = kept.iterdir()
    if content is None:
        with path.open("wb") as file:
            np.savez(file, measured=np.zeros((3, 9), np.float32))
    elif content == b"flip":
        whole = bytearray(path.read_bytes())
        whole[len(whole) // 2] ^= 4
        path.write_bytes(whole)
    else:
        path.write_bytes(content)
    _same(prepare_cloud(_cloud(), cache=True), good)
    _same(prepare_cloud(_cloud(), cache=True), good)
    assert measured == [500, 500]


def test_a_cache_that_cannot_be_written_is_no_error(tmp_path, monkeypatch, measured):
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv(mapped.FOLDER_VARIABLE, str(tmp_path / "file"))
    monkeypatch.setattr(spacing, "LEAST_POINTS", 1)
    prepare_cloud(_cloud(), cache=True)
    assert measured == [500]


def test_the_least_used_go_first(kept, monkeypatch):
    monkeypatch.setattr(spacing, "MOST_BYTES", 2 * 500 * 36 + 600)
    for seed in (0, 1):
        prepare_cloud(_cloud(seed), cache=True)
    first, second = sorted(kept.iterdir(), key=lambda path: path.stat().st_mtime_ns)
    os.utime(second, (1, 1))
    os.utime(first, (2, 2))
    prepare_cloud(_cloud(2), cache=True)
    left = set(kept.iterdir())
    assert first in left
    assert second not in left
    assert len(left) == 2
    prepare_cloud(_cloud(0), cache=True)
    assert set(kept.iterdir()) == left
    assert first.stat().st_mtime > 3 or second.stat().st_mtime > 3


def test_what_is_larger_than_the_cache_is_not_kept(kept, monkeypatch):
    monkeypatch.setattr(spacing, "MOST_BYTES", 1000)
    prepare_cloud(_cloud(), cache=True)
    assert not kept.exists() or not list(kept.iterdir())


def test_small_clouds_and_those_of_known_radius_are_not_kept(kept, monkeypatch):
    prepare_cloud(_cloud(radius=np.ones(500, np.float32)), cache=True)
    monkeypatch.setattr(spacing, "LEAST_POINTS", 501)
    prepare_cloud(_cloud(), cache=True)
    assert not kept.exists()
