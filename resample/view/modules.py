"""Files of the page: ES modules, served one by one or joined to one text for notebooks."""

import re
from pathlib import Path

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
