"""Local web server of the viewer: one address with a token, one socket per page."""

import asyncio
import contextlib
import json
import logging
import re
import secrets
import socket
import sys
import threading
import time
import webbrowser
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from resample.command.settings import Serving
from resample.console import say, say_notes
from resample.messages import one_line
from resample.view.sessions import LONGEST, PageSession, message_of
from resample.view.views import Viewable, Warming

if TYPE_CHECKING:
    import uvicorn
    from starlette.applications import Starlette
    from starlette.requests import HTTPConnection, Request
    from starlette.responses import Response
    from starlette.websockets import WebSocket

LOOPBACK = "127.0.0.1"
OWN = (LOOPBACK, "localhost", "::1")  # addresses that other machines cannot reach
# Of addresses that stand for all: one of others, to find the address here that leads there; and one
# for a machine without a network.
ALL = {"0.0.0.0": ("192.0.2.1", LOOPBACK), "::": ("2001:db8::1", "::1")}  # noqa: S104
MOST_PAGES = 8  # open at the same time
NOTABLE = 5.0  # seconds of compilation after which its end is reported
LOG = logging.getLogger("resample")
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' blob:; connect-src 'self'; base-uri 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
PAGE = Path(__file__).parent / "page"
TYPES = {".html": "text/html", ".js": "text/javascript", ".css": "text/css"}
NOTEBOOK = PAGE / "notebook.js"  # entry point in a notebook cell
_IMPORT = re.compile(r'^import \{[^}]*\} from "\./(?P<name>[\w-]+\.js)";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export (?!default)", re.MULTILINE)


def parts() -> frozenset[str]:
    """Names of the files that a page loads: its modules and style sheet."""
    return frozenset(path.name for path in PAGE.iterdir() if path.suffix in (".js", ".css"))


def joined(entry: Path = NOTEBOOK) -> str:
    """Join a module and all its imports, dependencies first, to one module.

    Names are unique across the page's modules, and their only imports are of the form
    `import { a, b } from "./c.js"`; so their text without imports and exports is a module as well.
    """
    texts: dict[Path, str] = {}
    _gather(entry, texts)
    return "\n".join(texts.values())


def _gather(path: Path, texts: dict[Path, str]) -> None:
    """Add a module after its imports."""
    text = path.read_text(encoding="utf-8")
    for found in _IMPORT.finditer(text):
        wanted = path.with_name(found["name"])
        if wanted not in texts:
            _gather(wanted, texts)
    texts[path] = _EXPORT.sub("", _IMPORT.sub("", text))


def application(
    view: Viewable, token: str, hosts: Sequence[str], shown: Callable[[], object] | None = None
) -> "Starlette":
    """Web application that serves a view to clients with the token, from these hosts (with port).

    The address at which a connection arrives is also accepted; a foreign host name that leads here
    is not. `shown` is called when a page has received a complete picture.
    """
    from starlette.applications import Starlette
    from starlette.responses import Response
    from starlette.routing import Route, WebSocketRoute

    open_pages: set[PageSession] = set()

    def is_known(asking: "HTTPConnection") -> bool:
        given, here = asking.query_params.get("token") or "", asking.scope.get("server")
        own = [] if here is None else [_host(here[0].removeprefix("::ffff:"), here[1])]
        is_one = asking.headers.get("host") in (*hosts, *own)
        return is_one and secrets.compare_digest(given.encode(), token.encode())

    async def page(request: "Request") -> "Response":
        if not is_known(request):
            return Response("This page needs the address that the command printed.", 403)
        return _file("index.html")

    async def part(request: "Request") -> "Response":
        name = request.path_params["name"]
        if name == "favicon.ico":
            return Response(status_code=204)
        return _file(name) if name in parts() else Response("", 404)

    async def talk(socket: "WebSocket") -> None:
        is_own = socket.headers.get("origin") == f"http://{socket.headers.get('host')}"
        if not is_own or not is_known(socket) or len(open_pages) >= MOST_PAGES:
            await socket.close(1008)
            return
        await socket.accept()
        await _talked(socket, view, open_pages, shown)

    return Starlette(
        routes=[Route("/", page), WebSocketRoute("/socket", talk), Route("/{name}", part)]
    )


def _file(name: str) -> "Response":
    from starlette.responses import Response

    path = PAGE / name
    return Response(path.read_bytes(), headers=HEADERS, media_type=TYPES[path.suffix])


async def _talked(
    socket: "WebSocket",
    view: Viewable,
    open_pages: set[PageSession],
    shown: Callable[[], object] | None,
) -> None:
    """Exchange messages with a page until it is closed."""
    from starlette.websockets import WebSocketDisconnect

    turn = asyncio.Lock()

    async def send(data: str | bytes) -> None:
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):  # the page was closed
            async with turn:
                await (socket.send_text(data) if isinstance(data, str) else socket.send_bytes(data))

    session = PageSession(view, send, shown)
    open_pages.add(session)
    try:
        await send(json.dumps({"kind": "about", **view.about}))
        while True:
            try:
                message = message_of(await socket.receive_text())
            except (ValueError, KeyError):  # invalid text or message
                await send(json.dumps({"kind": "error", "number": 0, "text": "not understood"}))
                continue
            except RuntimeError:  # the page was closed while sending
                break
            await session.handle(message)
    except WebSocketDisconnect:
        pass
    finally:
        open_pages.discard(session)
        await session.close()


@contextlib.contextmanager
def served(
    view: Viewable, shown: Callable[[], object] | None = None, host: str = LOOPBACK
) -> Iterator[tuple[str, str]]:
    """Serve a view from a background thread.

    Yields: host with its port, and the token.
    """
    (listening, hosts), token = _listening(host, 0), secrets.token_urlsafe(24)
    server = _server(application(view, token, hosts, shown))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]}, daemon=True)
    thread.start()
    try:
        while not server.started and thread.is_alive():
            time.sleep(0.01)
        yield hosts[0], token
    finally:
        server.should_exit = True
        thread.join()


def _server(served: "Starlette") -> "uvicorn.Server":
    import uvicorn

    config = uvicorn.Config(served, log_level="warning", ws_max_size=LONGEST, lifespan="off")
    return uvicorn.Server(config)


def _listening(host: str, port: int) -> tuple[socket.socket, list[str]]:
    """Listen at an address; also return its names with the port, a public one first."""
    host = host.removeprefix("[").removesuffix("]")
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    both = host == "::" and socket.has_dualstack_ipv6()
    listening = socket.create_server((host, port), family=family, dualstack_ipv6=both)
    names = [host, *OWN[:2], *([] if host in OWN else [socket.gethostname()])]
    place, port = listening.getsockname()[:2]
    if place in ALL:
        away, names[0] = ALL[place]
        with socket.socket(family, socket.SOCK_DGRAM) as asking, contextlib.suppress(OSError):
            asking.connect((away, 9))  # sends nothing
            names[0] = asking.getsockname()[0]
    return listening, [_host(name, port) for name in dict.fromkeys(names)]


def _host(name: str, port: int) -> str:
    """Host with its port as browsers write it."""
    shown = f"[{name}]" if ":" in name else name
    return shown if port == 80 else f"{shown}:{port}"


def show(view_of: Callable[[], Viewable], page: Serving) -> None:
    """Serve the view that a function opens, at the address of a command's options."""
    view = view_of()
    view.check()
    say_notes()
    serve(view, host=page.host, port=page.port, browser=page.browser)


def serve(view: Viewable, *, host: str = LOOPBACK, port: int = 0, browser: bool = True) -> None:
    """Serve a view until Ctrl-C.

    `view`: the view to serve. `host`: address to listen at. A warning is printed if other machines
    can reach it. `port`: port; 0: any free port. `browser`: Open the page in the browser. Raises
    ValueError: the extra is not installed. Raises OSError: the port is taken.
    """
    if host.strip("[]") not in OWN:
        say(f"anyone who reaches {host} and learns the address can view, and read, your files")
    (listening, hosts), token = _listening(host, port), secrets.token_urlsafe(24)
    address = f"http://{hosts[0]}/?token={token}"
    sys.stdout.write(f"{address}\n")
    sys.stdout.flush()
    if browser:
        webbrowser.open(address)
    say("press Ctrl-C to stop")
    first = threading.Event()
    if isinstance(view, Warming):
        threading.Thread(target=_warmed, args=(view, first), name="warm", daemon=True).start()
    _server(application(view, token, hosts, first.set)).run(sockets=[listening])


def _warmed(view: Warming, first: threading.Event) -> None:
    """Compile kernels for other kinds of pictures once the first is shown, and report it."""
    first.wait()
    start = time.monotonic()
    try:
        for _ in view.warm():
            pass
    except Exception as error:  # reported when a page needs that kind
        LOG.debug("kernels could not be compiled for all kinds of pictures: %s", one_line(error))
    if time.monotonic() - start > NOTABLE:
        LOG.info("kernels for all kinds of pictures are compiled")
