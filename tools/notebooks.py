"""Run the notebooks in examples/ and store what their cells show: `python tools/notebooks.py`.

Stored pictures are seen where notebooks do not run, as on pages of repositories. Tests run the
cells again and compare (`tests/view/test_notebook.py`).
"""

import ast
import contextlib
import io
import json
import sys
import tempfile
from base64 import b64decode, b64encode
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

EXAMPLES = Path(__file__).parents[1] / "examples"
NAMES = ("texture", "warp3d", "points", "volume")


def read(name: str) -> dict[str, Any]:
    """Content of a notebook."""
    content: dict[str, Any] = json.loads((EXAMPLES / f"{name}.ipynb").read_text("utf-8"))
    return content


def code_of(notebook: dict[str, Any]) -> list[dict[str, Any]]:
    """Cells of code."""
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


def outputs(notebook: dict[str, Any]) -> Iterator[list[dict[str, Any]]]:
    """Run the cells in the current folder, one after the other; yields what each of them shows."""
    names: dict[str, Any] = {}
    with contextlib.ExitStack() as stack:
        for number, cell in enumerate(code_of(notebook), 1):
            printed, value = run("".join(cell["source"]), names)
            if hasattr(value, "to_python"):  # a viewer
                stack.enter_context(closing(value))
            yield [*_stream(printed), *_result(value, number)]


def run(source: str, names: dict[str, Any]) -> tuple[str, Any]:
    """Run a cell; returns what it printed and the value that it ends with."""
    cell = ast.parse(source)
    last = cell.body.pop() if isinstance(cell.body[-1], ast.Expr) else None
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(compile(cell, "cell", "exec"), names)  # noqa: S102 - a notebook of ours
        rest = last and compile(ast.Expression(last.value), "cell", "eval")
        value = rest and eval(rest, names)  # noqa: S307
    return printed.getvalue(), value


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
