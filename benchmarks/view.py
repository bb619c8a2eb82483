"""Speed of the viewer: pictures per second while dragging, and time to the full picture."""

import json
import os
import statistics
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from websockets.sync.client import ClientConnection, connect

from benchmarks.contest import AbsentError, Options
from benchmarks.dragging import free_port, peers
from benchmarks.dragging import measured as page
from benchmarks.measure import MEBI
from benchmarks.tables import Row, Section
from resample.view.server import served
from resample_volume.viewing import volume_view

SIDE = 400  # px
LOOK = "engine"
STEPS = 40  # of a drag
WAIT = 0.05  # seconds
FURTHER = 4  # additional pages to measure memory


def measured(volume: str, side: int = SIDE, steps: int = STEPS) -> dict[str, Any]:
    """Measure a page that rotates a volume.

    Parameters
    ----------
    volume
        As for the command.
    side
        Side of the page's picture, px.
    steps
        Number of previews while dragging.

    Returns
    -------
    Seconds to the first full picture (kernels are then loaded), pictures per second while dragging,
    median ms from a request to its preview and to the full picture after it; and resident memory of
    further pages, MiB each.
    """
    start = time.perf_counter()
    with served(volume_view(volume)) as (host, token):
        address = f"ws://{host}/socket?token={token}"
        origin: Any = f"http://{host}"
        with connect(address, origin=origin, max_size=None) as link:
            settings = json.loads(link.recv())["settings"]
            _drawn(link, settings, side, moving=False)
            first = time.perf_counter() - start
            _drawn(link, settings, side, moving=True)
            previews, finals = [], []
            for n in range(steps):
                turned = settings | {"camera": f"{30 + n}/20/1"}
                previews.append(_drawn(link, turned, side, moving=True))
                if n % 10 == 9:
                    time.sleep(WAIT)
                    finals.append(_drawn(link, turned, side, moving=False))
            before = memory_now()
            with ExitStack() as pages:
                for _ in range(FURTHER):
                    page = pages.enter_context(connect(address, origin=origin, max_size=None))
                    _drawn(page, json.loads(page.recv())["settings"], side, moving=True)
                    _drawn(page, settings, side, moving=False)
                page_size = (memory_now() - before) / FURTHER
    return {
        "volume": Path(volume).name,
        "first_s": round(first, 2),
        "previews_per_s": round(1 / statistics.mean(previews), 1),
        "preview_ms": round(1000 * statistics.median(previews), 1),
        "final_ms": round(1000 * statistics.median(finals), 1),
        "page_MiB": round(page_size, 1),
    }


def memory_now() -> float:
    """Resident memory of this process, MiB."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / MEBI


def _drawn(link: ClientConnection, settings: dict[str, Any], side: int, *, moving: bool) -> float:
    """Seconds from a request to its picture."""
    words = {"kind": "draw", "settings": settings, "width": side, "height": side, "number": 1}
    start = time.perf_counter()
    link.send(json.dumps(words | {"moving": moving}))
    while not isinstance(link.recv(), bytes):
        pass
    return time.perf_counter() - start


def sections(options: Options) -> Iterator[Section]:
    """Table of the viewer's times."""
    volumes = ["vessel-tree:size=64"]
    volumes += sorted(map(str, options.volumes.glob("engine.nhdr")))
    sides = (100,) if options.quick else (SIDE,)
    rows: list[Row] = [
        {"side_px": side, **measured(volume, side, 10 if options.quick else STEPS)}
        for volume in volumes
        for side in sides
    ]
    yield Section(
        "Viewer",
        "A volume that is turned in a page of words alone, on this machine: seconds from nothing "
        "to the first picture, pictures per second of a drag, medians from a wish to its picture.",
        rows,
    )
    yield from beside(volumes[-1], options)


def beside(volume: str, options: Options) -> Iterator[Section]:
    """Table of browser pages, if there is a browser."""
    section = Section(
        "Viewers in a browser",
        f"{Path(volume).name} with the look {LOOK}, dragged in Chromium without a window, by its "
        "own page and by PyVista's. Pictures come from the server in both, and both are waited "
        "for alike: seconds from the command to the first picture; of a drag, pictures per second, "
        "the server's CPU time for each, the median from a movement to its picture, and from "
        "the last one to the whole picture. The better of two runs.",
    )
    side = 200 if options.quick else SIDE
    try:
        commands = peers(volume, LOOK, options.scratch)
    except AbsentError as error:
        section.notes.append(f"Left out: {error}.")
        commands = {}
    for name, words in commands.items():
        port = free_port()
        rounds = [page(words(port, side), port, side) for _ in range(1 if options.quick else 2)]
        best = max(rounds, key=lambda row: float(row["pictures_per_s"]))  # type: ignore[arg-type]
        section.rows.append({"viewer": name, "side_px": side, **best})
    if len(commands) == 1:
        section.notes.append("PyVista's is not installed: pip install 'pyvista[jupyter]'.")
    yield section
