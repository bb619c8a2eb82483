"""Check rules that no linter knows: `python tools/house.py` lists violations.

With `--map` it prints the map of folders for docs/ARCHITECTURE.md.

Folders have few files, kernels have few arguments (related data travel in one bundle), a class name
has few meanings, and neither modules nor folders import each other in cycles, type-only imports
included. Known violations are listed in `pyproject.toml`; that list may only shrink.
"""

import ast
import io
import re
import sys
import tokenize
import tomllib
from collections import Counter, defaultdict
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
ARCHITECTURE = ROOT / "docs" / "ARCHITECTURE.md"
SOURCES = ("resample", "apps/points", "apps/texture", "apps/volume", "apps/warp3d")
KERNELS = {"engine", "hybrid", "kernels"}  # folders with numba code
MOST_FILES = 12  # of a folder, besides __init__.py
MOST_ARGUMENTS = 8  # of a kernel; ruff counts arguments of other functions
MOST_LINES = 60  # of a function, without its docstring
MOST_HOMES = 1  # of a class name
LEAST_COMMENTS = 40  # lines of comments per 1,000 lines of kernels
MOST_BUNDLES = 270  # named tuples that are built in one place; may only fall
PARAMETERS = re.compile(r"^Parameters\n-+\n(.*?)(?=^\w[\w ]*\n-+\n|\Z)", re.DOTALL | re.MULTILINE)
PRIVATE_WORDS = re.compile(  # where the field has others: classify, gather, visible, scratch, cache
    r"look(s|ed|ing)?|sees?|seen|unseen|sights?|sighting|gazes?|glances?|shelf|shelves|rooms?|matters?"
)


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
            parts = parts[2:] if parts[0] == "apps" else parts
            name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
            yield Module(path, name, ast.parse(file.read_text(encoding="utf-8")))


def crowded_folders(known: list[Module]) -> Iterator[str]:
    """Folders with too many files."""
    files = Counter(module.path.parent for module in known if module.path.stem != "__init__")
    for folder, count in files.items():
        if count > MOST_FILES:
            yield f"{folder}: {count} files, at most {MOST_FILES}"


def long_functions(known: list[Module]) -> Iterator[str]:
    """Functions with too many lines, and kernels with too many arguments."""
    for module in known:
        for node in ast.walk(module.tree):
            if not isinstance(node, ast.FunctionDef):
                continue
            first = node.body[0 if ast.get_docstring(node) is None else 1 :][0:1] or node.body
            lines = node.end_lineno - first[0].lineno + 1
            arguments = len(node.args.posonlyargs + node.args.args + node.args.kwonlyargs)
            if lines > MOST_LINES:
                yield f"{module.path}:{node.name}: {lines} lines, at most {MOST_LINES}"
            if KERNELS & set(module.path.parts) and arguments > MOST_ARGUMENTS:
                yield f"{module.path}:{node.name}: {arguments} arguments, at most {MOST_ARGUMENTS}"


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


def ambiguous_names(known: list[Module]) -> Iterator[str]:
    """Class names defined in too many files."""
    homes = defaultdict(set)
    for module in known:
        for node in ast.walk(module.tree):
            if isinstance(node, ast.ClassDef):
                homes[node.name].add(str(module.path))
    for name, paths in homes.items():
        if len(paths) > MOST_HOMES:
            yield f"class {name}: {len(paths)} homes ({', '.join(sorted(paths))})"


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


def words_of(name: str) -> list[str]:
    """Words of a name, in small letters."""
    parts = re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name)
    return [part.lower() for part in parts]


def definitions(module: Module) -> Iterator[str]:
    """Names that a module defines, its own included: of functions, classes, members, constants."""
    yield module.name.rpartition(".")[2]
    for node in ast.walk(module.tree):
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            yield node.name
        if isinstance(node, ast.ClassDef | ast.Module):
            for part in node.body:
                if isinstance(part, ast.AnnAssign):
                    yield ast.unparse(part.target)
                elif isinstance(part, ast.Assign):
                    yield from (ast.unparse(target) for target in part.targets)


def private_words(known: list[Module]) -> Iterator[str]:
    """Definitions whose names have words of a private language."""
    for module in known:
        for name in definitions(module):
            if any(PRIVATE_WORDS.fullmatch(word) for word in words_of(name)):
                yield f"{module.path}:{name}: not a word of the field"


def silent_kernels(known: list[Module]) -> Iterator[str]:
    """Report if the steps of kernels are not named by comments."""
    lines = comments = 0
    for module in known:
        if KERNELS & set(module.path.parts):
            text = (ROOT / module.path).read_text(encoding="utf-8")
            lines += text.count("\n")
            tokens = tokenize.generate_tokens(io.StringIO(text).readline)
            comments += sum(
                token.type == tokenize.COMMENT and token.line.lstrip().startswith("#")
                for token in tokens
            )
    if 1000 * comments < LEAST_COMMENTS * lines:
        yield (
            f"{1000 * comments / lines:.0f} lines of comments per 1,000 lines of kernels, at least "
            f"{LEAST_COMMENTS}"
        )


def bundles_built_once(known: list[Module]) -> Iterator[str]:
    """Report if more named tuples than on record are built in one place only."""
    bundles, built = set(), Counter[str]()
    for module in known:
        for node in ast.walk(module.tree):
            if isinstance(node, ast.ClassDef) and "NamedTuple" in map(ast.unparse, node.bases):
                bundles.add(node.name)
            elif isinstance(node, ast.Call):
                built[ast.unparse(node.func).rpartition(".")[2]] += 1
    count = sum(built[name] == 1 for name in bundles)
    if count > MOST_BUNDLES:
        yield f"{count} named tuples are built in one place only, at most {MOST_BUNDLES}"


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


def map_of_folders(known: list[Module]) -> str:
    """Every folder except those of kernels, with the first line of its `__init__.py`."""
    lines = []
    for module in known:
        if module.path.stem == "__init__" and module.path.parent.name != "kernels":
            purpose = (ast.get_docstring(module.tree) or "").partition("\n")[0]
            lines.append(f"{f'{module.path.parent}/':39}{purpose}\n")
    return "".join(sorted(lines))


def untrue_map(known: list[Module]) -> Iterator[str]:
    """Report a map of folders that differs from the one in docs/ARCHITECTURE.md."""
    if map_of_folders(known) not in ARCHITECTURE.read_text(encoding="utf-8"):
        yield f"{ARCHITECTURE.name}: its map of folders is not what tools/house.py --map prints"


def main() -> int:
    """Print new violations, and known ones that no longer exist."""
    known = list(modules())
    if "--map" in sys.argv:
        sys.stdout.write(map_of_folders(known))
        return 0
    rules = (
        crowded_folders,
        long_functions,
        described_arguments,
        ambiguous_names,
        private_words,
        silent_kernels,
        bundles_built_once,
        circles,
        circles_of_folders,
        untrue_map,
    )
    found = {line for rule in rules for line in rule(known)}
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    allowed = set(settings.get("tool", {}).get("house", {}).get("known", []))
    for line in sorted(found - allowed):
        sys.stdout.write(f"{line}\n")
    for line in sorted(allowed - found):
        sys.stdout.write(f"fixed, remove it from [tool.house]: {line}\n")
    return 1 if found ^ allowed else 0


if __name__ == "__main__":
    sys.exit(main())
