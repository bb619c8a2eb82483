"""Whatever goes wrong with a store: one line, status 2, and nothing that looks whole."""

import io
import json
import subprocess
import sys
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Lock, Thread

import numpy as np
import pytest

from resample_volume.cli import app
from resample_volume.data import scanning
from resample_volume.files.source import open_recording, open_streamed, open_volume
from resample_zarr import opening
from resample_zarr.writing import Layered, bricks_of, write_store
from tests import commands
from tests.processes import PATIENCE
from tests.servers import Server

zarr = pytest.importorskip("zarr")
pytest.importorskip("obstore", reason="the extra remote is not installed")

ended = partial(commands.ended, app)
COMMANDS = {"render": ["--size", "16", "-o", "a.png"], "convert": ["b.ome.zarr", "--chunk", "8"]}


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setattr(scanning, "LEAST", 0)
    monkeypatch.setenv("HYBRID_RESAMPLE_CACHE", str(tmp_path / "cache"))


@pytest.fixture
def values(rng):
    return rng.integers(0, 60000, (20, 18, 24)).astype(np.uint16)


@pytest.fixture(params=["http", "s3"])
def server(request, httpserver, tmp_path, monkeypatch):
    """A web server, also as one of S3 that lists nothing; its folder is its only bucket."""
    (tmp_path / "bucket").mkdir()
    found = Server(tmp_path, httpserver)
    if request.param == "s3":
        monkeypatch.setenv("AWS_ENDPOINT", found.url.rstrip("/"))
        monkeypatch.setenv("AWS_SKIP_SIGNATURE", "true")
    found.place = "s3://bucket" if request.param == "s3" else f"{found.url}bucket"
    found.folder_of_stores = tmp_path / "bucket"
    return found


def store(server, values, **form):
    path = server.folder_of_stores / "a.zarr"
    zarr.create_array(path, data=values, chunks=(8, 8, 8), fill_value=7, **form)
    return path


def refused(capsys, place, name="render"):
    """The last line of a command that fails, having written nothing."""
    capsys.readouterr()
    assert ended(name, place, *COMMANDS[name]) == 2
    assert not list(Path().iterdir())
    lines = capsys.readouterr().err.splitlines()
    assert sum(line.startswith("resample: error: ") for line in lines) == 1
    assert len(lines) <= 2  # how the volume is read, and the error
    return lines[-1]


@pytest.mark.sweep
@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.parametrize("shards", [None, (16, 16, 16)])
def test_what_arrives_cut_off_is_refused(name, shards, values, server, capsys):
    store(server, values, shards=shards)
    server.cut = "/0/1/1" if shards else "/1/1/1"
    assert "damaged" in (error := refused(capsys, f"{server.place}/a.zarr", name)) or (
        "fetched" in error
    )


@pytest.mark.some(1)
@pytest.mark.parametrize("name", COMMANDS)
def test_a_shard_that_is_cut_off_where_it_lies_is_damaged(name, values, server, capsys):
    path = store(server, values, shards=(16, 16, 16))
    shard = path / "c/0/1/1"
    shard.write_bytes(shard.read_bytes()[:-30])
    assert "damaged" in refused(capsys, f"{server.place}/a.zarr", name)


@pytest.mark.sweep
@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.parametrize("part", ["index", "chunk"])
def test_a_wrong_checksum_is_damage(name, part, values, server, capsys):
    from zarr.codecs import BytesCodec, Crc32cCodec

    if part == "index":
        path = store(server, values, shards=(16, 16, 16))
        shard, at = path / "c/0/0/0", -10
    else:
        path = server.folder_of_stores / "a.zarr"
        sums = {"serializer": BytesCodec(), "compressors": [Crc32cCodec()]}
        zarr.create_array(path, data=values, chunks=(8, 8, 8), **sums)
        shard, at = path / "c/1/0/0", 100
    data = bytearray(shard.read_bytes())
    data[at] ^= 1
    shard.write_bytes(data)
    assert "damaged" in (error := refused(capsys, f"{server.place}/a.zarr", name))
    assert "hecksum" in error


def test_a_chunk_of_a_server_that_is_far_too_large_is_refused(values, server):
    path = store(server, values)
    (path / "c/0/0/0").write_bytes(bytes(1 << 16))
    held = open_streamed(f"{server.place}/a.zarr")
    with pytest.raises(ValueError, match=r"its chunk c/0/0/0 takes 0\.06 MiB, but its values"):
        held.values[0, 0].read((slice(0, 8),) * 3)


@pytest.mark.sweep
def test_a_chunk_that_is_not_there_has_the_value_that_fills(values, server):
    path = store(server, values)
    (path / "c/0/1/2").unlink()
    found = open_volume(f"{server.place}/a.zarr").values
    assert (found[:8, 8:16, 16:] == 7).all()
    np.testing.assert_array_equal(found[8:], values[8:])


@pytest.mark.sweep
def test_a_server_that_is_busy_now_and_then_is_asked_again(values, server):
    store(server, values)
    held = open_streamed(f"{server.place}/a.zarr")
    server.busy = 2
    np.testing.assert_array_equal(held.values[0, 0].whole(), values)


@pytest.mark.sweep
@pytest.mark.parametrize("change", [{"shape": [20, 18]}, {"shape": [20, -1, 24]}, {"shape": "all"}])
def test_a_wrong_shape_is_refused(change, values, server, capsys):
    path = store(server, values)
    metadata = json.loads((path / "zarr.json").read_text())
    (path / "zarr.json").write_text(json.dumps(metadata | change))
    assert "is not zarr, or damaged" in refused(capsys, f"{server.place}/a.zarr")


@pytest.mark.sweep
def test_without_a_list_of_chunks_each_is_asked_about(values, server):
    store(server, values)
    server.tells = "tag"
    reads = []
    for _ in range(2):
        bricks = open_streamed(f"{server.place}/a.zarr").values[0, 0]
        assert bricks.statistics.codes.sum() == values.size
        reads.append(bricks.reads)
    assert reads == [1, 0]


class Dying(ThreadingHTTPServer):
    """Serves a folder, and after some chunks breaks off in the middle, and is gone."""

    def __init__(self, folder, chunks):
        super().__init__(("127.0.0.1", 0), partial(DyingHandler, directory=str(folder)))
        self.left, self.lock = chunks, Lock()


class DyingHandler(SimpleHTTPRequestHandler):
    def do_GET(self):
        with self.server.lock:
            self.server.left -= "/c/" in self.path
            is_dead = self.server.left < 0
        if not is_dead:
            super().do_GET()
            return
        self.server.socket.close()
        self.wfile.write(b"HTTP/1.1 200 OK\r\nContent-Length: 999\r\n\r\nhalf")
        self.close_connection = True

    def log_message(self, *_):
        """Say nothing."""


@pytest.mark.sweep
@pytest.mark.parametrize("name", COMMANDS)
def test_a_network_that_is_cut_while_chunks_are_fetched_ends_a_command(
    name, values, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(opening, "TRIES", 1)
    zarr.create_array(tmp_path / "a.zarr", data=values, chunks=(8, 8, 8))
    server = Dying(tmp_path, 5)
    serving = Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True)
    serving.start()
    try:
        error = refused(capsys, f"http://127.0.0.1:{server.server_port}/a.zarr", name)
    finally:
        server.shutdown()
        server.server_close()
    assert "cannot be fetched" in error
    assert server.left < 0


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.mark.sweep
@pytest.mark.parametrize(
    "form",
    [
        {},
        *(
            pytest.param(each, marks=pytest.mark.sweep)
            for each in ({"shard": 16}, {"is_layered": False})
        ),
    ],
)
def test_bars_count_bricks_and_say_how_much_time_is_left(form, values, monkeypatch):
    np.save("a.npy", np.stack([values, values]))
    recording, form = open_recording("a.npy"), Layered(chunk=8, **form)
    shares = []
    write_store(Path("b.zarr"), recording, form, shares.append)
    assert len(shares) == bricks_of(recording, form)
    words = [f"--{name}={n}" for name, n in (("shard", form.shard),) if n]
    words += [] if form.is_layered else ["--no-levels"]
    monkeypatch.setattr(sys, "stderr", terminal := Terminal())
    assert ended("convert", "a.npy", "c.zarr", "--chunk", "8", *words) == 0
    assert f"{len(shares)}/{len(shares)}" in terminal.getvalue()
    assert "0:00:00" in terminal.getvalue()
    assert ended("render", "c.zarr", "--time", "0", *COMMANDS["render"]) == 0
    for bar in ("scanning bricks", "reading bricks"):
        assert bar in terminal.getvalue()


# A disk that takes no more: no file of this process may be longer than some bytes.
FULL = """
import resource, signal, sys

from resample_volume.cli import main

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv.pop(1)),) * 2)
main()
"""


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="limits of POSIX")
@pytest.mark.parametrize("form", [[], pytest.param(["--shard", "32"], marks=pytest.mark.sweep)])
def test_a_disk_that_takes_no_more_leaves_no_store(form, values):
    np.save("a.npy", values)
    most = 1 << 14 if form else 1 << 11  # between metadata and what lies in a file
    words = ["convert", "a.npy", "b.ome.zarr", "--chunk", "16", "--compression", "none", *form]
    ended = subprocess.run(
        [sys.executable, "-c", FULL, str(most), *words],
        check=False,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert ended.returncode == 2, ended.stderr
    assert ended.stderr.startswith("resample: error: b.ome.zarr: cannot be written: ")
    assert ended.stderr.count("\n") == 1
    assert [path.name for path in Path().iterdir()] == ["a.npy"]
