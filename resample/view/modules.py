"""The page's files: ES modules, which a browser loads one by one and a notebook as one text."""

import re
from pathlib import Path

PAGE = Path(__file__).parent / "page"
TYPES = {".html": "text/html", ".js": "text/javascript", ".css": "text/css"}
NOTEBOOK = PAGE / "notebook.js"  # what a cell begins with
_IMPORT = re.compile(r'^import \{[^}]*\} from "\./(?P<name>[\w-]+\.js)";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export (?!default)", re.MULTILINE)


def parts() -> frozenset[str]:
    """Names of the files that a page asks for: its modules, and how it looks."""
    return frozenset(path.name for path in PAGE.iterdir() if path.suffix in (".js", ".css"))


def joined(entry: Path = NOTEBOOK) -> str:
    """One module of one module and all that it imports, each after those that it imports itself.

    Modules of the page have no name twice, and import each other by `import { a, b } from "./c.js"`
    alone; so the text of all of them, without imports and exports, is a module as well.

    Parameters
    ----------
    entry
        A module, whose default export remains.
    """
    texts: dict[Path, str] = {}
    _gather(entry, texts)
    return "\n".join(texts.values())


def _gather(path: Path, texts: dict[Path, str]) -> None:
    """Add a module, after what it imports."""
    text = path.read_text(encoding="utf-8")
    for found in _IMPORT.finditer(text):
        wanted = path.with_name(found["name"])
        if wanted not in texts:
            _gather(wanted, texts)
    texts[path] = _EXPORT.sub("", _IMPORT.sub("", text))
