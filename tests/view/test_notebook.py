"""The widget, told by pages of words alone; and notebooks of the examples, which run."""

import json
import queue
import re
import shutil
import socket
import subprocess
import sys
import time
from base64 import b64decode, b64encode
from collections.abc import Callable, Iterator
from contextlib import suppress
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

pytest.importorskip("anywidget", reason="pip install 'hybrid-resample[notebook]'")

import resample_texture
import resample_volume
import resample_warp3d
from resample.view.server import joined
from tools import notebooks

NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
PATIENCE = 120.0  # seconds; kernels may have to be compiled
BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("chrome")
MORE = pytest.mark.sweep


class CellPage:
    """A page of a widget."""

    def __init__(self, widget: Any, name: str = "a") -> None:
        self.widget, self.name = widget, name
        self.heard: queue.Queue[tuple[dict[str, Any], Any]] = queue.Queue()
        widget.send = lambda content, buffers=None: self.heard.put((content, buffers))
        self.say("opened")
        self.about = self.told("about")

    def say(self, kind: str, **more: Any) -> None:
        self.widget._heard(None, {"page": self.name, "kind": kind, **more}, [])

    def wish(self, kind: str, **more: Any) -> None:
        words = {"settings": self.widget.settings, "width": 48, "height": 40, "number": 1}
        self.say("told", text=json.dumps({"kind": kind, **words, **more}))

    def answer(self) -> tuple[dict[str, Any], bytes]:
        while True:
            content, buffers = self.heard.get(timeout=PATIENCE)
            assert content["page"] == self.name
            if buffers:
                end = 4 + int.from_bytes(buffers[0][:4], "little")
                return json.loads(buffers[0][4:end]), buffers[0][end:]
            words = json.loads(content["text"])
            if words["kind"] != "notice":
                return words, b""

    def told(self, kind: str) -> dict[str, Any]:
        words, _ = self.answer()
        assert words["kind"] == kind, words
        return words


BALL = np.zeros((12, 12, 12), np.uint8)
BALL[3:9, 3:9, 3:9] = 200
BOARD = (255 * (np.indices((24, 32)).sum(axis=0) % 2)).astype(np.uint8)
WIDGETS: dict[str, Callable[[], Any]] = {
    "volume by name": lambda: resample_volume.view("checker-box:size=16", camera="top"),
    "volume of an array": lambda: resample_volume.view(BALL, opacity_unit=2.0),
    "picture": lambda: resample_texture.view(BOARD, method="bilinear"),
    "color": lambda: resample_texture.view(np.stack([BOARD, BOARD // 2, BOARD // 3], axis=-1)),
    "depth image": lambda: resample_warp3d.view(BOARD, np.full(BOARD.shape, 2.0), fov=60),
}


@pytest.mark.some(4)
@pytest.mark.parametrize("kind", WIDGETS)
def test_a_page_shows_what_the_exported_python_makes(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    widget = WIDGETS[kind]()
    page = CellPage(widget)
    assert page.about["settings"] == widget.settings
    page.wish("draw", moving=False)
    head, data = page.answer()
    assert (head["kind"], head["preview"]) == ("frame", False)
    shown = np.asarray(Image.open(BytesIO(data)))
    names: dict[str, Any] = {}
    exec(widget.to_python(), names)
    for made in (names["shown"], widget.frame):
        found = made.to_uint8(background=(0, 0, 0)) if hasattr(made, "to_uint8") else made
        np.testing.assert_array_equal(np.asarray(found), shown)
    assert Path("picture.png").is_file()
    widget.close()


@pytest.mark.sweep
def test_settings_that_are_not_allowed_leave_those_that_were() -> None:
    widget = resample_volume.view("checker-box:size=16")
    before = dict(widget.settings)
    for wrong, said in (({"camera": "nowhere"}, "camera"), ({"colour": "red"}, "no option")):
        with pytest.raises(ValueError, match=said):
            widget.settings = wrong
        assert widget.settings == before
    widget.settings = before | {"camera": "front"}
    assert "'front'" in widget.to_python()
    assert "--camera=front" in widget.to_command()
    with pytest.raises(ValueError, match="transfer"):
        resample_volume.view("checker-box:size=16", transfer="no-such-look")


def test_a_page_changes_how_a_picture_looks_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    np.save("labels.npy", np.ones((16, 16, 16), np.uint8))
    widget = resample_volume.view("checker-box:size=16", labels="labels.npy")
    kept = dict(widget.settings)
    for foreign in ({"labels": "/dev/zero"}, {"mesh": ["a.ply"]}, {"transfer": "a.toml"}):
        with pytest.raises(ValueError, match="a page only changes the look"):
            widget.set_state({"settings": kept | foreign})
        page = CellPage(widget)
        page.wish("pick", x=24, y=20, settings=kept | foreign)
        assert "a page only changes the look" in page.told("error")["text"]
        assert widget.settings == kept
    widget.set_state({"settings": kept | {"camera": "front"}})
    assert widget.settings == kept | {"camera": "front"}
    widget.settings = {"camera": "top"}  # in Python all may be said
    assert widget.settings == {"camera": "top"}
    widget.close()


def test_nonsense_is_answered_and_pages_are_forgotten() -> None:
    widget = resample_volume.view("checker-box:size=16")
    page = CellPage(widget)
    page.say("told", text="{")
    assert page.told("error")["text"] == "not understood"
    widget._heard(None, "words", [])
    widget._heard(None, {"page": 7}, [])
    page.say("told", text=None)
    assert page.told("error")["text"] == "not understood"
    page.wish("pick", x=24, y=20)
    assert page.told("picked")["found"]
    page.say("closed")
    page.wish("pick", x=24, y=20)  # nobody hears it
    with pytest.raises(queue.Empty):
        page.heard.get(timeout=0.5)
    assert not widget._sessions


@pytest.mark.sweep
def test_a_notebook_without_a_kernel_has_a_picture() -> None:
    parts, _ = resample_volume.view("checker-box:size=16")._repr_mimebundle_()
    assert Image.open(BytesIO(parts["image/png"])).size == (480, 360)
    assert "application/vnd.jupyter.widget-view+json" in parts


def test_floats_are_no_picture_for_a_file_of_levels() -> None:
    with pytest.raises(ValueError, match="8 or 16 bits"):
        resample_texture.view(np.zeros((4, 4)))


CELL = """<!doctype html><div id="cell"></div><script type="module">%s
const hooks = {}, traits = { settings: %s, _style: %s };
const model = {
  get: (name) => traits[name],
  set: (name, value) => { traits[name] = value; window.chosen = value; },
  save_changes: () => {},
  on: (name, hook) => { hooks[name] = hook; },
  off: (name) => { delete hooks[name]; },
  send: (content) => window.say(content),
};
const leave = render({ model, el: document.getElementById("cell") });
window.leave = async () => { leave(); };
setInterval(async () => {
  for (const { content, bytes } of await window.heard()) {
    const decoded = bytes && Uint8Array.from(atob(bytes), (letter) => letter.charCodeAt(0));
    hooks["msg:custom"]?.(content, decoded && [new DataView(decoded.buffer)]);
  }
}, 20);
</script>"""


@pytest.mark.browser
@pytest.mark.skipif(BROWSER is None, reason="no Chromium: apt install chromium")
def test_the_cell_s_one_module_of_all_modules_works_in_a_browser() -> None:
    sync_api = pytest.importorskip("playwright.sync_api", reason="pip install playwright")
    widget = resample_volume.view("checker-box:size=16")
    said: queue.Queue[dict[str, Any]] = queue.Queue()

    def send(content: Any, buffers: Any = None) -> None:
        said.put({"content": content, "bytes": buffers and b64encode(buffers[0]).decode()})

    def heard() -> list[dict[str, Any]]:
        return [said.get() for _ in range(said.qsize())]

    widget.send = send
    with sync_api.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        tab, faults = browser.new_page(viewport={"width": 800, "height": 560}), []
        tab.on("pageerror", lambda error: faults.append(str(error)))
        tab.set_default_timeout(1000 * PATIENCE)
        tab.expose_function("say", lambda content: widget._heard(None, content, []))
        tab.expose_function("heard", heard)
        tab.set_content(CELL % (joined(), *map(json.dumps, (widget.settings, widget._style))))
        tab.locator(".canvas img[data-preview=false]").wait_for()
        tab.locator(".canvas").press("ArrowLeft")
        tab.wait_for_function("window.chosen?.camera === '36,20,1'")
        assert tab.locator("#option-camera").input_value() == "36,20,1"
        tab.evaluate("window.leave()")
        browser.close()
    assert faults == []
    widget.close()


def pictures_of(shown: list[dict[str, Any]]) -> list[np.ndarray[Any, Any]]:
    """Pictures among what a cell shows, as levels."""
    coded = [one["data"]["image/png"] for one in shown if "image/png" in one.get("data", {})]
    files = (BytesIO(b64decode("".join(one))) for one in coded)
    return [np.asarray(Image.open(file).convert("RGBA"), np.int16) for file in files]


def words_of(shown: list[dict[str, Any]]) -> str:
    """What a cell prints and the text that it ends with."""
    parts = [one.get("text") or one["data"]["text/plain"] for one in shown]
    return "".join("".join(part) for part in parts)


@pytest.mark.some(1)
@pytest.mark.parametrize("name", notebooks.NAMES)
def test_cells_of_the_examples_show_what_is_stored_in_them(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    notebook = notebooks.read(name)
    cells = notebooks.code_of(notebook)
    for cell, now in zip(cells, notebooks.outputs(notebook), strict=True):
        stored = cell["outputs"]
        assert NUMBER.sub("#", words_of(now)) == NUMBER.sub("#", words_of(stored))
        found, wanted = (NUMBER.findall(words_of(one)) for one in (now, stored))
        assert np.array(found, float) == pytest.approx(np.array(wanted, float), rel=0.01)
        assert len(pictures_of(now)) == len(pictures_of(stored))
        for picture, before in zip(pictures_of(now), pictures_of(stored), strict=True):
            assert np.abs(picture - before).max() <= 2  # levels, for other processors' rounding


@pytest.mark.parametrize("name", notebooks.NAMES)
def test_each_cell_of_the_examples_is_explained_and_shows_something(name: str) -> None:
    cells = notebooks.read(name)["cells"]
    for before, cell in pairwise(cells):
        if cell["cell_type"] == "code":
            assert before["cell_type"] == "markdown"
            assert len("".join(before["source"]).split()) > 10
            assert cell["outputs"]
    assert sum(len(pictures_of(cell["outputs"])) for cell in cells if "outputs" in cell) >= 2


@pytest.mark.sweep
@pytest.mark.parametrize(
    "name",
    ["texture", *(pytest.param(n, marks=MORE) for n in ("jobs", "volume", "warp3d", "points"))],
)
def test_notebooks_of_the_examples_run(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    nbformat = pytest.importorskip("nbformat", reason="pip install nbclient")
    nbclient = pytest.importorskip("nbclient", reason="pip install nbclient")
    pytest.importorskip("ipykernel", reason="pip install ipykernel")
    monkeypatch.chdir(tmp_path)
    notebook = nbformat.read(notebooks.EXAMPLES / f"{name}.ipynb", as_version=4)
    nbformat.validate(notebook)
    nbclient.NotebookClient(notebook, timeout=PATIENCE, kernel_name="python3").execute()
    shown = [
        output.get("data", {}) for cell in notebook.cells for output in cell.get("outputs", [])
    ]
    assert sum("image/png" in data for data in shown) >= 2
    viewers = [data for data in shown if "application/vnd.jupyter.widget-view+json" in data]
    assert len(viewers) == (name != "jobs")
    assert all(one["image/png"].startswith("iVBOR") for one in viewers)  # a PNG in base64


NOTEBOOK = """{"cells": [
{"cell_type": "code", "id": "a", "execution_count": null, "metadata": {}, "outputs": [],
 "source": "from resample_volume import view\\nshown = view('checker-box:size=16')\\nshown"},
{"cell_type": "code", "id": "b", "execution_count": null, "metadata": {}, "outputs": [],
 "source": "'camera ' + shown.settings['camera']"},
{"cell_type": "code", "id": "c", "execution_count": null, "metadata": {}, "outputs": [],
 "source": "shown.settings = {**shown.settings, 'camera': '70/10/1'}"}],
"metadata": {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}},
"nbformat": 4, "nbformat_minor": 5}"""


@pytest.fixture
def lab(tmp_path: Path) -> Iterator[str]:
    """Address of a notebook in JupyterLab."""
    pytest.importorskip("jupyterlab", reason="pip install jupyterlab")
    (tmp_path / "seen.ipynb").write_text(NOTEBOOK)
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    words = ["lab", "--no-browser", "--allow-root", "--IdentityProvider.token=t", f"--port={port}"]
    words += ["--ServerApp.port_retries=0", "--LabApp.news_url=None"]
    command = [sys.executable, "-m", "jupyter", *words]
    with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.DEVNULL) as server:
        try:
            yield f"http://127.0.0.1:{port}/lab/tree/seen.ipynb?token=t"
        finally:
            server.terminate()


@pytest.mark.browser
@pytest.mark.skipif(BROWSER is None, reason="no Chromium: apt install chromium")
def test_jupyterlab_shows_the_widget_and_settings_go_both_ways(lab: str) -> None:
    sync_api = pytest.importorskip("playwright.sync_api", reason="pip install playwright")
    with sync_api.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        tab = browser.new_page(viewport={"width": 1300, "height": 1100})
        tab.set_default_timeout(1000 * PATIENCE)
        for _ in range(100):  # until the server is there
            with suppress(sync_api.Error):
                tab.goto(lab)
                break
            time.sleep(0.3)
        tab.locator(".jp-Notebook-cell").nth(0).click()
        tab.keyboard.press("Shift+Enter")
        still = tab.locator(".canvas img[data-preview=false]")
        still.wait_for()
        tab.mouse.move(*middle(tab))
        tab.mouse.down()
        x, y = middle(tab)
        tab.mouse.move(x + 60, y, steps=5)
        tab.mouse.up()
        tab.wait_for_timeout(1500)
        camera = tab.locator("#option-camera").input_value()
        assert camera != "30,20,1"
        tab.locator(".jp-Notebook-cell").nth(1).click()
        tab.keyboard.press("Shift+Enter")
        tab.get_by_text(f"'camera {camera}'").last.wait_for()
        tab.locator(".jp-Notebook-cell").nth(2).click()
        tab.keyboard.press("Shift+Enter")
        sync_api.expect(tab.locator("#option-camera")).to_have_value("70/10/1")
        browser.close()


def middle(tab: Any) -> tuple[float, float]:
    """Middle of the picture, px."""
    box = tab.locator(".canvas").bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
