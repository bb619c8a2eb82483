"""A viewer that is served in a thread, and a page of words alone that talks to it."""

import json
import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from cyclopts import App
from numpy.typing import NDArray
from PIL import Image
from websockets.sync.client import ClientConnection, connect

from resample.view import server
from resample.view.views import Viewable
from tests.commands import ended

PATIENCE = 120.0  # seconds; kernels may have to be compiled


class Served(NamedTuple):
    """Where a viewer is."""

    host: str  # with the port
    token: str

    @property
    def address(self) -> str:
        return f"http://{self.host}/?token={self.token}"

    @contextmanager
    def page(self, token: str | None = None, origin: str | None = None) -> Iterator["Page"]:
        """A page that is open."""
        known = self.token if token is None else token
        address = f"ws://{self.host}/socket?token={known}"
        with connect(address, origin=origin or f"http://{self.host}", max_size=None) as link:  # type: ignore[arg-type]
            yield Page(link)


class Page:
    """What a page says, and is told."""

    def __init__(self, link: ClientConnection) -> None:
        self.link = link
        self.about = self.told("about")

    def say(self, kind: str, settings: dict[str, Any], **more: Any) -> None:
        words = {"kind": kind, "settings": settings, "width": 48, "height": 40, "number": 1}
        self.link.send(json.dumps(words | more))

    def answer(self) -> tuple[dict[str, Any], bytes]:
        """What comes next, but notices and progress: words, and bytes that came with them."""
        while True:
            data = self.link.recv(timeout=PATIENCE)
            if isinstance(data, bytes):
                end = 4 + int.from_bytes(data[:4], "little")
                return json.loads(data[4:end]), data[end:]
            words = json.loads(data)
            if words["kind"] not in ("notice", "progress"):
                return words, b""

    def told(self, kind: str) -> dict[str, Any]:
        words, _ = self.answer()
        assert words["kind"] == kind, words
        return words

    def drawn(self, settings: dict[str, Any], **more: Any) -> tuple[dict[str, Any], bytes]:
        """Picture of options."""
        self.say("draw", settings, **({"moving": False} | more))
        head, data = self.answer()
        assert head["kind"] == "frame", head
        return head, data


def levels(data: bytes) -> NDArray[np.uint8]:
    """Levels of a picture's file."""
    return np.asarray(Image.open(BytesIO(data)))


@contextmanager
def served(view: Viewable, shown: Any = None) -> Iterator[Served]:
    """Serve a view while this lasts."""
    with server.served(view, shown) as (host, token):
        yield Served(host, token)


def frames_of(path: Path) -> NDArray[np.uint8]:
    """Frames of a film."""
    film, frames = cv2.VideoCapture(str(path)), []
    while (read := film.read())[0]:
        frames.append(read[1])
    return np.stack(frames)


def check_export(place: Served, app: App, wish: dict[str, Any], *, in_python: bool) -> None:
    """Page, saved file, command and Python make one picture; a preview has its size."""
    with place.page() as page:
        settings = page.about["settings"] | wish
        head, data = page.drawn(settings)
        assert not head["preview"]
        page.say("export", settings)
        texts = page.told("exported")["texts"]
        page.say("save", settings, suffix=".png")
        saved = page.answer()[1]
        head, preview = page.drawn(settings, moving=True)
        assert head["preview"]
    words = shlex.split(texts["command"])
    assert words[0] == app.name[0]
    assert ended(app, *words[1:]) == 0
    written = levels(Path("picture.png").read_bytes())
    np.testing.assert_array_equal(levels(data), written)
    np.testing.assert_array_equal(levels(saved), written)
    assert written.std() > 5
    assert preview
    if in_python:
        exec(texts["python"], {})
        np.testing.assert_array_equal(levels(Path("picture.png").read_bytes()), written)
