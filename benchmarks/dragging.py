"""Frame rates of browser pages while dragging: our viewer, and PyVista's trame viewer."""

import os
import shutil
import socket
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.contest import AbsentError
from benchmarks.tables import Row
from resample.colors import to_srgb
from resample_volume import open_volume
from resample_volume.classification.presets import load_transfer

BROWSERS = ("chromium", "chromium-browser", "chrome")
PICTURE = 1500  # bytes above which a message is a picture
STEP, SECONDS = 0.01, 3.0  # seconds between mouse moves of a drag, and its length
SINGLE = 15  # moves that are timed one by one
QUIET = 1.5  # seconds without messages after which the page counts as idle
PATIENCE = 90.0  # seconds to wait for a page
MAPPERS = {"smart": "its own choice", "fixed_point": "its CPU ray caster"}
MOVED = 0.005  # fraction of pixels that a drag has to change


class Heard:
    """Arrival times of a page's pictures."""

    def __init__(self, tab: Any) -> None:
        self.times: list[float] = []
        self._tab = tab
        tab.on("websocket", lambda link: link.on("framereceived", self._came))

    def _came(self, data: str | bytes) -> None:
        if len(data) >= PICTURE:
            self.times.append(time.perf_counter())

    def wait(self, count: int, seconds: float = QUIET) -> bool:
        """Wait until so many pictures have arrived, or until a timeout."""
        end = time.perf_counter() + seconds
        while len(self.times) < count and time.perf_counter() < end:
            self._tab.wait_for_timeout(1)
        return len(self.times) >= count


def peers(volume: str, look: str, scratch: str) -> dict[str, Callable[[int, int], list[str]]]:
    """Commands that serve pages, by viewer, for a port and a side in px.

    Raises
    ------
    AbsentError
        There is no browser, or no driver for it.
    """
    if not next(filter(None, map(shutil.which, BROWSERS)), None) or not find_spec("playwright"):
        raise AbsentError("no Chromium, or no playwright: apt install chromium")

    def ours(port: int, _: int) -> list[str]:
        words = ["-m", "resample_volume", "view", volume, "--transfer", look]
        return [*words, "--no-browser", "--port", str(port)]

    found: dict[str, Callable[[int, int], list[str]]] = {"resample-volume view": ours}
    if find_spec("pyvista") and find_spec("trame_pyvista") and find_spec("trame_vuetify"):
        path = str(Path(scratch) / "volume.npz")
        _write(volume, look, path)
        for mapper, name in MAPPERS.items():
            words = ["-m", "benchmarks.trame_page", path, mapper]
            found[f"PyVista's trame viewer, {name}"] = partial(_numbered, words)
    return found


def measured(words: Sequence[str], port: int, side: int) -> Row:
    """Measure a page that a command serves.

    Returns
    -------
    Seconds from the command to the first picture; pictures per second while dragging; the server's
    CPU time per picture, ms; medians, ms, from a move to its picture, and from the end of a drag to
    its last picture.
    """
    from playwright.sync_api import sync_playwright

    browser = next(filter(None, map(shutil.which, BROWSERS)))
    with sync_playwright() as play:
        opened = play.chromium.launch(executable_path=browser, args=["--no-sandbox"])
        tab = opened.new_page(viewport={"width": side, "height": side})
        heard, start = Heard(tab), time.perf_counter()
        with served(words, port) as (process, address):
            tab.goto(address)
            if not heard.wait(1, PATIENCE):
                raise AbsentError(f"{' '.join(words)}: no picture has come")
            first = heard.times[0] - start
            place = fitted(tab, side)
            heard.wait(10_000, QUIET)  # until the page is idle
            before = pixels(tab)
            row = dragged(tab, heard, place, process.pid)
            if (pixels(tab) != before).any(axis=-1).mean() < MOVED:
                raise AbsentError(f"{' '.join(words)}: a drag has moved nothing")
        opened.close()
    return {"first_s": first, **row}


def fitted(tab: Any, side: int) -> tuple[float, float]:
    """Center of the picture, px, after resizing the window so that the picture is square."""
    canvas = tab.locator(".canvas, .v-application").first
    for _ in range(8):  # the picture's height is a fraction of the window's
        missing = side - canvas.bounding_box()["height"]
        height = tab.viewport_size["height"] + missing
        tab.set_viewport_size({"width": side, "height": round(height)})
    box = canvas.bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def dragged(tab: Any, heard: Heard, place: tuple[float, float], process: int) -> Row:
    """Measure a drag around a position, px; see `measured`."""
    x, y = place
    tab.mouse.move(x, y)
    tab.mouse.down()
    tab.mouse.move(x + 5, y)
    heard.wait(10_000, 0.1)
    steps = []
    for n in range(SINGLE):
        count, start = len(heard.times), time.perf_counter()
        tab.mouse.move(x + 8 + 2 * n, y + n)
        if heard.wait(count + 1):
            steps.append(heard.times[count] - start)
    count, busy, start = len(heard.times), cpu(process), time.perf_counter()
    while (spent := time.perf_counter() - start) < SECONDS:
        tab.mouse.move(x + 60 * np.cos(4 * spent), y + 30 * np.sin(4 * spent))
        tab.wait_for_timeout(1000 * STEP)
    shown, busy, end = len(heard.times) - count, cpu(process) - busy, time.perf_counter()
    tab.mouse.up()
    comes = heard.wait(len(heard.times) + 1, PATIENCE)
    heard.wait(10_000, QUIET)
    return {
        "pictures_per_s": shown / spent,
        "server_CPU_ms": 1000 * busy / shown if shown else None,
        "step_ms": 1000 * statistics.median(steps) if steps else None,
        "still_ms": 1000 * (heard.times[-1] - end) if comes else None,
    }


@contextmanager
def served(words: Sequence[str], port: int) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Start a page's process and wait for its address."""
    command = [sys.executable, *words]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as process:
        try:
            address = f"http://127.0.0.1:{port}/"
            if "--no-browser" in words:
                assert process.stdout is not None
                address = process.stdout.readline().strip()
            end = time.perf_counter() + PATIENCE
            while process.poll() is None and time.perf_counter() < end:
                with socket.socket() as link:
                    if link.connect_ex(("127.0.0.1", port)) == 0:
                        break
                time.sleep(0.02)
            yield process, address
        finally:
            process.terminate()


def free_port() -> int:
    """Find a free port."""
    with socket.create_server(("127.0.0.1", 0)) as link:
        return int(link.getsockname()[1])


def cpu(process: int) -> float:
    """CPU time of all threads of a process, seconds."""
    words = Path(f"/proc/{process}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def pixels(tab: Any) -> NDArray[np.uint8]:
    """Screenshot of a page."""
    from PIL import Image

    return np.asarray(Image.open(BytesIO(tab.screenshot())).convert("RGB"))


def _numbered(words: list[str], port: int, side: int) -> list[str]:
    return [*words, str(port), str(side)]


def _write(volume: str, look: str, path: str) -> None:
    """Write a volume and its look for `trame_page`."""
    given = open_volume(volume)
    low, high = float(given.values.min()), float(given.values.max())
    value = np.linspace(low, high, 256)
    color, opacity = load_transfer(look).classify(value, None, (low, high), 1.0)
    np.savez(
        path, values=given.values, spacing=given.spacing, color=to_srgb(color), opacity=opacity
    )
