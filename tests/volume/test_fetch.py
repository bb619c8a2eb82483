import gzip
import hashlib
import io
import json
import socket
import time
from concurrent.futures import ThreadPoolExecutor
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest
from werkzeug import Response

from resample.files import public
from resample_volume.files import generated as module
from resample_volume.files.generated import available, fetch
from resample_volume.files.source import open_volume
from tests.processes import PATIENCE

VALUES = np.arange(24, dtype="<u2").reshape(2, 3, 4)
FILE = "tiny_4x3x2_uint16.raw"


@pytest.fixture(autouse=True)
def tiny(monkeypatch):
    """A collection of one small volume, and no waiting between tries."""
    entry = {
        "name": "Tiny",
        "type": "uint16",
        "size": [4, 3, 2],
        "spacing": [1, 1, 1.4],
        "sha512": hashlib.sha512(VALUES.tobytes()).hexdigest(),
        "url": f"http://tiny.invalid/tiny/{FILE}",
        "description": "Numbers.",
        "acknowledgement": "nobody",
    }
    monkeypatch.setattr(module, "available", lambda: {"tiny": entry})
    monkeypatch.setattr(time, "sleep", lambda _: None)


@pytest.fixture
def serving(httpserver):
    httpserver.expect_request(f"/{FILE}").respond_with_data(VALUES.tobytes())
    return httpserver


def test_the_collection_is_known():
    known = available()
    assert {"engine", "lobster", "aneurism", "skull"} <= known.keys()
    for entry in known.values():
        assert len(entry["sha512"]) == 128
        assert entry["url"].endswith("_{}x{}x{}_{}.raw".format(*entry["size"], entry["type"]))


def test_what_is_fetched_can_be_opened_with_its_spacing(serving, tmp_path):
    volume = open_volume(fetch("tiny", folder=tmp_path, base_url=serving.url_for("")))
    assert np.array_equal(volume.values, VALUES)
    assert volume.spacing.tolist() == [1, 1, 1.4]
    assert volume.name == "tiny"


def test_every_entry_makes_a_header_that_can_be_read(tmp_path):
    for name, entry in available().items():
        text = module._header(tmp_path / f"{name}.nhdr", entry, "a.raw").read_text("utf-8")
        assert f"sizes: {' '.join(map(str, entry['size']))}\n" in text
        assert "\n\n" not in text  # an empty line would end the header


def test_what_was_fetched_is_there_without_the_server(serving, tmp_path):
    first = fetch("tiny", folder=tmp_path, base_url=serving.url_for(""))
    serving.clear()
    assert fetch("tiny", folder=tmp_path, base_url=serving.url_for("")) == first
    assert fetch("tiny", folder=tmp_path) == first


def test_the_environment_names_the_folder(serving, tmp_path, monkeypatch):
    monkeypatch.setenv("HYBRID_RESAMPLE_DATA", str(tmp_path / "kept"))
    path = fetch("tiny", base_url=serving.url_for(""))
    assert path.parent == tmp_path / "kept"


def test_another_file_is_refused_and_not_kept(httpserver, tmp_path):
    httpserver.expect_request(f"/{FILE}").respond_with_data(bytes(48))
    with pytest.raises(ValueError, match=r"wrong SHA-512.*nothing was kept$"):
        fetch("tiny", folder=tmp_path, base_url=httpserver.url_for(""))
    assert list(tmp_path.iterdir()) == []


def test_a_download_that_breaks_off_leaves_nothing(httpserver, tmp_path):
    def half(_):
        return Response(VALUES.tobytes()[:20], headers={"Content-Length": str(VALUES.nbytes)})

    httpserver.expect_request(f"/{FILE}").respond_with_handler(half)
    with pytest.raises((OSError, ValueError)) as caught:
        fetch("tiny", folder=tmp_path, base_url=httpserver.url_for(""))
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_a_damaged_file_is_fetched_again(serving, tmp_path):
    (tmp_path / FILE).write_bytes(b"damaged")
    path = fetch("tiny", folder=tmp_path, base_url=serving.url_for(""))
    assert np.array_equal(open_volume(path).values, VALUES)


def test_a_busy_server_is_asked_again(httpserver, tmp_path):
    httpserver.expect_ordered_request(f"/{FILE}").respond_with_data("busy", status=503)
    httpserver.expect_ordered_request(f"/{FILE}").respond_with_data(VALUES.tobytes())
    assert fetch("tiny", folder=tmp_path, base_url=httpserver.url_for("")).exists()


def test_a_server_that_stays_busy_is_named(httpserver, tmp_path):
    httpserver.expect_request(f"/{FILE}").respond_with_data("busy", status=503)
    with pytest.raises(ConnectionError, match=f"{FILE}: the server answers 503"):
        fetch("tiny", folder=tmp_path, base_url=httpserver.url_for(""))
    assert list(tmp_path.iterdir()) == []


def test_a_server_that_cannot_be_reached_is_named(tmp_path):
    with socket.socket() as deaf:  # has a port, which no other can take, and does not listen
        deaf.bind(("127.0.0.1", 0))
        url = f"http://127.0.0.1:{deaf.getsockname()[1]}/"
        with pytest.raises(ConnectionError, match=r"cannot be reached.*by hand") as caught:
            fetch("tiny", folder=tmp_path, base_url=url)
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_volume_lists_the_known():
    with pytest.raises(LookupError, match="unknown volume 'tinny'; known are tiny"):
        fetch("tinny")


def test_a_terminal_gets_a_bar(serving, tmp_path, monkeypatch):
    terminal = io.StringIO()
    terminal.isatty = lambda: True
    monkeypatch.setattr("sys.stderr", terminal)
    fetch("tiny", folder=tmp_path, base_url=serving.url_for(""))
    assert FILE in terminal.getvalue()


def refused(httpserver, folder, error, match):
    """A download fails in one line and leaves nothing."""
    with pytest.raises(error, match=match) as caught:
        fetch("tiny", folder=folder, base_url=httpserver.url_for(""))
    assert "\n" not in str(caught.value)
    assert list(folder.iterdir()) == []


def test_a_body_without_an_end_is_not_listened_to(httpserver, tmp_path):
    sent = []

    def endless():
        while len(sent) < 10_000:
            sent.append(None)
            yield bytes(1 << 16)

    httpserver.expect_request(f"/{FILE}").respond_with_handler(lambda _: Response(endless()))
    refused(httpserver, tmp_path, ValueError, "gave more than the 48 bytes that it has")
    assert len(sent) < 1000


@pytest.mark.sweep
def test_a_body_that_grows_when_it_is_unpacked_is_refused(httpserver, tmp_path):
    bomb = gzip.compress(bytes(10_000_000))
    httpserver.expect_request(f"/{FILE}").respond_with_data(
        bomb, headers={"Content-Encoding": "gzip"}
    )
    refused(httpserver, tmp_path, ValueError, "gave more than the 48 bytes that it has")


def test_a_silent_server_is_left(httpserver, tmp_path, monkeypatch):
    going = Event()

    def silent():
        yield VALUES.tobytes()[:20]
        going.wait(PATIENCE)

    monkeypatch.setattr(public, "SILENCE", 0.2)
    httpserver.expect_request(f"/{FILE}").respond_with_handler(lambda _: Response(silent()))
    try:
        refused(httpserver, tmp_path, ConnectionError, "cannot be reached")
    finally:
        going.set()


def test_a_server_that_is_too_slow_is_left(serving, tmp_path, monkeypatch):
    monkeypatch.setattr(public, "PATIENCE", 0.0)
    monkeypatch.setattr(public, "SLOWEST", 1e12)
    refused(serving, tmp_path, ConnectionError, "came in 0 s, which is too slow; try again later")


def test_a_disk_without_room_is_named_before_anything_is_asked_for(tmp_path, monkeypatch):
    usage = public.shutil.disk_usage(tmp_path)._replace(free=40)
    monkeypatch.setattr(public.shutil, "disk_usage", lambda _: usage)
    with pytest.raises(OSError, match=f"has 0.00 MiB left, and {FILE} 0.00 MiB"):
        fetch("tiny", folder=tmp_path, base_url="http://tiny.invalid")


def test_at_once_processes_fetch_one_whole_file(serving, tmp_path):
    with ThreadPoolExecutor(4) as threads:
        url = serving.url_for("")
        paths = list(threads.map(lambda _: fetch("tiny", folder=tmp_path, base_url=url), range(8)))
    assert set(paths) == {tmp_path / "tiny.nhdr"}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["tiny.nhdr", FILE]


def test_nothing_else_is_printed(serving, tmp_path, capfd):
    fetch("tiny", folder=tmp_path, base_url=serving.url_for(""))
    assert capfd.readouterr() == ("", "")


def test_the_list_is_valid_json_without_duplicates():
    pairs = []
    text = module.files("resample_volume").joinpath("data/open_scivis.json").read_text("utf-8")
    json.loads(text, object_pairs_hook=lambda found: pairs.append([key for key, _ in found]))
    assert all(len(keys) == len(set(keys)) for keys in pairs)


@pytest.mark.parametrize("missing", [0, 1])
def test_a_file_may_fill_the_disk_to_its_last_byte(serving, tmp_path, monkeypatch, missing):
    free = VALUES.nbytes - missing
    monkeypatch.setattr(public.shutil, "disk_usage", lambda _: SimpleNamespace(free=free))
    if missing:
        with pytest.raises(OSError, match="left"):
            fetch("tiny", folder=tmp_path, base_url=serving.url_for(""))
    else:
        assert fetch("tiny", folder=tmp_path, base_url=serving.url_for("")).is_file()
