"""Viewer in a notebook: the module of the page, connected to the kernel instead of a server."""

import asyncio
import json
import threading
from collections.abc import Callable, Mapping
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from resample.view.server import MOST_PAGES, PAGE, joined
from resample.view.sessions import PageSession, message_of
from resample.view.views import Viewable, check_page_options, exports_of

try:
    import anywidget
    import traitlets
except ImportError as error:
    raise ImportError(
        f"view needs {error.name}, which is not installed: pip install 'hybrid-resample[notebook]'"
    ) from None

Folder = TemporaryDirectory[str]
SIZE = (480, 360)  # px, until the page reports its size


class Viewer(anywidget.AnyWidget):
    """A view in the output of a notebook cell.

    `settings` are the options that differ from the command's defaults, by name; they are kept in
    sync with the page in both directions.

    Parameters
    ----------
    view
        The view to show.
    settings
        Initial options, in addition to the view's.
    holds
        Folder of temporary files that lives as long as the widget.

    Raises
    ------
    ValueError, LookupError, OSError
        An option is invalid, or a file cannot be read.
    """

    _esm = joined()
    _style = traitlets.Unicode((PAGE / "style.css").read_text(encoding="utf-8")).tag(sync=True)
    settings = traitlets.Dict().tag(sync=True)

    def __init__(
        self, view: Viewable, settings: Mapping[str, Any] | None = None, holds: Folder | None = None
    ) -> None:
        self._view, self._holds, self._size = view, holds, SIZE
        self._sessions: dict[str, PageSession] = {}
        super().__init__(settings={**view.about["settings"], **(settings or {})})
        self.on_msg(self._heard)

    @property
    def frame(self) -> Any:
        """Picture of the current settings, the same that the code from `to_python` makes."""
        about = self._view.about
        home = import_module(f"{about['package']}.viewing")
        made_by = getattr(home, about.get("function", "picture"))
        width, height = self._size
        whole = {**about.get("fixed", {}), **self._given(), "size": f"{width}x{height}"}
        return made_by(*about["inputs"], whole)

    def to_python(self) -> str:
        """Python code that makes the picture without the widget."""
        return exports_of(self._view.about, self._given(), self._size)["python"]

    def to_command(self) -> str:
        """Command that writes the picture."""
        return exports_of(self._view.about, self._given(), self._size)["command"]

    def close(self) -> None:
        """Stop painting and release everything."""
        for page in list(self._sessions):
            _soon(self._forget(page))
        if self._holds is not None:
            self._holds.cleanup()
        super().close()

    def _given(self) -> dict[str, Any]:
        """Settings, except those that only the page sets."""
        return {key: value for key, value in self.settings.items() if value != ""}

    @traitlets.validate("settings")
    def _checked(self, proposal: Mapping[str, Any]) -> dict[str, Any]:
        given: dict[str, Any] = proposal["value"]
        self._view.check({key: value for key, value in given.items() if value != ""})
        return given

    def set_state(self, sync_data: Mapping[str, Any]) -> None:
        """Accept changes from the page if they are allowed."""
        if isinstance(options := sync_data.get("settings"), Mapping):
            check_page_options(self._view.about["command"], options, self.settings)
        super().set_state(sync_data)

    def _repr_mimebundle_(self, **kwargs: Any) -> Any:
        """The widget, and a picture for notebooks without a kernel."""
        found = super()._repr_mimebundle_(**kwargs)
        parts, facts = found if isinstance(found, tuple) else (found, {})
        return {**(parts or {}), "image/png": self._view.save(self._given(), SIZE, ".png")}, facts

    def _heard(self, _: Any, content: Any, __: Any) -> None:
        """Handle a message of the page."""
        if isinstance(content, dict) and isinstance(content.get("page"), str):
            _soon(self._handle(content["page"], content))

    async def _handle(self, page: str, content: dict[str, Any]) -> None:
        session = self._sessions.get(page)
        if content.get("kind") == "opened" and len(self._sessions) < MOST_PAGES:
            send = partial(self._say, page)
            self._sessions[page] = PageSession(self._view, send, begun=lambda: self.settings)
            about = {**self._view.about, "settings": self.settings, "width": self._size[0]}
            about["fills"] = False  # the notebook has the settings
            await send(json.dumps({"kind": "about", **about}))
        elif content.get("kind") == "closed":
            await self._forget(page)
        elif session is not None:
            try:
                message = message_of(str(content.get("text")))
            except ValueError:
                unknown = {"kind": "error", "number": 0, "text": "not understood"}
                await self._say(page, json.dumps(unknown))
                return
            self._size = message.width, message.height
            await session.handle(message)

    async def _forget(self, page: str) -> None:
        session = self._sessions.pop(page, None)
        if session is not None:
            await session.close()

    async def _say(self, page: str, data: str | bytes) -> None:
        if isinstance(data, str):
            self.send({"page": page, "text": data})
        else:
            self.send({"page": page}, buffers=[data])


def named(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Options as on the page, spelled as in Python (`opacity_unit`) or as on the page."""
    return {key.replace("_", "-"): value for key, value in settings.items()}


def kept(
    name: str, given: Any, write: Callable[[Path, Any], object], folder: Folder | None = None
) -> tuple[str, Folder | None]:
    """File of a notebook's object; an array is written to a temporary folder, given or new."""
    if isinstance(given, str | Path):
        return str(given), folder
    folder = folder or TemporaryDirectory(prefix="view-")
    path = Path(folder.name) / name
    try:
        write(path, given)
    except BaseException:
        folder.cleanup()
        raise
    return str(path), folder


def write_levels(path: Path, given: Any) -> None:
    """Write an 8- or 16-bit picture, as `as_picture` takes it."""
    from resample.files.conversion import as_picture

    picture = as_picture(given)
    if picture.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"a picture of {picture.dtype}; give 8 or 16 bits, or a file such as .exr")
    channels = picture.shape[2] if picture.ndim == 3 else 1
    if picture.ndim not in (2, 3) or channels not in (1, 3, 4):
        raise ValueError(f"a picture of {picture.shape}; give (H, W), or (H, W, C) of 1, 3 or 4")
    import cv2

    stored = picture[..., [2, 1, 0, 3][:channels]] if channels > 2 else picture
    _, encoded = cv2.imencode(path.suffix, np.ascontiguousarray(stored))
    path.write_bytes(encoded.tobytes())  # OpenCV does not report a full disk


@cache
def _loop() -> asyncio.AbstractEventLoop:
    """Event loop of all sessions of this process, in its own thread."""
    loop = asyncio.new_event_loop()
    threading.Thread(target=loop.run_forever, name="viewer", daemon=True).start()
    return loop


def _soon(work: Any) -> None:
    asyncio.run_coroutine_threadsafe(work, _loop())
