"""Run the notebooks in examples/ and store what their cells show: `python tools/notebooks.py`.

Stored pictures are seen where notebooks do not run, as on pages of repositories. Tests run the
cells again and compare (`tests/view/test_notebook.py`).
"""

import contextlib
import json
import sys
import tempfile
from base64 import b64decode, b64encode
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

from IPython.core.interactiveshell import InteractiveShell
from IPython.utils.capture import capture_output
from traitlets.config import Config

EXAMPLES = Path(__file__).parents[1] / "examples"
NAMES = ("jobs", "texture", "warp3d", "points", "volume")


def read(name: str) -> dict[str, Any]:
    """Content of a notebook."""
    content: dict[str, Any] = json.loads((EXAMPLES / f"{name}.ipynb").read_text("utf-8"))
    return content


def code_of(notebook: dict[str, Any]) -> list[dict[str, Any]]:
    """Cells of code."""
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


def outputs(notebook: dict[str, Any]) -> Iterator[list[dict[str, Any]]]:
    """Run the cells in the current folder, one after the other; yields what each of them shows."""
    shell = InteractiveShell(config=Config({"HistoryManager": {"enabled": False}}))
    # What a cell ends with is stored below, and not printed.
    shell.displayhook.write_output_prompt = lambda: None
    shell.displayhook.write_format_data = lambda *_: None
    with contextlib.ExitStack() as stack:
        for number, cell in enumerate(code_of(notebook), 1):
            with capture_output() as captured:
                ended = shell.run_cell("".join(cell["source"]))
            ended.raise_error()
            if hasattr(ended.result, "to_python"):  # a viewer
                stack.enter_context(closing(ended.result))
            yield [*_stream(captured.stdout), *_result(ended.result, number)]


def _stream(printed: str) -> Iterator[dict[str, Any]]:
    if printed:
        lines = printed.splitlines(keepends=True)
        yield {"name": "stdout", "output_type": "stream", "text": lines}


def _result(value: Any, number: int) -> Iterator[dict[str, Any]]:
    if value is None:
        return
    data = {"text/plain": [repr(value)]}
    if (png := png_of(value)) is not None:
        data = {"image/png": [b64encode(png).decode()], "text/plain": ["<picture>"]}
    shown = {"data": data, "metadata": {}, "execution_count": number}
    yield {"output_type": "execute_result", **shown}


def png_of(value: Any) -> bytes | None:
    """Picture that a notebook shows of a value, if it shows one."""
    if hasattr(value, "_repr_mimebundle_"):
        parts, _ = value._repr_mimebundle_()
        picture = parts["image/png"]
        return b64decode(picture) if isinstance(picture, str) else bytes(picture)
    png: bytes | None = value._repr_png_() if hasattr(value, "_repr_png_") else None
    return png


def store(name: str) -> None:
    """Write what the cells of a notebook show into its file."""
    notebook = read(name)
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        shown = list(outputs(notebook))
    for number, (cell, found) in enumerate(zip(code_of(notebook), shown, strict=True), 1):
        cell |= {"execution_count": number, "outputs": found}
    text = json.dumps(notebook, indent=1, ensure_ascii=False)
    (EXAMPLES / f"{name}.ipynb").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    for chosen in sys.argv[1:] or NAMES:
        store(chosen)
