"""Volumes that memory does not hold as a whole: in a file they give the bits of those it does."""

import shutil
from collections import namedtuple
from dataclasses import replace

import numpy as np
import pytest

from resample.files.images import read_image
from resample.memory.mapped import is_in_file
from resample.painting.choices import Projection
from resample_volume.appearance import ALONG_RAYS, Appearance, Classification
from resample_volume.calls import render
from resample_volume.classification.transfer import from_points
from resample_volume.cli import app
from resample_volume.data.values import Bricks, as_array
from resample_volume.scenes import Scene
from resample_volume.types import Volume
from tests.commands import ended

SIZE = (40, 36)
ENOUGH = 450_000  # bytes: for what is beside the file, not for all
SOLID = from_points([(80, (1, 0, 0), 0.0), (120, (1, 1, 0), 0.6), (200, (1, 1, 1), 0.9)])


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("HYBRID_RESAMPLE_CACHE", str(tmp_path / "cache"))


def blobs(kind, rng):
    z, y, x = np.meshgrid(*(np.linspace(-1, 1, n) for n in (39, 42, 40)), indexing="ij")
    blob = 150 * np.exp(-4 * ((x - 0.3) ** 2 + y**2 + z**2)) + 9 * rng.normal(size=x.shape)
    values = blob.clip(0, 255).astype(kind)
    return Volume(values, np.array([1.0, 0.7, 1.3]), np.array([5.0, 0, -9]), np.eye(3), "blobs")


def in_bricks(volume, memory=ENOUGH):
    values = volume.values
    bricks = Bricks(values.__getitem__, values.shape, values.dtype, (16, 24, 8), memory=memory)
    return volume._replace(values=bricks)


def same(volume, look, resampler=ALONG_RAYS, **choices):
    """Whether a picture is the same of an array in memory and of one in a file."""
    streamed = in_bricks(volume, ENOUGH + volume.values.nbytes // 2)
    assert is_in_file(as_array(streamed).values)
    choices |= {"size": SIZE, "resampler": resampler}
    found, given = (render(each, look, **choices) for each in (streamed, volume))
    assert given.coverage.max() > 0.1
    for name in ("rgba", "depth", "first_depth", "coverage"):
        assert np.array_equal(getattr(found, name), getattr(given, name)), name
    if given.value is not None:
        assert np.array_equal(found.value, given.value, equal_nan=True)


# Bytes lie in 16 bits, for which all of a painter is compiled anew: composited they are tried.
BYTES = pytest.mark.sweep


@pytest.mark.sweep
@pytest.mark.parametrize(
    "kind", [pytest.param(np.uint8, marks=BYTES), *(np.int16, np.float32, np.float64, np.int32)]
)
def test_any_type_of_value_gives_its_bits(kind, rng):
    maximum = replace(ALONG_RAYS, projection=Projection.MAXIMUM)
    same(blobs(kind, rng), Appearance("50..150"), maximum)


@pytest.mark.sweep
@pytest.mark.parametrize("projection", ["minimum", "average", "additive", "first-hit"])
def test_projections_have_their_bits(projection, rng):
    iso = 100.0 if projection == "first-hit" else None
    resampler = replace(ALONG_RAYS, projection=Projection(projection), iso=iso)
    same(blobs(np.float32, rng), Appearance("50..150"), resampler)


@pytest.mark.sweep
@pytest.mark.parametrize(
    "look",
    [
        Appearance(SOLID, classification=Classification.POST, light=None),
        Appearance(SOLID, classification=Classification.POST, gradient_opacity=(0.1, 0.4)),
    ],
    ids=["unlit", "lit-faded"],
)
def test_fields_that_are_composited_have_their_bits(look, rng):
    same(blobs(np.uint8, rng), look)


@pytest.mark.sweep
def test_a_scene_of_a_volume_in_a_file_is_that_of_one_in_memory(rng):
    volume = blobs(np.uint8, rng)
    scene = Scene(in_bricks(volume))
    assert is_in_file(scene.volume.values)
    for look in ("50..150", Appearance(SOLID, classification=Classification.POST)):
        found, given = (each.render(look, size=SIZE) for each in (scene, Scene(volume)))
        assert np.array_equal(found.rgba, given.rgba)


@pytest.mark.some(1)
@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("projection", ["composite", "maximum", "average"])
def test_values_that_are_missing_are_filled_in_the_file(projection, kind, rng):
    volume = blobs(kind, rng)
    volume.values[:, :, :9] = np.nan
    volume.values[20:24, 5:30, 12:33] = np.inf
    volume.values[rng.random(volume.values.shape) < 0.01] = np.nan
    is_post = projection == "composite"
    look = Appearance(SOLID, classification=Classification.POST) if is_post else "50..150"
    same(volume, look, replace(ALONG_RAYS, projection=Projection(projection)))


def test_what_is_beside_the_file_has_to_fit(rng):
    volume = blobs(np.uint8, rng)
    with pytest.raises(
        ValueError, match=r"blobs is needed as a whole for this, with at least .* MiB of memory"
    ):
        as_array(in_bricks(volume, 100_000))


def test_voxels_that_are_painted_have_to_fit(rng):
    volume = in_bricks(blobs(np.uint8, rng), 420_000)
    with pytest.raises(ValueError, match=r"blobs with \d+ visible voxels need .* MiB are left"):
        render(volume, Appearance("1..150", classification="pre"), size=SIZE)


def test_a_disk_without_room_is_said_before_anything_is_read(rng, monkeypatch):
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage(10, 10, 0))
    bricks = in_bricks(blobs(np.uint8, rng))
    with pytest.raises(ValueError, match=r"blobs is .* cannot be kept in a file of .*are free"):
        as_array(bricks)
    assert bricks.values.reads == 0


@pytest.mark.sweep
def test_a_store_is_projected_within_little_memory(tmp_path, monkeypatch, capsys, rng):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("RESAMPLE_LOG", "info")
    np.save("a.npy", blobs(np.uint8, rng).values)
    assert ended(app, "convert", "a.npy", "a.ome.zarr", "--chunk", "16") == 0
    common = ["--projection", "maximum", "--size", "40", "--fit", "volume"]
    few = ["--memory", "450kB"]
    assert ended(app, "render", "a.npy", *common, "-o", "a.exr") == 0
    assert ended(app, "animate", "a.npy", *common, "--frames", "2", "-o", "a") == 0
    capsys.readouterr()
    assert ended(app, "render", "a.ome.zarr", *common, *few, "-o", "b.exr") == 0
    told = capsys.readouterr().err
    assert "a is needed as a whole and does not fit in 0.43 MiB of memory: it and its field" in told
    assert ended(app, "animate", "a.ome.zarr", *common, *few, "--frames", "2", "-o", "b") == 0
    assert np.array_equal(read_image("a.exr"), read_image("b.exr"))
    assert np.array_equal(read_image("a/frame-0001.png"), read_image("b/frame-0001.png"))
    assert list((tmp_path / "cache").glob("tmp*")) == []
    all_seen = [*common[:4], "--transfer", "0/white/0.1,255/white/0.1"]
    for name, more in {"a.npy": [], "a.ome.zarr": few}.items():
        assert ended(app, "render", name, *all_seen, *more, "-o", f"{name}.exr") == 0
    assert np.array_equal(read_image("a.npy.exr"), read_image("a.ome.zarr.exr"))
