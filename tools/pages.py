"""Pages of the documentation and examples, and the commands in them."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
BUILT = ("_build", "gallery", "tutorials", "generated", "commands")  # written by `make docs`
PAGES = sorted(
    path
    for suffix in ("md", "rst")
    for path in DOCS.rglob(f"*.{suffix}")
    if not {*BUILT, "_templates"} & set(path.relative_to(DOCS).parts)
)
LINKED = [
    ROOT / "README.md",
    *(p for p in PAGES if p.suffix == ".md"),
    *ROOT.glob("apps/*/README.md"),
    *ROOT.glob("notes/*.md"),
]
SCRIPTS = sorted((ROOT / "examples").glob("gallery/*/plot_*.py"))
TUTORIALS = sorted((ROOT / "examples" / "tutorials").glob("plot_*.py"))
COMMAND = re.compile(r"(?:\$ )?((?:resample|resample-\w+) \S.*)")
SHELLS = ("", "console", "bash", "sh")  # languages of blocks that hold commands


def in_blocks(path: Path) -> Iterator[str]:
    """Commands in a page's blocks, fenced or indented."""
    fence = None
    for line in path.read_text(encoding="utf-8").splitlines():
        if line.startswith("```"):
            fence = line.strip("`").strip() if fence is None else None
        elif fence in SHELLS or (fence is None and line.startswith("    ")):
            found = COMMAND.fullmatch(line.strip())
            yield from found.groups() if found else ()


def commands() -> Iterator[tuple[Path, str]]:
    """Commands of the docs, each with the file that it is in."""
    for path in LINKED:
        yield from ((path, line) for line in in_blocks(path))
    for path in [*SCRIPTS, *TUTORIALS]:
        yield from ((path, line) for line in shown_by(path))


def shown_by(script: Path) -> list[str]:
    """Commands in an example's text."""
    return re.findall(r"^[# ]+\$ (.+)$", script.read_text(encoding="utf-8"), re.MULTILINE)


def runs_as_it_stands(line: str) -> bool:
    """Whether a command is of built-in data, and ends by itself."""
    words = shlex.split(line, comments=True)
    return "view" not in words and any(word.startswith("sample:") for word in words)
