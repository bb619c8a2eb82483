"""Check rules that no linter knows: `python tools/house.py` lists violations.

Modules and folders do not import each other in cycles, type-only imports included; docstrings
describe arguments that exist; functions have at most 60 lines.
"""

import ast
import re
import sys
from collections import defaultdict
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PLUGINS = sorted(path.name for path in ROOT.glob("plugins/[a-z]*"))
SOURCES = (
    *("resample", "apps/points", "apps/texture", "apps/volume", "apps/warp3d"),
    *(f"plugins/{name}/resample_{name}" for name in PLUGINS),
)
MOST_LINES = 60  # of a function, without its docstring
PARAMETERS = re.compile(r"^Parameters\n-+\n(.*?)(?=^\w[\w ]*\n-+\n|\Z)", re.DOTALL | re.MULTILINE)


class Module(NamedTuple):
    """A parsed source file."""

    path: Path  # relative to the root
    name: str  # its import name
    tree: ast.Module


def modules() -> Iterator[Module]:
    """All source files of the packages."""
    for top in SOURCES:
        for file in sorted((ROOT / top).rglob("*.py")):
            path = file.relative_to(ROOT)
            parts = path.with_suffix("").parts
            parts = parts[2:] if parts[0] in ("apps", "plugins") else parts
            name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
            yield Module(path, name, ast.parse(file.read_text(encoding="utf-8")))


def long_functions(known: list[Module]) -> Iterator[str]:
    """Functions with too many lines."""
    for module in known:
        for node in ast.walk(module.tree):
            if not isinstance(node, ast.FunctionDef):
                continue
            first = node.body[0 if ast.get_docstring(node) is None else 1 :][0:1] or node.body
            lines = node.end_lineno - first[0].lineno + 1
            if lines > MOST_LINES:
                yield f"{module.path}:{node.name}: {lines} lines, at most {MOST_LINES}"


def described_arguments(known: list[Module]) -> Iterator[str]:
    """Arguments that a docstring describes and the function does not have."""
    for module in known:
        for node in ast.walk(module.tree):
            if not isinstance(node, ast.FunctionDef):
                continue
            told = ast.get_docstring(node) or ""
            section = PARAMETERS.search(told)
            described = re.findall(r"^(?! )[^:\n]+", section[1], re.MULTILINE) if section else []
            described += re.findall(r"(?:\A|\n\n)`(\w+)`: ", told)  # the short form
            given = node.args
            known_here = {a.arg for a in given.posonlyargs + given.args + given.kwonlyargs}
            for many in filter(None, (given.vararg, given.kwarg)):
                known_here |= {many.arg, f"*{many.arg}", f"**{many.arg}"}
            for name in described:
                for one in set(name.strip().split(", ")) - known_here:
                    yield f"{module.path}:{node.name}: describes {one}, which it does not take"


def imported(module: Module, names: set[str]) -> set[str]:
    """Modules of `names` that a module imports, also for types alone, in functions or by name."""
    found = set()
    for node in ast.walk(module.tree):
        if isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            parts = [f"{node.module}.{alias.name}" for alias in node.names]
            found |= {name if name in names else node.module for name in parts}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith("import_module"):
            found |= {
                argument.value for argument in node.args if isinstance(argument, ast.Constant)
            }
    return found & names - {module.name}


def circles(known: list[Module]) -> Iterator[str]:
    """Import cycles; at most one is reported."""
    names = {module.name for module in known}
    try:
        TopologicalSorter({module.name: imported(module, names) for module in known}).prepare()
    except CycleError as error:
        yield f"modules import each other: {' <- '.join(error.args[1])}"


def folder_of(module: Module) -> str:
    """Folder of a module; a module at the top of a package counts as a place of its own."""
    folder = module.name if module.path.stem == "__init__" else module.name.rpartition(".")[0]
    return folder if "." in folder else module.name


def circles_of_folders(known: list[Module]) -> Iterator[str]:
    """Import cycles of folders, also of a folder and one inside it."""
    names = {module.name for module in known}
    folders = {module.name: folder_of(module) for module in known}
    below = defaultdict(set)  # folders that a folder imports
    for module in known:
        below[folders[module.name]] |= {folders[name] for name in imported(module, names)}
    reached = {folder: reachable(folder, below) for folder in below}
    circle = {
        folder: {other for other in all_ if folder in reached[other]}
        for folder, all_ in reached.items()
    }
    for found in {tuple(sorted(circle[folder] | {folder})) for folder in below}:
        if len(found) > 1:
            yield f"folders import each other: {', '.join(found)}"


def reachable(start: str, below: dict[str, set[str]]) -> set[str]:
    """Folders that a folder imports, directly or not."""
    found: set[str] = set()
    waiting = [start]
    while waiting:
        new = below[waiting.pop()] - found
        found |= new
        waiting.extend(new)
    return found


def main() -> int:
    """Print violations; the exit status is 1 if there is one."""
    known = list(modules())
    rules = (long_functions, described_arguments, circles, circles_of_folders)
    found = sorted(line for rule in rules for line in rule(known))
    sys.stdout.writelines(f"{line}\n" for line in found)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
