"""Stores of zarr that nobody vouches for: small ones that become gigabytes, links, pipes, gaps."""

import bz2
import gzip
import json
import lzma
import os
import pickle
import struct
import sys
import zipfile
import zlib
from functools import partial
from subprocess import run

import numpy as np
import pytest
import zarr

from resample.files.pictures import read_picture
from resample_volume.cli import app
from resample_volume.data.recordings import volume_at
from resample_volume.files.source import describe, open_streamed, open_volume
from resample_zarr import guarding
from resample_zarr import metadata as holes
from tests import commands
from tests.processes import PATIENCE

SHAPE = [8, 8, 8]
SMALL = np.arange(512, dtype=np.uint8).reshape(SHAPE)
CHUNK = SMALL.tobytes()
BOMB = bytes(3 << 20)
BYTES = {"name": "bytes"}
CODECS = ["zlib", "gzip", "bz2", "lzma", "zstd", "blosc", "lz4"]
OF_ZARR_3 = {"gzip": {"level": 1}, "zstd": {"level": 1, "checksum": False}}
OF_ZARR_3 |= {"blosc": {"cname": "zstd", "clevel": 5, "shuffle": "shuffle", "typesize": 1}}
OF_ZARR_3["blosc"]["blocksize"] = 0


def told(codec=None, shape=SHAPE, chunks=SHAPE, filters=None):
    compressor = codec and {"id": codec, **({"format": 1} if codec == "lzma" else {})}
    facts = {"shape": shape, "chunks": chunks, "dtype": "|u1", "fill_value": 0, "order": "C"}
    facts |= {"zarr_format": 2, "compressor": compressor, "filters": filters}
    return json.dumps(facts)


def store(path, chunk=CHUNK, **facts):
    """Array of bytes of zarr 2, of one chunk."""
    path.mkdir()
    (path / ".zarray").write_text(told(**facts))
    if chunk is not None:
        (path / "0.0.0").write_bytes(chunk)
    return path


def zstd(count, *, tells):
    """A frame of Zstandard that becomes so many zeros, whether it tells how many or not."""
    head = b"\x28\xb5\x2f\xfd" + (b"\xc0\x38" + struct.pack("<Q", count) if tells else b"\0\x38")
    sizes = [1 << 17] * (count >> 17)
    blocks = [(size << 3 | 2 | (n == len(sizes) - 1)) for n, size in enumerate(sizes)]
    return head + b"".join(block.to_bytes(3, "little") + b"\0" for block in blocks)


def packed(codec, data):
    """Data packed for a codec of zarr."""
    from numcodecs import LZ4, Blosc, Zstd

    packing = {
        "zlib": zlib.compress,
        "gzip": gzip.compress,
        "bz2": bz2.compress,
        "lzma": partial(lzma.compress, preset=0),
        "zstd": Zstd().encode,
        "blosc": Blosc("zstd").encode,
        "lz4": LZ4().encode,
    }
    return packing[codec](data)


def zipped(path, chunk=CHUNK, metadata="", by=zipfile.ZIP_DEFLATED):
    with zipfile.ZipFile(path, "w") as file:
        file.writestr(".zarray", metadata or told(), by if metadata else zipfile.ZIP_STORED)
        file.writestr("0.0.0", chunk, by)
    return path


@pytest.mark.some(6)
@pytest.mark.parametrize("codec", [*CODECS, "zstd without size"])
def test_a_chunk_that_unpacks_to_far_more_than_its_values_is_refused(codec, tmp_path):
    bomb = zstd(4 << 20, tells=False) if " " in codec else packed(codec, BOMB)
    path = store(tmp_path / "a.zarr", bomb, codec=codec.partition(" ")[0], shape=[64] * 3)
    (path / ".zarray").write_text(told(codec.partition(" ")[0], [64] * 3, [64] * 3))
    with pytest.raises(ValueError, match=r"a chunk, whose values take 0.25 MiB: it unpacks to"):
        open_volume(path)


def test_a_codec_among_the_filters_is_bounded_too(tmp_path):
    path = store(tmp_path / "a.zarr", packed("zlib", BOMB))
    (path / ".zarray").write_text(told(filters=[{"id": "zlib", "level": 1}]))
    with pytest.raises(ValueError, match="it unpacks to more than"):
        open_volume(path)


@pytest.mark.sweep
def test_a_bomb_within_packed_data_is_refused(tmp_path):
    twice = packed("zlib", packed("zlib", bytes(20 << 20)))
    path = store(tmp_path / "a.zarr", twice, codec="zlib")
    (path / ".zarray").write_text(told("zlib", filters=[{"id": "zlib", "level": 1}]))
    with pytest.raises(ValueError, match="it unpacks to more than"):
        open_volume(path)


def of_zarr_3(path, codecs, chunk):
    grid = {"name": "regular", "configuration": {"chunk_shape": SHAPE}}
    facts = {"zarr_format": 3, "node_type": "array", "shape": SHAPE, "data_type": "uint8"}
    facts |= {"chunk_grid": grid, "fill_value": 0, "attributes": {}, "codecs": codecs}
    facts["chunk_key_encoding"] = {"name": "default", "configuration": {"separator": "/"}}
    (path / "c/0/0").mkdir(parents=True)
    (path / "zarr.json").write_text(json.dumps(facts))
    (path / "c/0/0/0").write_bytes(chunk)
    return path


@pytest.mark.some(3)
@pytest.mark.parametrize("codec", [*OF_ZARR_3, "numcodecs.bz2", "numcodecs.lzma"])
def test_codecs_of_zarr_3_are_bounded(codec, tmp_path):
    chosen = {"name": codec, "configuration": OF_ZARR_3.get(codec, {})}
    bomb = packed(codec.removeprefix("numcodecs."), BOMB)
    path = of_zarr_3(tmp_path / "a.zarr", [BYTES, chosen], bomb)
    with pytest.raises(ValueError, match="it unpacks to more than"):
        open_volume(path)


@pytest.mark.parametrize("is_sent", [False, True])
def test_codecs_within_shards_are_bounded_in_other_processes_too(is_sent, tmp_path):
    google = pytest.importorskip("google_crc32c")
    bomb = packed("zstd", BOMB)
    index = struct.pack("<QQ", 0, len(bomb))
    index += struct.pack("<I", google.value(index))
    little = BYTES | {"configuration": {"endian": "little"}}
    chosen = {"chunk_shape": SHAPE, "index_codecs": [little, {"name": "crc32c"}]}
    chosen["codecs"] = [BYTES, {"name": "zstd", "configuration": OF_ZARR_3["zstd"]}]
    shards = [{"name": "sharding_indexed", "configuration": chosen}]
    read = open_streamed(of_zarr_3(tmp_path / "a.zarr", shards, bomb + index)).values[0, 0].read
    read = pickle.loads(pickle.dumps(read)) if is_sent else read
    with pytest.raises(ValueError, match="it unpacks to more than"):
        read((slice(0, 8),) * 3)


@pytest.mark.parametrize("codec", CODECS)
def test_honest_chunks_are_read_bit_by_bit(codec, tmp_path):
    path = store(tmp_path / "a.zarr", packed(codec, SMALL.tobytes()), codec=codec)
    np.testing.assert_array_equal(open_volume(path).values, SMALL)


def test_a_frame_of_zstandard_without_its_size_is_read(tmp_path):
    block = (512 << 3 | 1).to_bytes(3, "little") + SMALL.tobytes()
    path = store(tmp_path / "a.zarr", b"\x28\xb5\x2f\xfd\0\x38" + block, codec="zstd")
    np.testing.assert_array_equal(open_volume(path).values, SMALL)


# Zip files


def test_metadata_beyond_their_limit_are_not_read(tmp_path, monkeypatch):
    monkeypatch.setenv("RESAMPLE_LIMIT", "tree=10KB")
    long = told() + " " * 20_000
    folder = store(tmp_path / "a.zarr")
    (folder / ".zattrs").write_text("{}" + " " * 20_000)
    for path in (zipped(tmp_path / "a.zarr.zip", metadata=long), folder):
        with pytest.raises(ValueError, match=r"(\.zarray|\.zattrs): 0\.02 MiB, over the limit of"):
            open_volume(path)
        with pytest.raises(ValueError, match=r"(\.zarray|\.zattrs): 0\.02 MiB, over the limit of"):
            read_picture(path)


@pytest.mark.parametrize("by", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_members_whose_sizes_cannot_be_relied_on_are_not_unpacked(by, tmp_path):
    path = zipped(tmp_path / "a.zarr.zip", by=by)
    with pytest.raises(ValueError, match="packed by a method with unreliable sizes"):
        open_volume(path)


def test_a_chunk_in_a_zip_file_is_looked_at_before_it_is_unpacked(tmp_path):
    path = zipped(tmp_path / "a.zarr.zip", bytes(1 << 20))
    with pytest.raises(ValueError, match=r"its chunk 0\.0\.0 takes 1\.00 MiB, but its values"):
        open_volume(path)


# Neighbours


@pytest.mark.parametrize("name", ["0.0.0", ".zattrs", ".zarray"])
def test_links_that_lead_outside_are_refused_unless_they_are_allowed(name, tmp_path, monkeypatch):
    path = store(tmp_path / "a.zarr")
    (path / ".zattrs").write_text("{}")
    (path / name).rename(tmp_path / "other")
    (path / name).symlink_to("../other")
    if name == ".zarray":
        (path / "zarr.json").mkdir()  # so that it is looked for
        monkeypatch.setattr("resample_zarr.opening.is_store", lambda _: True)
    with pytest.raises(ValueError, match=r"names '.*', a link that leads outside; files are read"):
        open_volume(path)
    monkeypatch.setenv("RESAMPLE_ALLOW_OUTSIDE", "1")
    np.testing.assert_array_equal(open_volume(path).values, SMALL)


def test_a_link_within_the_folder_is_read(tmp_path):
    path = store(tmp_path / "a.zarr", shape=[8, 8, 16])
    (path / "0.0.1").symlink_to("0.0.0")
    np.testing.assert_array_equal(open_volume(path).values[..., 8:], SMALL)


@pytest.mark.parametrize("name", ["0.0.0", ".zattrs"])
@pytest.mark.parametrize("kind", ["pipe", "device"])
def test_pipes_and_devices_are_never_read(kind, name, tmp_path, monkeypatch):
    monkeypatch.setenv("RESAMPLE_ALLOW_OUTSIDE", "1")
    path = store(tmp_path / "a.zarr", chunk=None)
    (path / name).symlink_to("/dev/zero") if kind == "device" else os.mkfifo(path / name)
    with pytest.raises(ValueError, match=r"names '.*', a device or a pipe"):
        open_volume(path)
    with pytest.raises(ValueError, match=r"a device or a pipe|8 channels"):
        read_picture(path)


def test_a_level_of_a_picture_that_is_a_link_is_refused(tmp_path):
    zarr.create_array(tmp_path / "other", data=SMALL[0], zarr_format=2)
    axes = [{"name": name, "type": "space"} for name in "yx"]
    level = {"path": "0", "coordinateTransformations": [{"type": "scale", "scale": [1, 1]}]}
    image = {"version": "0.4", "axes": axes, "datasets": [level]}
    zarr.open_group(tmp_path / "a.zarr", zarr_format=2, attributes={"multiscales": [image]})
    (tmp_path / "a.zarr/0").symlink_to("../other")
    with pytest.raises(ValueError, match="a link that leads outside"):
        read_picture(tmp_path / "a.zarr")


# Gaps


def test_chunks_that_are_missing_are_told(tmp_path, capsys):
    path = tmp_path / "a.zarr"
    zarr.create_array(path, data=np.tile(SMALL, (2, 1, 2)), chunks=SHAPE, fill_value=3)
    for name in ("0/0/0", "1/0/1"):
        (path / "c" / name).unlink()
    found = open_volume(path)
    assert found.note == "2 of 4 chunks are missing and are drawn as the fill value 3"
    assert (found.values[:8, :, :8] == 3).all()
    np.testing.assert_array_equal(found.values[:8, :, 8:], SMALL)
    assert commands.ended(app, "info", path) == 0
    assert "2 of 4 chunks are missing" in capsys.readouterr().out


def test_chunks_of_a_picture_that_are_missing_are_told_once(tmp_path, caplog):
    holes.warned.cache_clear()
    path = tmp_path / "a.zarr"
    zarr.create_array(path, data=np.full((40, 32), 200, np.uint8), chunks=(8, 8), fill_value=9)
    for name in ("0/0", "3/1"):
        (path / "c" / name).unlink()
    kept = [read_picture(path).data for _ in range(2)]
    assert [line.message for line in caplog.records] == [
        "a.zarr: 2 of 20 chunks are missing and are drawn as the fill value 9"
    ]
    assert len(np.unique(kept[0])) == 2


@pytest.mark.sweep
def test_a_sparse_array_is_read_as_its_chunks_are(tmp_path, rng):
    values = np.zeros((20, 40, 20), np.uint16)
    values[9:13, 20:30, 3:5] = rng.integers(1, 1000, (4, 10, 2))
    zarr.create_array(
        tmp_path / "a.zarr", data=values, chunks=(4, 4, 4), config={"write_empty_chunks": False}
    )
    assert len(list((tmp_path / "a.zarr").rglob("c/*/*/*"))) < 30
    np.testing.assert_array_equal(open_volume(tmp_path / "a.zarr").values, values)


@pytest.mark.sweep
@pytest.mark.parametrize("form", ["folder", "zip"])
@pytest.mark.parametrize("side", [1, 5])
def test_millions_of_chunks_that_are_not_there_cost_nothing(side, form, tmp_path, monkeypatch):
    asked, shape = [], [191] * 3
    facts = told(shape=shape, chunks=[side] * 3)
    path = store(tmp_path / "a.zarr", bytes([7]) * side**3)
    (path / ".zarray").write_text(facts)
    if form == "zip":
        path = zipped(tmp_path / "a.zarr.zip", bytes([7]) * side**3, facts)
    size = f"resample_zarr.guarding.{'Zip' if form == 'zip' else 'Folder'}.size"
    real = pytest.importorskip("resample_zarr.guarding")
    real = getattr(real, "Zip" if form == "zip" else "Folder").size
    monkeypatch.setattr(size, lambda self, key: asked.append(key) or real(self, key))
    found = volume_at(open_streamed(path), None, None)
    assert describe(found)["range"] == (0, 7)
    assert len(asked) < 20


def test_gigabytes_of_which_nothing_is_there_are_refused(tmp_path):
    path = store(tmp_path / "a.zarr", shape=[191 * 64] * 3, chunks=[64] * 3)
    with pytest.raises(ValueError, match=r"of 6967871 chunks; 6967870 .* --limit ratio"):
        open_streamed(path)


def test_consolidated_metadata_are_not_believed(tmp_path):
    path = tmp_path / "a.zarr"
    path.mkdir()
    store(path / "0")
    axes = [{"name": name, "type": "space"} for name in "zyx"]
    level = {"path": "0", "coordinateTransformations": [{"type": "scale", "scale": [1, 1, 1]}]}
    attributes = {"multiscales": [{"version": "0.4", "axes": axes, "datasets": [level]}]}
    (path / ".zgroup").write_text('{"zarr_format": 2}')
    (path / ".zattrs").write_text(json.dumps(attributes))
    claims = {".zgroup": {"zarr_format": 2}, ".zattrs": attributes}
    claims["0/.zarray"] = json.loads(told(shape=[191] * 3, chunks=[1, 1, 1]))
    (path / ".zmetadata").write_text(
        json.dumps({"zarr_consolidated_format": 1, "metadata": claims})
    )
    np.testing.assert_array_equal(open_volume(path).values, SMALL)


def test_very_many_levels_are_refused(tmp_path):
    axes = [{"name": name, "type": "space"} for name in "zyx"]
    level = {"path": "0", "coordinateTransformations": [{"type": "scale", "scale": [1, 1, 1]}]}
    image = {"version": "0.4", "axes": axes, "datasets": [level] * 1000}
    zarr.open_group(tmp_path / "a.zarr", zarr_format=2, attributes={"multiscales": [image]})
    with pytest.raises(ValueError, match="at most 64 items"):
        open_volume(tmp_path / "a.zarr")


@pytest.mark.sweep
def test_damaged_chunks_end_a_process_in_one_line(tmp_path):
    path = tmp_path / "a.zarr"
    zarr.create_array(path, data=np.tile(SMALL, (2, 2, 2)), chunks=(2, 2, 2))
    for chunk in path.rglob("c/*/*/*"):
        chunk.write_bytes(chunk.read_bytes()[:-3])
    code = f"from resample_volume import open_volume; open_volume({str(path)!r})"
    ended = run([sys.executable, "-c", code], check=False, capture_output=True, timeout=PATIENCE)
    said = ended.stderr.decode()
    assert said.splitlines()[-1].startswith("ValueError: the array is not zarr, or damaged")
    assert "never retrieved" not in said
    assert "destroyed" not in said


def test_a_chunk_larger_than_the_free_memory_is_refused_before_it_is_read(tmp_path, monkeypatch):
    path = store(tmp_path / "a.zarr")
    for free, is_enough in ((len(CHUNK), True), (len(CHUNK) - 1, False)):
        monkeypatch.setattr("resample.reading.limits.available_memory", lambda free=free: free)
        array = zarr.open_array(path, mode="r")
        if is_enough:
            guarding.guard(array, "a")
        else:
            with pytest.raises(ValueError, match=r"a chunk of a needs .* of memory"):
                guarding.guard(array, "a")
