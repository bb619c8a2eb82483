"""OME-Zarr and plain zarr arrays: read like any other file, and refused in one line."""

import json
import os
import pickle
import shutil
import zipfile
import zlib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import zarr
from hypothesis import given
from hypothesis import strategies as st

from resample.command.session import libraries
from resample.files.images import read_image
from resample_volume.calls import render
from resample_volume.cli import app
from resample_volume.data.recordings import alone, volume_at
from resample_volume.data.values import as_array
from resample_volume.files.source import (
    describe,
    find_reader,
    open_recording,
    open_streamed,
    open_volume,
    write_volume,
)
from resample_volume.types import Volume
from resample_zarr import volumes as zarr_files
from resample_zarr.pictures import open_picture
from resample_zarr.volumes import Zarr
from resample_zarr.writing import halved, per_axis
from tests.commands import ended, imported, refused

SPACING, ORIGIN = (0.5, 1.0, 2.25), (5.0, -6.0, 7.0)  # x, y, z
TURNED = np.array(((0.8, -0.6, 0), (0.6, 0.8, 0), (0, 0, 1)))
SPACE = [{"name": axis, "type": "space", "unit": "micrometer"} for axis in "zyx"]
VOXELS = ["--method", "hybrid"]  # windows are of them
BEFORE = [{"name": "t", "type": "time"}, {"name": "c", "type": "channel"}]


@pytest.fixture
def values(rng):
    return rng.integers(0, 60000, (10, 21, 34)).astype(np.uint16)


def levels_of(values, count=2):
    """Every second element along the axes of space, which is enough here."""
    found = [values]
    for _ in range(count - 1):
        found.append(found[-1][..., ::2, ::2, ::2])
    return found


def placed(count, per, *, translation=True, axes=3):
    """Transformations of a level whose voxels are so many times as large."""
    ones, zeros = [1.0] * (axes - 3), [0.0] * (axes - 3)
    found = [{"type": "scale", "scale": ones + [per * step for step in SPACING[::-1]]}]
    if translation:
        shift = [(per - 1) / 2 * step for step in SPACING[::-1]]
        start = [o + s for o, s in zip(ORIGIN[::-1], shift, strict=True)]
        found.append({"type": "translation", "translation": zeros + start})
    return {"path": str(count), "coordinateTransformations": found}


def written(path, values, version="0.5", *, chunks=(8, 8, 8), **changes):
    """Store of a version with two levels; `changes` are of its image."""
    form = 3 if version == "0.5" else 2
    group = zarr.open_group(path, mode="w", zarr_format=form)
    axes = BEFORE[5 - values.ndim :] + SPACE
    image = {"axes": axes, "datasets": [placed(n, 2**n, axes=values.ndim) for n in range(2)]}
    if version != "0.5":
        image["version"] = version
    image |= changes
    for n, level in enumerate(levels_of(values)):
        many = (1,) * (values.ndim - 3) + chunks
        held = group.create_array(str(n), shape=level.shape, chunks=many, dtype=level.dtype)
        held[...] = level
    told = {"multiscales": [image]}
    group.attrs.update({"ome": {"version": version, **told}} if version == "0.5" else told)
    return path


def zipped(folder, path):
    with zipfile.ZipFile(path, "w") as packed:
        for file in sorted(folder.rglob("*")):
            if file.is_file():
                packed.write(file, file.relative_to(folder.parent))
    return path


@pytest.mark.parametrize("version", ["0.4", "0.5"])
def test_both_versions_are_read_bit_by_bit_in_their_place(version, values, tmp_path):
    found = open_volume(written(tmp_path / "a.ome.zarr", values, version))
    assert found.name == "a"
    assert found.values.dtype == np.uint16
    assert np.array_equal(found.values, values)
    assert found.spacing.tolist() == list(SPACING)
    assert found.origin.tolist() == list(ORIGIN)
    assert found.direction.tolist() == np.eye(3).tolist()


def test_a_zipped_store_is_read_also_from_a_folder_within(values, tmp_path):
    written(tmp_path / "a.ome.zarr", values)
    path = zipped(tmp_path / "a.ome.zarr", tmp_path / "b.zarr.zip")
    assert np.array_equal(open_volume(path).values, values)


def test_a_folder_is_known_by_what_it_holds(values, tmp_path):
    path = written(tmp_path / "scan", values)
    assert isinstance(find_reader(path), Zarr)
    assert np.array_equal(open_volume(path).values, values)


def test_a_coarser_level_is_chosen_and_its_loss_is_told(values, tmp_path):
    path = written(tmp_path / "a.zarr", values)
    found = Zarr(level=1)(path)
    assert np.array_equal(found.values, values[::2, ::2, ::2])
    assert found.spacing.tolist() == [1.0, 2.0, 4.5]
    assert found.origin.tolist() == [5.25, -5.5, 8.125]
    assert found.note.startswith("level 1 of 0 to 1 (1) has 17 x 11 x 5 voxels")
    assert "27 to 44 dB" in found.note


def test_a_level_without_a_place_is_taken_for_means(values, tmp_path):
    sets = [placed(0, 1), placed(1, 2, translation=False)]
    path = written(tmp_path / "a.zarr", values, datasets=sets)
    found = Zarr(level=1)(path)
    assert found.origin.tolist() == [5.25, -5.5, 8.125]
    assert "whose place the file does not tell" in found.note


@pytest.mark.sweep
def test_a_coarser_level_keeps_the_thickness_that_opacities_hold_for(values, tmp_path):
    sets = [placed(0, 1), placed(1, 2)]
    path = written(tmp_path / "a.zarr", np.full_like(values, 7), datasets=sets)
    coarse, size = Zarr(level=1)(path), (16, 16)
    look = "0/white/0.3,9/white/0.3"
    kept = render(coarse, look, size=size)
    own = render(coarse._replace(thickness=0.0), look, size=size)
    assert coarse.thickness == pytest.approx(np.cbrt(np.prod(SPACING)))
    assert kept.rgba[8, 8, 3] > own.rgba[8, 8, 3]


def test_transformations_of_the_image_come_after_those_of_a_level(values, tmp_path):
    after = [
        {"type": "scale", "scale": [10.0, 10.0, 10.0]},
        {"type": "translation", "translation": [3.0, 2.0, 1.0]},
    ]
    found = open_volume(written(tmp_path / "a.zarr", values, coordinateTransformations=after))
    assert found.spacing.tolist() == [5.0, 10.0, 22.5]
    assert found.origin.tolist() == [51.0, -58.0, 73.0]


@pytest.mark.sweep
def test_times_and_channels_are_chosen_as_of_other_files(rng, tmp_path):
    values = rng.integers(0, 255, (3, 2, 5, 6, 7)).astype(np.uint8)
    path = written(tmp_path / "a.zarr", values, chunks=(4, 4, 4))
    with pytest.raises(ValueError, match="choose one by time, 0 to 2"):
        open_volume(path)
    assert np.array_equal(open_recording(path).values, values)
    for held in (open_recording(path), open_streamed(path)):
        found = volume_at(held, 2, 1)
        assert found.name == "a (time 2, channel 1)"
        assert np.array_equal(as_array(found).values, values[2, 1])


def test_channels_alone_are_chosen_by_either_word(rng, tmp_path):
    values = rng.integers(0, 255, (3, 5, 6, 7)).astype(np.uint8)
    path = written(tmp_path / "a.zarr", values, chunks=(4, 4, 4))
    held = open_streamed(path)
    assert np.array_equal(as_array(volume_at(held, None, 2)).values, values[2])
    assert np.array_equal(as_array(volume_at(held, 1, None)).values, values[1])


def test_axes_in_another_order_are_put_right(values, tmp_path):
    turned = np.ascontiguousarray(values.transpose(2, 1, 0))
    steps = [{"type": "scale", "scale": list(SPACING)}]
    sets = [{"path": str(n), "coordinateTransformations": steps} for n in range(2)]
    path = written(tmp_path / "a.zarr", turned, axes=SPACE[::-1], datasets=sets)
    found = open_volume(path)
    assert np.array_equal(found.values, values)
    assert found.spacing.tolist() == list(SPACING)


def test_lengths_are_in_the_unit_of_x(values, tmp_path):
    axes = [{**SPACE[0], "unit": "millimeter"}, *SPACE[1:]]
    found = open_volume(written(tmp_path / "a.zarr", values, axes=axes))
    np.testing.assert_allclose(found.spacing, (0.5, 1.0, 2250.0))
    np.testing.assert_allclose(found.origin, (5.0, -6.0, 7000.0))


@pytest.mark.parametrize("form", [2, 3])
def test_plain_arrays_are_read_with_a_spacing(form, values, tmp_path):
    path = tmp_path / "a.zarr"
    held = zarr.create_array(
        path, shape=values.shape, dtype=">u2", chunks=(4, 9, 9), zarr_format=form
    )
    held[...] = values
    found = Zarr(spacing="1x2x3")(path)
    assert np.array_equal(found.values, values)
    assert found.values.dtype.isnative
    assert found.spacing.tolist() == [1.0, 2.0, 3.0]


def test_a_chunk_that_is_missing_is_the_fill_value(tmp_path):
    path = tmp_path / "a.zarr"
    held = zarr.create_array(path, shape=(8, 8, 8), dtype="uint8", chunks=(4, 4, 4), fill_value=9)
    held[:4] = 1
    found = open_volume(path).values
    assert (found[:4] == 1).all()
    assert (found[4:] == 9).all()


@pytest.mark.sweep
def test_shards_are_read(values, tmp_path):
    path = tmp_path / "a.zarr"
    held = zarr.create_array(
        path, shape=values.shape, dtype="uint16", chunks=(4, 4, 4), shards=(8, 16, 16)
    )
    held[...] = values
    assert np.array_equal(open_volume(path).values, values)


@pytest.mark.sweep
@pytest.mark.parametrize("brick", [None, (5, 7, 11), (64, 64, 64)])
@pytest.mark.parametrize("kind", ["uint8", "int16", "int32", "float32"])
def test_what_is_known_of_bricks_is_what_is_known_of_the_array(kind, brick, rng, tmp_path):
    values = rng.normal(90, 20, (19, 20, 41)).clip(0, 200).astype(kind)
    if kind == "float32":
        values[3, 4, 5], values[9, :2], values[0, 0, 0] = np.inf, np.nan, 1e9
    values[5, 5, 5] = 30000 if kind in ("int16", "int32") else 201
    path = tmp_path / "a.zarr"
    zarr.create_array(path, data=values, chunks=(8, 8, 8))
    streamed = volume_at(Zarr().streamed(path, brick=brick), None, None)
    assert describe(streamed) == describe(alone(open_recording(path)))
    assert np.array_equal(as_array(streamed).values, values, equal_nan=True)


@pytest.mark.sweep
def test_all_commands_take_a_store(values, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    written(tmp_path / "a.ome.zarr", values, "0.4")
    common = ["a.ome.zarr", "--size", "24"]
    assert ended(app, "render", *common, "-o", "a.png") == 0
    assert ended(app, "render", *common, "--level", "1", "-o", "b.png") == 0
    assert "level 1 of 0 to 1" in capsys.readouterr().err
    assert ended(app, "animate", *common, "--frames", "2", "-o", "a.gif") == 0
    assert ended(app, "compare", *common, "--methods", "splats") == 0
    capsys.readouterr()
    assert ended(app, "info", "a.ome.zarr") == 0
    assert "level 1      (17, 11, 5), spacing [1.0, 2.0, 4.5]" in capsys.readouterr().out
    assert ended(app, "info", "a.ome.zarr", "--json", "--level", "1") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["shape"] == [17, 11, 5]
    assert [level["shape"] for level in told["levels"]] == [[34, 21, 10], [17, 11, 5]]


# What is refused


def test_a_file_of_another_format_has_no_levels(tmp_path, monkeypatch, capsys, values):
    monkeypatch.chdir(tmp_path)
    np.save("a.npy", values)
    error = refused(app, capsys, "render", "a.npy", "--level", "1", "-o", "a.png")
    assert "level chooses a size of an OME-Zarr" in error


def test_a_level_of_other_dimensions_than_its_axes_is_refused(values, tmp_path):
    path = written(tmp_path / "a.zarr", values)
    zarr.open_group(path).create_array("1", data=values[np.newaxis], overwrite=True)
    with pytest.raises(ValueError, match=r"a/1 has 4 dimensions, its metadata zyx"):
        Zarr(level=1)(path)


def test_a_level_that_there_is_not_is_refused(values, tmp_path):
    with pytest.raises(ValueError, match=r"a has 2 levels, 0 \(the finest\) to 1; .* level 2"):
        Zarr(level=2)(written(tmp_path / "a.zarr", values))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"axes": SPACE[1:]}, "a has the axes y, x; wanted are z, y and x once each"),
        ({"axes": [{"name": "q"}, *SPACE]}, "a has an axis 'q' of type None; known are time"),
        ({"datasets": []}, "a, multiscales: datasets: List should have at least 1 item"),
        ({"datasets": [{"path": "0"}]}, "datasets.0.coordinateTransformations: Field required"),
        (
            {"axes": [{**SPACE[0], "unit": "parsec"}, *SPACE[1:]]},
            "lengths along z are in parsec, along x in micrometer; give both the same unit",
        ),
        (
            {"coordinateTransformations": [{"type": "scale", "scale": [1.0, 2.0]}]},
            r"a/0, scale: \[1.0, 2.0\] are not 3 numbers",
        ),
    ],
)
def test_metadata_that_are_not_as_they_should_be_are_refused(changes, message, values, tmp_path):
    with pytest.raises(ValueError, match=message) as caught:
        open_volume(written(tmp_path / "a.zarr", values, **changes))
    assert "\n" not in str(caught.value)


PICKLE, TEXT = {"id": "pickle"}, {"id": "vlen-utf8"}


@pytest.mark.parametrize(
    ("compressor", "filters", "dtype", "message"),
    [
        (PICKLE, None, "|u1", "a.zarr is not zarr, or damaged"),
        (None, [PICKLE], "|u1", "a.zarr is not zarr, or damaged"),
        (
            None,
            [{"id": "shuffle", "elementsize": 1}, PICKLE],
            "|u1",
            "a.zarr is not zarr, or damaged",
        ),
        (None, [PICKLE], "|O", "a.zarr is not zarr, or damaged"),
        (None, [TEXT], "|O", "a has voxels of type StringDType"),
    ],
)
def test_objects_of_python_are_never_made_of_a_store(compressor, filters, dtype, message, tmp_path):
    class Harmful:
        def __reduce__(self):
            return (Path.touch, (tmp_path / "harmed",))

    store = tmp_path / "a.zarr"
    store.mkdir()
    told = {"shape": [8, 8, 8], "chunks": [8, 8, 8], "dtype": dtype, "fill_value": 0, "order": "C"}
    told |= {"zarr_format": 2, "compressor": compressor, "filters": filters}
    (store / ".zarray").write_text(json.dumps(told))
    (store / "0.0.0").write_bytes(pickle.dumps(Harmful()))
    with pytest.raises(ValueError, match=message):
        open_volume(store)
    assert not (tmp_path / "harmed").exists()


def packed_store(path, shape, chunks, data):
    """Array of bytes of zarr 2, of one chunk."""
    path.mkdir()
    told = {"shape": shape, "chunks": chunks, "dtype": "|u1", "fill_value": 0, "order": "C"}
    told |= {"zarr_format": 2, "compressor": {"id": "zlib", "level": 9}, "filters": None}
    (path / ".zarray").write_text(json.dumps(told))
    (path / ".".join("0" * len(shape))).write_bytes(zlib.compress(data, 9))
    return path


@pytest.mark.sweep
def test_a_chunk_that_holds_far_more_than_its_values_is_not_unpacked(tmp_path):
    found = open_volume(packed_store(tmp_path / "a.zarr", [8] * 3, [8] * 3, bytes(512)))
    assert found.values.shape == (8, 8, 8)
    bomb = packed_store(tmp_path / "b.zarr", [8] * 3, [8] * 3, bytes(20 << 20))
    with pytest.raises(ValueError, match=r"its chunk 0\.0\.0 takes 0\.02 MiB, but its values"):
        open_volume(bomb)
    huge = packed_store(tmp_path / "c.zarr", [8] * 3, [100_000] * 3, bytes(512))
    with pytest.raises(ValueError, match="a chunk of c"):
        open_volume(huge)
    picture = packed_store(tmp_path / "d.zarr", [8, 8], [8, 8], bytes(20 << 20))
    with pytest.raises(ValueError, match=r"its chunk 0\.0 takes"):
        open_picture(picture).levels()


def test_another_version_is_refused(values, tmp_path):
    with pytest.raises(ValueError, match=r"a is of OME-Zarr 0.3; 0.4 and 0.5 are supported"):
        open_volume(written(tmp_path / "a.zarr", values, "0.3"))


def test_a_wrong_shape_in_the_metadata_is_refused_in_a_line(values, tmp_path):
    path = written(tmp_path / "a.zarr", values)
    text = json.loads((path / "0" / "zarr.json").read_text())
    (path / "0" / "zarr.json").write_text(json.dumps({**text, "shape": [10, 21]}))
    with pytest.raises(ValueError, match=r"a/0 is not zarr, or damaged: ") as caught:
        open_volume(path)
    assert "\n" not in str(caught.value)


@pytest.mark.sweep
def test_a_damaged_chunk_is_named_in_a_line(values, tmp_path):
    path = written(tmp_path / "a.zarr", values)
    chunk = path / "0" / "c" / "0" / "0" / "0"
    chunk.write_bytes(chunk.read_bytes()[:20])
    with pytest.raises(ValueError, match="0 is not zarr, or damaged") as caught:
        open_volume(path)
    assert "\n" not in str(caught.value)


def test_a_level_that_is_missing_is_named(values, tmp_path):
    path = written(tmp_path / "a.zarr", values)
    shutil.rmtree(path / "0")
    with pytest.raises(ValueError, match="a names a level '0', which is not there"):
        open_volume(path)


def test_a_zip_file_of_something_else_is_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as packed:
        packed.writestr("notes.txt", "nothing")
    with pytest.raises(ValueError, match=r"a.zip is not zarr, or damaged: there is no zarr.json"):
        open_volume(tmp_path / "a.zip")
    (tmp_path / "b.zip").write_text("nothing")
    with pytest.raises(ValueError, match=r"b.zip is not zarr, or damaged: File is not a zip file"):
        open_volume(tmp_path / "b.zip")


def test_a_group_of_other_things_lists_them(tmp_path):
    group = zarr.open_group(tmp_path / "a.zarr", mode="w")
    group.create_array("density", shape=(4, 4, 4), dtype="uint8")
    with pytest.raises(ValueError, match=r"a is a group without multiscales.*\(density\)"):
        open_volume(tmp_path / "a.zarr")
    assert open_volume(tmp_path / "a.zarr" / "density").name == "density"


@pytest.mark.sweep
def test_zarr_is_not_imported_before_a_store_is_read():
    assert "zarr" not in imported("resample_volume.cli", "fetch")


# Written


def converted(name, *words):
    assert ended(app, "convert", name, "b.ome.zarr", *words) == 0
    return open_recording(Path("b.ome.zarr"))


def same(found, given):
    assert found.values.dtype == given.values.dtype.newbyteorder("=")
    assert np.array_equal(found.values, given.values, equal_nan=given.values.dtype.kind == "f")
    for name in ("spacing", "origin", "direction"):
        assert np.array_equal(getattr(found, name), getattr(given, name))
    assert (found.units, found.space, found.is_color) == (given.units, given.space, given.is_color)


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.some(1)
@pytest.mark.parametrize(
    "kind", ["uint8", "int8", "uint16", "int16", "int32", "float32", "float64"]
)
def test_a_converted_volume_comes_back_bit_by_bit(kind, rng):
    values = (rng.normal(0, 40, (20, 33, 71))).astype(kind)
    if kind.startswith("float"):
        values[3, 4, :9] = np.nan
    write_volume(
        Path("a.nrrd"),
        Volume(values, np.array([0.1, 0.7, 3.3]), np.array([1 / 3, -5, 7]), TURNED, "a"),
    )
    same(converted("a.nrrd"), open_recording("a.nrrd"))


@pytest.mark.some(1)
@pytest.mark.parametrize(
    "words",
    [
        ("--chunk", "16"),
        ("--chunk", "16", "--shard", "32"),
        ("--compression", "blosc"),
        ("--compression", "none", "--no-levels"),
    ],
)
def test_however_chunks_lie_values_are_the_same(words, values):
    np.save("a.npy", values)
    same(converted("a.npy", *words), open_recording("a.npy"))


def test_times_channels_and_colors_come_back(rng):
    np.save("a.npy", rng.integers(0, 255, (3, 2, 5, 6, 7)).astype(np.uint8))
    same(converted("a.npy"), open_recording("a.npy"))
    shutil.rmtree("b.ome.zarr")
    one = converted("a.npy", "--time", "1", "--channel", "0")
    assert np.array_equal(one.values[0, 0], np.load("a.npy", allow_pickle=False)[1, 0])
    shutil.rmtree("b.ome.zarr")
    np.save("a.npy", rng.integers(0, 255, (5, 6, 7, 3)).astype(np.uint8))
    same(converted("a.npy"), open_recording("a.npy"))
    assert open_volume("b.ome.zarr").colors.shape == (5, 6, 7, 3)


@pytest.mark.sweep
def test_a_store_is_converted_to_a_store(values, here):
    written(here / "a.ome.zarr", values, "0.4")
    same(converted("a.ome.zarr", "--chunk", "8"), open_recording("a.ome.zarr"))


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("kind", "shape"),
    [
        ("uint8", (3, 90, 128)),
        ("float32", (70, 130, 65)),
        *(
            pytest.param(*each, marks=pytest.mark.sweep)
            for each in [
                ("uint8", (70, 130, 65)),
                ("int16", (70, 130, 65)),
                ("int16", (3, 90, 128)),
                ("float32", (3, 90, 128)),
            ]
        ),
    ],
)
def test_levels_are_means_of_two_along_each_axis(shape, kind, rng):
    values = rng.normal(0, 40, shape).astype(kind)
    np.save("a.npy", values)
    converted("a.npy", "--chunk", "16", "--spacing", "1x1x2")
    finest, coarser = Zarr()(Path("b.ome.zarr")), Zarr(level=1)(Path("b.ome.zarr"))
    for at in np.ndindex(*coarser.values.shape):
        block = values[tuple(slice(2 * n, 2 * n + 2) for n in at)].astype(np.float64)
        mean = np.rint(block.mean()) if kind != "float32" else np.float32(block.mean())
        assert coarser.values[at] == mean
        if sum(at) > 9:
            break
    assert np.array_equal(coarser.spacing, 2 * finest.spacing)
    assert np.array_equal(coarser.origin, finest.origin + finest.spacing / 2)


@pytest.mark.sweep
@given(shape=st.tuples(*[st.integers(2, 7)] * 3), kind=st.sampled_from(["uint8", "int16"]))
def test_means_are_those_of_blocks(shape, kind):
    values = np.random.default_rng(sum(shape)).integers(0, 250, shape).astype(kind)
    per = per_axis(shape)
    found = halved(values, per)
    for at in np.ndindex(*found.shape):
        block = values[tuple(slice(p * n, p * n + p) for n, p in zip(at, per, strict=True))]
        assert found[at] == np.rint(block.astype(np.float64).mean())


def test_means_leave_out_what_is_missing():
    values = np.full((4, 4, 4), np.nan, np.float32)
    values[0, 0, :2], values[2, 2, 2] = (1, 3), np.inf
    found = halved(values, (2, 2, 2))
    assert found[0, 0, 0] == 2
    assert np.isnan(found).sum() == 7


@pytest.mark.sweep
def test_a_volume_that_cannot_be_read_to_its_end_leaves_no_store(values, here, capsys):
    path = written(here / "a.ome.zarr", values)
    chunk = path / "0" / "c" / "1" / "0" / "0"
    chunk.write_bytes(chunk.read_bytes()[:20])
    error = refused(app, capsys, "convert", "a.ome.zarr", "b.ome.zarr", "--chunk", "8")
    assert "0 is not zarr, or damaged" in error


def test_a_full_disk_leaves_no_store(capsys, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("resample_zarr.writing.halved", full)
    np.save("a.npy", np.zeros((4, 4, 130), np.uint8))
    error = refused(app, capsys, "convert", "a.npy", "b.ome.zarr", "--spacing", "1x1x1")
    assert error == ("resample: error: b.ome.zarr: cannot be written: No space left on device\n")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["a.npy", "a.ome.zarr"], "a.ome.zarr already exists; remove it or give another name"),
        (["a.npy", "b.nrrd"], "b.nrrd: volumes are converted to OME-Zarr"),
        (["a.npy", "no/b.zarr"], "no: there is no such folder"),
        (["a.npy", "b.zarr", "--chunk", "4"], "chunks of 4 voxels; their sides are 8 or more"),
        (["a.npy", "b.zarr", "--shard", "100"], "shards of 100 voxels are not of whole chunks"),
    ],
)
def test_what_cannot_be_converted_is_refused_in_a_line(words, message, values, here, capsys):
    np.save("a.npy", values)
    written(here / "a.ome.zarr", values)
    assert message in refused(app, capsys, "convert", *words)


# Beyond memory


@pytest.mark.sweep
def test_a_store_renders_the_same_bits_as_the_file_that_it_was_made_of(capsys):
    assert ended(app, "generate", "vessel-tree:size=72", "-o", "a.npy") == 0
    assert ended(app, "convert", "a.npy", "b.ome.zarr", "--chunk", "16") == 0
    common = ["--size", "64", "--camera", "30/20/1.3", "--axes"]
    for name in ("a.npy", "b.ome.zarr"):
        assert ended(app, "render", name, *common, "-o", f"{name}.exr") == 0
    a, b = (read_image(f"{name}.exr") for name in ("a.npy", "b.ome.zarr"))
    assert np.array_equal(a, b)
    told = capsys.readouterr().err
    assert "b: 72 x 72 x 72 voxels are read brick by brick (8), within" in told


@pytest.mark.sweep
def test_a_store_larger_than_memory_has_the_same_bits():
    smoke = np.random.default_rng(5).integers(0, 200, (320, 60, 64)).astype(np.uint8)
    np.save("a.npy", smoke)
    assert ended(app, "convert", "a.npy", "b.zarr", "--chunk", "16") == 0
    common = ["--size", "96", "--transfer", "150..190", "--camera", "30/10/1.3"]
    common += ["--fit", "volume"]
    assert ended(app, "render", "a.npy", *common, "-o", "a.exr") == 0
    few = ["--memory", "2500kB"]
    assert ended(app, "render", "b.zarr", *common, *few, "-o", "b.exr", "--stats", "b.json") == 0
    assert np.array_equal(read_image("a.exr"), read_image("b.exr"))
    assert json.loads(Path("b.json").read_text())["seconds"]["paint"] > 0
    cuts = [*common[:-2], "--crop", "2:,:,9:300", "--clip", "1/1/0", "--depth-cue", ".7"]
    assert ended(app, "render", "a.npy", *cuts, "-o", "a.exr") == 0
    assert ended(app, "render", "b.zarr", *cuts, *few, "-o", "b.exr") == 0
    assert np.array_equal(read_image("a.exr"), read_image("b.exr"))
    walls = ["--gradient-opacity", ".1/.6", "--threads", "1", "--ambient-occlusion"]
    tissue = np.random.default_rng(6).integers(0, 4, (320, 60, 64)).astype(np.uint8)
    np.save("labels.npy", tissue)
    assert ended(app, "convert", "labels.npy", "labels.zarr", "--chunk", "32") == 0
    rules = ["--label", "1:color=tomato", "--label", "2:hidden", "--labels"]
    surfaces = [*common[:3], "20..190", *common[4:], *walls, *rules]
    assert ended(app, "render", "a.npy", *surfaces, "labels.npy", "-o", "a.exr") == 0
    more = ["--memory", "70MB"]
    assert ended(app, "render", "b.zarr", *surfaces, "labels.zarr", *more, "-o", "b.exr") == 0
    assert np.array_equal(read_image("a.exr"), read_image("b.exr"))
    deep = [*common, "--deep", "4", "--workers", "1"]
    assert ended(app, "render", "b.zarr", *deep, "--memory", "6MB", "-o", "c.exr") == 0


def frames(folder):
    return [path.read_bytes() for path in sorted(Path(folder).glob("*.png"))]


@pytest.mark.sweep
def test_films_of_stores_larger_than_memory_have_the_same_frames(capsys):
    np.save("a.npy", np.random.default_rng(5).integers(0, 200, (60, 60, 320)).astype(np.uint8))
    assert ended(app, "convert", "a.npy", "b.zarr", "--chunk", "16") == 0
    common = ["--size", "48", "--transfer", "150..190", "--crop", ":,20:,:", "--frames", "2"]
    few = ["--memory", "7MB"]
    assert ended(app, "animate", "a.npy", *common, "-o", "a") == 0
    assert ended(app, "animate", "b.zarr", *common, *few, "-o", "b") == 0
    assert frames("a") == frames("b")
    (Path("b") / "frame-0001.png").unlink()
    assert ended(app, "animate", "b.zarr", *common, *few, "-o", "b", "--resume") == 0
    assert frames("a") == frames("b")
    for other in (
        [*common[:3], "100..190", *common[4:], *few],
        [*common, *few[:1], "90MB", "--gradient-opacity", ".1/.6"],
        [*common, *few[:1], "90MB", "--labels", "a.npy"],
    ):
        assert ended(app, "animate", "b.zarr", *other, "-o", "b", "--resume") == 2
        assert "holds frames of another animation" in capsys.readouterr().err


@pytest.mark.sweep
def test_commands_that_share_their_work_write_the_same_pixels():
    np.save("a.npy", np.random.default_rng(5).integers(0, 200, (60, 60, 320)).astype(np.uint8))
    assert ended(app, "convert", "a.npy", "b.zarr", "--chunk", "16") == 0
    common = ["--size", "48", "--transfer", "150..190", "--fit", "volume"]
    assert ended(app, "render", "a.npy", *common, "-o", "a.exr") == 0
    assert ended(app, "animate", "a.npy", *common, "--frames", "4", "-o", "a") == 0
    for workers in "123":
        few = ["--memory", f"{24 * int(workers)}MB", "--workers", workers]
        assert ended(app, "render", "b.zarr", *common, *few, "-o", "b.exr") == 0
        assert np.array_equal(read_image("a.exr"), read_image("b.exr"))
        shared = [*common, "--frames", "4", *few, "-o", workers]
        assert ended(app, "animate", "b.zarr", *shared) == 0
        assert frames("a") == frames(workers)
    assert sorted(os.listdir()) == ["1", "2", "3", "a", "a.exr", "a.npy", "b.exr", "b.zarr"]


def test_work_that_cannot_be_shared_is_refused_in_a_line(values, capsys):
    written(Path("a.zarr"), values)
    np.save("a.npy", values)
    words = ["--size", "16", "-o", "a.png", "--workers", "2"]
    for name, more, message in (
        ("a.npy", [], "workers read chunks of a volume, and a is in memory"),
        ("a.zarr", ["--scheduler", "tcp://localhost:1"], "give only one"),
        ("a.zarr", ["--method", "hybrid"], "workers share rays through volumes"),
    ):
        assert ended(app, "render", name, *words, *more) == 2
        assert message in capsys.readouterr().err
        assert not Path("a.png").exists()


@pytest.mark.sweep
def test_memory_that_does_not_do_is_refused_in_a_line(values, capsys):
    written(Path("a.zarr"), values)
    np.save("a.npy", values)
    common = ["--size", "16", "-o", "a.png", "--memory", "10kB"]
    assert ended(app, "render", "a.zarr", *common) == 2
    error = capsys.readouterr().err
    assert "a is needed as a whole for this, with at least 0.04 MiB of memory" in error
    assert "0.01 MiB are allowed: give more memory or a coarser level" in error
    assert not Path("a.png").exists()
    error = refused(app, capsys, "render", "a.npy", *common)
    needed = f"{libraries() / (1 << 30):.2f}"
    assert (
        f"a needs about {needed} GiB of memory, --memory allows 0.01 MiB; take a smaller" in error
    )
    error = refused(app, capsys, "render", "a.zarr", *common[:-1], "much")
    assert "'much' is not an amount of memory; give one such as 2GiB" in error


def test_a_store_that_is_being_written_does_not_look_whole(monkeypatch):
    np.save("a.npy", np.zeros((4, 4, 130), np.uint8))
    seen = []

    def killed(*_):
        (half,) = Path().glob(".b.ome.tmp-*.zarr")
        with pytest.raises(ValueError, match="group without multiscales"):
            open_volume(half)
        seen.append(Path("b.ome.zarr").exists())
        raise ValueError("killed")

    monkeypatch.setattr("resample_zarr.writing.halved", killed)
    assert ended(app, "convert", "a.npy", "b.ome.zarr") == 2
    assert seen == [False]
    assert not list(Path().glob("*b.ome*"))


@pytest.mark.parametrize("shape", [(0, 2, 2, 2), (0, 2, 2, 2, 2), (2, 0, 2, 2, 2)])
@pytest.mark.parametrize("read", [open_recording, open_streamed])
def test_stores_of_no_times_or_channels_are_refused(read, shape, tmp_path):
    chunks = tuple(max(1, count) for count in shape)
    zarr.create_array(tmp_path / "a.zarr", shape=shape, dtype="u1", chunks=chunks)
    with pytest.raises(ValueError, match=r"a is empty: . times, . numbers at each voxel"):
        read(tmp_path / "a.zarr")


@pytest.mark.parametrize(
    ("tag", "changed", "is_web", "is_told"),
    [
        ("a", 0.0, False, True),
        ("a", 0.0, True, True),
        ("", 0.0, True, False),
        ("", 5.0, True, True),
        ("", 5.0, False, False),
        ("W/a", 0.0, True, False),
        ("W/a", 5.0, True, True),
    ],
)
def test_what_is_kept_of_a_store_needs_tags_or_times_of_a_web_server(tag, changed, is_web, is_told):
    metadata = SimpleNamespace(to_dict=dict)
    portion = SimpleNamespace(array=SimpleNamespace(metadata=metadata))
    chunk = SimpleNamespace(tag=tag, changed=changed, name="0/0", size=9)
    state = zarr_files._state(portion, iter([chunk]), is_web=is_web)
    assert (state is not None) is is_told
