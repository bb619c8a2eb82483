"""The viewer's server: who may look, what pages may say, and what becomes of faults."""

import gc
import json
import random
import socket
import threading
import time
import urllib.error
import urllib.request
import weakref
from collections.abc import Iterator
from io import BytesIO
from typing import Any, ClassVar

import numpy as np
import pytest
from PIL import Image
from websockets.exceptions import ConnectionClosed, InvalidStatus

from resample.progress import Cancel, CancelledError
from resample.view import server
from resample.view.sessions import difference
from resample.view.views import PagePicture
from tests.view.conftest import Served, served


class Slow:
    """A painter that takes as long as it is told, in steps."""

    alive: ClassVar["weakref.WeakSet[Slow]"] = weakref.WeakSet()
    painted: ClassVar[list[tuple[int, bool]]] = []
    cancelled = 0

    def __init__(self) -> None:
        Slow.alive.add(self)

    def paint(self, settings: Any, size: Any, *, quick: bool, cancel: Cancel) -> PagePicture:
        if "fault" in settings:
            raise RuntimeError("the renderer\nhas failed")
        for _ in range(int(settings.get("steps", 0))):
            time.sleep(0.01)
            if cancel.is_cancelled:
                Slow.cancelled += 1
                raise CancelledError("stopped")
        Slow.painted.append((int(settings.get("mark", 0)), quick))
        return PagePicture(np.full((size[1], size[0], 3), settings.get("mark", 0), np.uint8), quick)

    def tell(self, settings: Any, what: str) -> dict[str, Any]:
        return {"asked": what, "of": sorted(settings)}

    def pick(self, _settings: Any, _size: Any, x: float, y: float) -> dict[str, Any]:
        return {"x": x, "y": y} if x >= 0 else {}


class Anything:
    """A view of nothing in particular."""

    about: ClassVar[dict[str, Any]] = {
        **{"title": "a view", "command": "resample-volume render", "inputs": ["a b.nrrd"]},
        **{"package": "resample_volume", "controls": [], "settings": {}},
    }

    def painter(self) -> Slow:
        return Slow()

    def save(self, _settings: Any, _size: Any, suffix: str) -> bytes:
        return suffix.encode()


@pytest.fixture(scope="module")
def place() -> Iterator[Served]:
    with served(Anything()) as address:
        yield address


def fetched(address: str, **headers: str) -> tuple[int, str, Any]:
    request = urllib.request.Request(address, headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=20) as answer:
            return answer.status, answer.read().decode(), answer.headers
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode(), error.headers


def test_the_page_needs_the_token_and_asks_no_other_host(place: Served) -> None:
    status, text, headers = fetched(place.address)
    assert status == 200
    assert "browser.js" in text
    assert headers["Content-Security-Policy"].startswith("default-src 'none'; script-src 'self'")
    assert headers["Cache-Control"] == "no-store"
    for name in ("browser.js", "viewer.js", "style.css"):
        status, text, _ = fetched(f"http://{place.host}/{name}")
        assert status == 200
        assert "http:" not in text
        assert "https:" not in text
    assert fetched(f"http://{place.host}/")[0] == 403
    for token in ("other", "%C3%A9", "%00"):
        assert fetched(f"http://{place.host}/?token={token}")[0] == 403
    assert fetched(place.address, Host="evil.example")[0] == 403  # a name that leads here
    for path in ("server.py", "..%2fserver.py", "index.html"):
        assert fetched(f"http://{place.host}/{path}")[0] == 404


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "::1", "[::1]", "localhost", "", "0"])
def test_each_address_to_listen_at_has_one_that_works(host: str) -> None:
    with socket.socket(socket.AF_INET6) as tried:
        try:
            tried.bind(("::1", 0))
        except OSError:
            if ":" in host:
                pytest.skip("this machine has no IPv6")
    with server.served(Anything(), host=host) as (shown, token):
        port = shown.rpartition(":")[2]
        assert not shown.startswith(("0.0.0.0", "[::]"))
        others = ["[::1]"] if "::1" in host else ["127.0.0.1", "localhost"]
        for name in (shown, *(f"{other}:{port}" for other in others)):
            place = Served(name, token)
            assert fetched(place.address)[0] == 200
            with place.page() as page:
                assert page.drawn({"mark": 1})[0]["kind"] == "frame"
        assert fetched(place.address, Host=f"evil.example:{port}")[0] == 403
        with (
            pytest.raises((InvalidStatus, ConnectionClosed)),
            place.page(origin=f"http://evil.example:{port}"),
        ):
            pass


@pytest.mark.parametrize(
    ("host", "shown", "warned"),
    [("::1", "[::1]", 0), ("127.0.0.1", "127.0.0.1", 0), ("0.0.0.0", "10.1.2.3", 1)],
)
def test_the_address_is_printed_as_browsers_take_it(host, shown, warned, monkeypatch, capsys):
    class Nobody:
        def run(self, sockets: list[socket.socket]) -> None:
            sockets[0].close()

    def listening(*_: object) -> tuple[socket.socket, list[str]]:
        return socket.create_server(("127.0.0.1", 0)), [f"{shown}:8000"]

    if host != "::1":
        monkeypatch.setattr(server, "_listening", listening)
    monkeypatch.setattr(server, "_server", lambda _: Nobody())
    server.serve(Anything(), host=host, browser=False)
    out, error = capsys.readouterr()
    assert out.startswith(f"http://{shown}:")
    assert error.count("can view, and read, your files") == warned


def test_sockets_need_the_token_and_the_page_s_own_origin(place: Served) -> None:
    strangers = [{"token": token} for token in ("other", "", "%C3%A9")]
    for given in [*strangers, {"origin": "http://evil.example"}]:
        with pytest.raises((InvalidStatus, ConnectionClosed)), place.page(**given):
            pass


def test_pictures_come_with_what_is_said_about_them(place: Served) -> None:
    with place.page() as page:
        assert page.about["title"] == "a view"
        head, data = page.drawn({"mark": 7}, number=5, moving=True)
        assert (head["number"], head["preview"], head["type"]) == (5, True, "image/jpeg")
        head, data = page.drawn({"mark": 7}, number=6)
        assert (head["number"], head["preview"], head["type"]) == (6, False, "image/png")
        assert data.startswith(b"\x89PNG")
        page.say("pick", {}, x=3.5, y=4)
        assert page.told("picked")["found"] == {"x": 3.5, "y": 4}
        page.say("save", {}, suffix=".exr")
        assert page.answer() == ({"kind": "file", "name": "picture.exr"}, b".exr")
        page.say("export", {"camera": "30/20/1", "clip": ["1/0/0", "0/1/0"], "shading": False})
        texts = page.told("exported")["texts"]
        assert texts["command"] == (
            "resample-volume render 'a b.nrrd' --camera=30/20/1 --clip=1/0/0 --clip=0/1/0 "
            "--no-shading --size=48x40 -o picture.png"
        )
        assert 'clip = ["1/0/0", "0/1/0"]' in texts["settings"]


def test_what_a_page_asks_for_is_told(place: Served) -> None:
    with place.page() as page:
        page.say("ask", {"b": 1, "a": 2}, what="points")
        words = page.told("told")
        assert (words["what"], words["told"]) == ("points", {"asked": "points", "of": ["a", "b"]})


def test_two_pictures_come_with_their_difference(place: Served) -> None:
    with place.page() as page:
        page.say("draw", {"mark": 100}, other={"mark": 90}, moving=False, number=3)
        answers = [page.answer() for _ in range(3)]
        heads = [head for head, _ in answers]
        assert [head["kind"] for head in heads] == ["other", "difference", "frame"]
        assert [head["number"] for head in heads] == [3, 3, 3]
        other, gap, shown = (np.asarray(Image.open(BytesIO(data))) for _, data in answers)
        assert (other == 90).all()
        assert (shown == 100).all()
        assert (gap == 10 * heads[1]["gain"]).all()
        assert heads[1]["decibels"] == round(20 * np.log10(255 / 10), 2)
        page.say("draw", {"mark": 7}, other={"mark": 7}, moving=True)
        assert [page.answer()[0].get("decibels", 0) for _ in range(3)] == [0, None, 0]


def test_differences_are_of_what_is_seen_over_black() -> None:
    clear = np.zeros((2, 2, 4), np.uint8)
    hidden = clear + np.array([255, 9, 90, 0], np.uint8)
    assert difference(PagePicture(clear, False), PagePicture(hidden, False))[1] is None
    half = clear + np.array([255, 255, 255, 128], np.uint8)
    gap, decibels = difference(PagePicture(half, False), PagePicture(clear[..., :3], True))
    assert gap.is_preview
    assert (gap.levels == 255).all()
    assert decibels == round(20 * np.log10(255 / 128), 2)


def test_the_latest_wish_wins_and_whole_pictures_are_stopped(place: Served) -> None:
    with place.page() as page:
        Slow.painted.clear()
        before = Slow.cancelled
        page.say("draw", {"steps": 3000, "mark": 1}, moving=False, number=1)
        time.sleep(0.2)
        for mark in range(2, 6):
            page.say("draw", {"mark": mark}, moving=True, number=mark)
        head, _ = page.answer()
        while head["number"] != 5:
            head, _ = page.answer()
        assert Slow.cancelled == before + 1
        assert (1, False) not in Slow.painted
        page.say("draw", {"steps": 20, "mark": 6}, moving=True, number=6)
        time.sleep(0.05)
        page.say("draw", {"mark": 7}, moving=True, number=7)  # previews are let through
        assert [page.answer()[0]["number"] for _ in range(2)] == [6, 7]


def test_a_thousand_malformed_messages_are_survived(place: Served) -> None:
    rng = random.Random(7)
    good = {"kind": "draw", "settings": {}, "width": 48, "height": 40, "number": 1, "moving": True}
    text = json.dumps(good)
    broken: list[str | bytes] = [
        "", "[]", "null", "{}", "\x00", "NaN", "[" * 900, json.dumps(good | {"width": 1e9}),
        json.dumps(good | {"settings": {"a": {"b": {}}}}), json.dumps(good | {"kind": "eval"}),
        json.dumps(good | {"settings": {str(n): n for n in range(200)}}), b"\x00\x01\x02",
        json.dumps(good | {"settings": {"a": "x" * 2000}}), json.dumps(good | {"height": -4}),
        json.dumps(good | {"number": "one"}), json.dumps(good | {"more": 1}),
        json.dumps({**good, "kind": "measure", "start": [1e308, 0, 0], "end": [0, 0, 0]}),
        text.replace("48", "Infinity"), json.dumps({**good, "kind": "save", "suffix": ".py"}),
    ]  # fmt: skip
    while len(broken) < 1000:
        letters = list(text)
        for _ in range(rng.randint(1, 6)):
            letters[rng.randrange(len(letters))] = chr(rng.randrange(32, 0x2FF))
        broken.append("".join(letters))
    with place.page() as page:
        for one in broken:
            page.link.send(one)
            words, _ = page.answer()
            assert words["kind"] in ("error", "frame", "picked", "exported")
        assert page.drawn({"mark": 3})[0]["kind"] == "frame"
    with place.page() as page:
        page.link.send("x" * 200_000)
        with pytest.raises(ConnectionClosed):
            page.answer()
    with place.page() as page:
        assert page.drawn({})[0]["kind"] == "frame"


def test_a_renderer_s_fault_is_said_on_the_page(place: Served) -> None:
    with place.page() as page:
        page.say("draw", {"fault": True}, moving=False)
        words = page.told("error")
        assert words["text"] == "the renderer has failed"
        assert page.drawn({"mark": 1})[0]["kind"] == "frame"


@pytest.fixture
def quick_collection() -> Iterator[None]:
    """What others have made is not looked at, which would take a second each time."""
    gc.freeze()
    yield
    gc.unfreeze()


@pytest.mark.usefixtures("quick_collection")
def test_each_page_has_a_painter_that_goes_when_it_is_closed(place: Served) -> None:
    others = weakref.WeakSet(Slow.alive)

    def count() -> int:
        gc.collect()
        return sum(one not in others for one in Slow.alive)

    with place.page() as one, place.page() as two:
        one.drawn({"mark": 1})
        two.drawn({"mark": 2})
        assert count() == 2
        one.say("draw", {"steps": 3000}, moving=False)  # and closes while it is painted
    until = time.monotonic() + 10
    while count() and time.monotonic() < until:
        time.sleep(0.05)
    assert count() == 0


def test_more_pages_than_there_may_be_are_refused(place: Served) -> None:
    from contextlib import ExitStack

    from resample.view.server import MOST_PAGES

    time.sleep(0.2)
    with ExitStack() as pages:
        for _ in range(MOST_PAGES):
            pages.enter_context(place.page())
        with pytest.raises((InvalidStatus, ConnectionClosed)), place.page():
            pass


def test_pages_at_once_do_not_disturb_each_other(place: Served) -> None:
    marks: dict[int, list[int]] = {}

    def look(mark: int) -> None:
        with place.page() as page:
            heads = [page.drawn({"mark": mark, "steps": 1}, number=n)[0] for n in range(8)]
            marks[mark] = [head["number"] for head in heads]

    threads = [threading.Thread(target=look, args=(mark,)) for mark in range(1, 5)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert marks == {mark: list(range(8)) for mark in range(1, 5)}
