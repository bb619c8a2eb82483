"""A page in a headless Chromium: one browser for the tests of a module."""

import shutil
from base64 import b64decode
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import BytesIO
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "chrome"))), None)
NO_BROWSER = "no Chromium, or no playwright: apt install chromium, pip install playwright"
OPTIONS = ["--no-sandbox", "--disable-gpu", "--no-first-run"]
OPTIONS += ["--disable-background-networking", "--disable-sync"]
TIME = 60_000  # ms; kernels may have to be compiled
QUIET = """() => document.querySelector('.canvas[aria-busy=false] img')?.complete
    && !document.querySelector('.panes[aria-busy=true]')"""
LEVELS = """() => {
  const image = document.querySelector('.canvas img'), canvas = document.createElement('canvas');
  canvas.width = image.naturalWidth;
  canvas.height = image.naturalHeight;
  canvas.getContext('2d').drawImage(image, 0, 0);
  return canvas.toDataURL('image/png').split(',')[1];
}"""


@contextmanager
def chromium() -> Iterator[Any]:
    """Start a browser; skip where there is none."""
    sync_api = pytest.importorskip("playwright.sync_api", reason=NO_BROWSER)
    if BROWSER is None:
        pytest.skip(NO_BROWSER)
    with sync_api.sync_playwright() as play:
        opened = play.chromium.launch(executable_path=BROWSER, args=OPTIONS)
        yield opened
        opened.close()


@contextmanager
def tab_of(browser: Any, address: str, size: tuple[int, int], **options: Any) -> Iterator[Any]:
    """Open a page of a size in px, until it has its picture; reject errors of its script."""
    view = {"width": size[0], "height": size[1]}
    context = browser.new_context(viewport=view, **options)
    tab, faults = context.new_page(), []
    tab.on("pageerror", lambda error: faults.append(str(error)))
    tab.on("console", lambda said: said.type == "error" and faults.append(said.text))
    tab.set_default_timeout(TIME)
    tab.goto(address)
    settled(tab)
    yield tab
    assert faults == []
    context.close()


def settled(tab: Any) -> None:
    """Wait until the page shows what was wished for last."""
    tab.wait_for_function(QUIET)


def after(tab: Any, act: Callable[[], object]) -> None:
    """Act, and wait for the picture that follows."""
    before = tab.evaluate("document.querySelector('.canvas img').dataset.number")
    act()
    tab.wait_for_function(
        "before => document.querySelector('.canvas img').dataset.number !== before", arg=before
    )
    settled(tab)


def levels(tab: Any) -> NDArray[np.uint8]:
    """Levels (H, W, 4) of the picture that the page shows."""
    return np.asarray(Image.open(BytesIO(b64decode(tab.evaluate(LEVELS)))).convert("RGBA"))


def drag(tab: Any, start: tuple[float, float], right: float, down: float) -> None:
    """Drag the mouse over the page."""
    tab.mouse.move(*start)
    tab.mouse.down()
    tab.mouse.move(start[0] + right, start[1] + down, steps=4)
    tab.mouse.up()


def middle(tab: Any, name: str = ".canvas") -> tuple[float, float]:
    """Center of an element, px of the page."""
    box = tab.locator(name).bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
