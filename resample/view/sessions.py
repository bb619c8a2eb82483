"""Session of an open page: paints the latest request, as preview during motion, else in full."""

import asyncio
import json
import logging
import time
from collections.abc import Awaitable, Callable, Coroutine
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from resample.measuring.quality import psnr
from resample.messages import one_line
from resample.progress import Cancel, CancelledError, Progress, cancellable, told
from resample.view.files import file_of
from resample.view.views import (
    Comparing,
    Filming,
    Knowing,
    PagePicture,
    Settings,
    Slicing,
    Viewable,
    check_page_options,
    exports_of,
)

JPEG_QUALITY = 88  # of previews
GAIN = 8  # factor of differences, so that small ones are visible
FILM = "film.mp4"  # name of the film
REPORT_INTERVAL = 0.25  # seconds between two progress reports of a film
PNG_EFFORT = 1  # zlib's compression level: pictures are sent once

Send = Callable[[str | bytes], Awaitable[None]]
LOG = logging.getLogger("resample")

LARGEST = 2048  # px of a side
LONGEST = 65_536  # bytes of a message

Key = Annotated[str, Field(max_length=40)]
Camera = Annotated[str, Field(max_length=200)]
Text = Annotated[str, Field(max_length=1000)]
Value = bool | int | float | Text | Annotated[list[Text], Field(max_length=32)]
Sent = Annotated[dict[Key, Value], Field(max_length=100)]  # options by name
Number = Annotated[float, Field(ge=-1e30, le=1e30)]
Side = Annotated[int, Field(ge=8, le=LARGEST)]


class _Message(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    settings: Sent
    width: Side
    height: Side
    number: Annotated[int, Field(ge=0)]  # sequence number of the page's messages


class Draw(_Message):
    """Paint a picture; a newer request replaces pending ones."""

    kind: Literal["draw"]
    moving: bool  # a preview suffices
    other: Sent | None = None  # paint these as well, and measure the difference
    rival: Key | None = None  # let another renderer paint it, and measure the difference


class Pick(_Message):
    """Describe the object at a position."""

    kind: Literal["pick"]
    x: Number  # px to the right; pixel centers are at halves
    y: Number  # px down


class Slice(_Message):
    """Return an orthogonal slice of a volume through a voxel, in a picture of this size."""

    kind: Literal["slice"]
    plane: Key  # by its name, as the view lists it
    voxel: tuple[int, int, int]  # index along x, y and z
    window: tuple[Number, Number] | None = None  # values, as stored, that are black and white


class MeasureLine(_Message):
    """Return the length of a line, and the values along it."""

    kind: Literal["measure"]
    start: tuple[Number, Number, Number]  # scene units
    end: tuple[Number, Number, Number]


class Ask(_Message):
    """Return information on options, such as the points of a curve."""

    kind: Literal["ask"]
    what: Key


class Export(_Message):
    """Return commands and code that make the picture, and a film through keyframes."""

    kind: Literal["export"]
    keyframes: Annotated[list[Camera], Field(max_length=64)] = []


class MakeFilm(_Message):
    """Make a film through keyframes and report progress; a second message stops it."""

    kind: Literal["film"]
    keyframes: Annotated[list[Camera], Field(max_length=64)]  # empty: stop the film


class Save(_Message):
    """Return the picture as a file."""

    kind: Literal["save"]
    suffix: Literal[".png", ".exr"]


Message = Draw | Pick | Slice | MeasureLine | Ask | Export | MakeFilm | Save
_adapter: TypeAdapter[Message] = TypeAdapter(Annotated[Message, Field(discriminator="kind")])


def message_of(text: str) -> Message:
    """Parse a message of a page."""
    if len(text) > LONGEST:
        raise ValueError(f"a message of {len(text)} letters; at most {LONGEST} are allowed")
    return _adapter.validate_json(text)


class PageSession:
    """Session of one page; created, called and closed by the event loop's thread.

    `view`: the view that the page shows. `send`: function that sends text or bytes to the page.
    `shown`: called when the page has received a complete picture. `begun`: initial options, set
    outside the page; None: the view's.
    """

    def __init__(
        self,
        view: Viewable,
        send: Send,
        shown: Callable[[], object] | None = None,
        begun: Callable[[], Settings] | None = None,
    ) -> None:
        self._view, self._send, self._shown = view, send, shown
        self._begun = begun or (lambda: view.about["settings"])
        self._painter = view.painter()
        self._wanted: Draw | None = None
        self._job: tuple[Draw, Cancel] | None = None  # in progress
        self._film: Cancel | None = None  # cancels the film in progress
        self._filming: asyncio.Task[None] | None = None
        self._news = asyncio.Event()
        self._task = asyncio.create_task(self._paint())
        self._notices = _Notices(asyncio.get_running_loop(), self._say)
        LOG.addHandler(self._notices)

    async def close(self) -> None:
        """Stop painting and release everything."""
        LOG.removeHandler(self._notices)
        if self._job is not None:
            self._job[1].cancel()
        if self._film is not None:
            self._film.cancel()
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)

    async def handle(self, message: Message) -> None:
        """Handle a message of the page; errors are reported on the page."""
        try:  # settings that a page must not change are rejected
            for given in (message.settings, getattr(message, "other", None)):
                check_page_options(self._view.about["command"], given or {}, self._begun())
        except ValueError as error:
            await self._send(_json_message("error", message.number, text=one_line(error)))
            return
        if isinstance(message, Draw):
            self._wanted = message
            if self._job is not None and not self._job[0].moving:
                self._job[1].cancel()  # but not a preview, or none would be shown
            self._news.set()
            return
        if isinstance(message, MakeFilm):
            if self._film is not None:
                self._film.cancel()
            if message.keyframes:
                self._film = Cancel()
                self._filming = asyncio.create_task(self._filmed(message, self._film))
            return
        try:
            answer = await asyncio.to_thread(self._answer, message)
        except Exception as error:
            answer = _json_message("error", message.number, text=one_line(error))
        await self._send(answer)

    def _answer(self, message: Pick | Slice | MeasureLine | Ask | Export | Save) -> str | bytes:
        size = message.width, message.height
        if isinstance(message, Pick):
            found = self._painter.pick(message.settings, size, message.x, message.y)
            return _json_message("picked", message.number, found=found)
        if isinstance(message, Slice | MeasureLine):
            if not isinstance(self._painter, Slicing):
                raise ValueError("this page shows no volume that could be sliced or measured")
            if isinstance(message, MeasureLine):
                told = self._painter.measure(message.start, message.end)
                return _json_message("measured", message.number, **told)
            shown = self._painter.slice(size, message.plane, message.voxel, message.window)
            kind, data = encoded(shown)
            about = {"kind": "slice", "number": message.number, "type": kind}
            return _framed({**shown.about, **about, "plane": message.plane}, data)
        if isinstance(message, Ask):
            if not isinstance(self._painter, Knowing):
                raise ValueError("this page has nothing to ask for")
            told = self._painter.tell(message.settings, message.what)
            return _json_message("told", message.number, what=message.what, told=told)
        if isinstance(message, Export):
            cameras, keyframes = message.keyframes, ""
            if len(cameras) > 1 and isinstance(self._painter, Filming):
                keyframes = self._painter.keyframes(cameras, message.settings)
            texts = exports_of(self._view.about, message.settings, size, cameras, keyframes)
            return _json_message("exported", message.number, texts=texts)
        file = self._view.save(message.settings, size, message.suffix)
        return _framed({"kind": "file", "name": f"picture{message.suffix}"}, file)

    async def _filmed(self, message: MakeFilm, cancel: Cancel) -> None:
        """Make a film and report its progress."""
        tell = self._telling(
            cancel, lambda share: _json_message("notice", 0, text=f"making the film: {share:.0%}")
        )
        try:
            answer: str | bytes = await asyncio.to_thread(self._film_of, message, cancel, tell)
        except CancelledError:
            answer = _json_message("notice", message.number, text="")
        except Exception as error:
            answer = _json_message("error", message.number, text=one_line(error))
        await self._send(answer)

    def _telling(self, cancel: Cancel, message: Callable[[float], str]) -> Progress:
        """Function that sends a message of the fraction done, now and then, until cancelled."""
        loop, last = asyncio.get_running_loop(), [time.perf_counter()]

        def tell(share: float) -> None:
            if cancel.is_cancelled:
                raise CancelledError("the work was cancelled")
            if time.perf_counter() - last[0] > REPORT_INTERVAL:
                last[0] = time.perf_counter()
                asyncio.run_coroutine_threadsafe(self._say(message(share)), loop)

        return tell

    def _film_of(self, message: MakeFilm, cancel: Cancel, tell: Callable[[float], None]) -> bytes:
        if not isinstance(self._painter, Filming):
            raise ValueError("this page makes no films")
        size, keyframes = (message.width, message.height), list(message.keyframes)
        film = self._view.painter()  # pages keep their own painters meanwhile
        assert isinstance(film, Filming)
        text = film.keyframes(keyframes, message.settings)
        write = partial(film.film, message.settings, size, text, progress=tell)
        with cancellable(cancel):
            return _framed({"kind": "file", "name": FILM}, file_of(write, Path(FILM).suffix))

    async def _paint(self) -> None:
        """Paint requests in an endless loop."""
        while True:
            await self._news.wait()
            self._news.clear()
            if self._wanted is None:
                continue
            draw, cancel = self._job = self._wanted, Cancel()
            done = partial(_rendered, draw.number)
            tell = None if draw.moving else self._telling(cancel, done)
            try:
                with told(tell):
                    answers: list[str | bytes] = await asyncio.to_thread(self._drawn, draw, cancel)
            except CancelledError:
                continue
            except Exception as error:
                answers = [_json_message("error", draw.number, text=one_line(error))]
            finally:
                self._job = None
            for answer in answers:
                await self._send(answer)
            if self._shown is not None and not self._wanted.moving:
                self._shown()

    def _drawn(self, draw: Draw, cancel: Cancel) -> list[str | bytes]:
        """Picture, and the one it is compared with and their difference, if any."""
        shown, frame = self._painted(draw, cancel, draw.settings, "frame")
        if draw.other is None and draw.rival is None:
            return [frame]
        try:
            other, second = self._painted(draw, cancel, draw.other, "other")
        except CancelledError:
            raise
        except Exception as error:  # our picture is still useful
            return [_json_message("other", draw.number, text=one_line(error)), frame]
        gap, decibels = difference(shown, other)
        kind, data = encoded(gap)
        about = {"kind": "difference", "number": draw.number, "type": kind, "gain": GAIN}
        return [second, _framed(about | {"decibels": decibels}, data), frame]

    def _painted(
        self, draw: Draw, cancel: Cancel, settings: Settings | None, name: str
    ) -> tuple[PagePicture, bytes]:
        """Picture of some settings; without settings, of another renderer."""
        start, size = time.perf_counter(), (draw.width, draw.height)
        if settings is not None:
            shown = self._painter.paint(settings, size, quick=draw.moving, cancel=cancel)
        elif isinstance(self._painter, Comparing):
            shown = self._painter.beside(str(draw.rival), draw.settings, size)
        else:
            raise ValueError("this page has no other renderers")
        kind, data = encoded(shown)
        about = {
            **shown.about,
            "kind": name,
            "number": draw.number,
            "preview": shown.is_preview,
            "plain": not draw.moving and bool((shown.levels == shown.levels[0, 0]).all()),
            "milliseconds": round(1000 * (time.perf_counter() - start), 1),
            "type": kind,
        }
        return shown, _framed(about, data)

    async def _say(self, text: str) -> None:
        await self._send(text)


class _Notices(logging.Handler):
    """Logging handler that sends the library's messages, such as compilation, to the page."""

    def __init__(
        self, loop: asyncio.AbstractEventLoop, tell: Callable[[str], Coroutine[Any, Any, None]]
    ) -> None:
        super().__init__(logging.INFO)
        self._loop, self._tell = loop, tell

    def emit(self, record: logging.LogRecord) -> None:
        asyncio.run_coroutine_threadsafe(
            self._tell(_json_message("notice", 0, text=record.getMessage())), self._loop
        )


def encoded(shown: PagePicture) -> tuple[str, bytes]:
    """Type and bytes of a picture: PNG, or JPEG for an opaque preview."""
    import cv2

    levels = shown.levels
    swapped: NDArray[np.uint8] = levels[..., [2, 1, 0, 3][: levels.shape[2]]]
    if shown.is_preview and levels.shape[2] == 3:
        choices, suffix, kind = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY], ".jpg", "image/jpeg"
    else:
        choices, suffix, kind = [cv2.IMWRITE_PNG_COMPRESSION, PNG_EFFORT], ".png", "image/png"
    _, data = cv2.imencode(suffix, np.ascontiguousarray(swapped), choices)
    return kind, data.tobytes()


def difference(one: PagePicture, other: PagePicture) -> tuple[PagePicture, float | None]:
    """Difference of two pictures over black, times `GAIN`, and PSNR in dB; None if equal."""
    a, b = _over_black(one.levels), _over_black(other.levels)
    apart = np.minimum(GAIN * np.abs(a - b), 255.0).astype(np.uint8)
    decibels = psnr(a, b, peak=255.0)
    shown = PagePicture(apart, one.is_preview or other.is_preview)
    return shown, round(decibels, 2) if np.isfinite(decibels) else None


def _over_black(levels: NDArray[np.uint8]) -> NDArray[np.float64]:
    color = levels[..., :3].astype(np.float64)
    return color * (levels[..., 3:] / 255.0) if levels.shape[2] == 4 else color


def _json_message(kind: str, number: int, **parts: Any) -> str:
    return json.dumps({"kind": kind, "number": number, **parts})


def _rendered(number: int, share: float) -> str:
    return _json_message("progress", number, share=round(share, 3))


def _framed(about: dict[str, Any], data: bytes) -> bytes:
    """Message of bytes: length of the JSON header, header, data."""
    head = json.dumps(about).encode()
    return len(head).to_bytes(4, "little") + head + data
