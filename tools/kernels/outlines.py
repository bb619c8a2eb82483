"""Names at the top of modules, and where they are defined."""

import ast
from collections.abc import Iterable
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple


class Outline(NamedTuple):
    """Names at the top of a module's source."""

    defined: set[str]
    imported: dict[str, str]  # and where they are from


def home(part: str) -> str:
    """Name of a constant where it is defined, whichever module imports it."""
    module, _, name = part.rpartition(".")
    origin = outline(module).imported.get(name)
    return part if origin is None else home(origin)


def modules_of(parts: Iterable[str]) -> list[str]:
    """Modules that define what a kernel is compiled from, sorted."""
    found = set()
    for part in map(home, parts):
        module = part
        while not _is_module(module):
            module = module.rpartition(".")[0]
        found.add(module)
    return sorted(found)


@cache
def _is_module(name: str) -> bool:
    try:
        return find_spec(name) is not None
    except ModuleNotFoundError:  # what is before the last dot is no package
        return False


@cache
def outline(module: str) -> Outline:
    """What a module's source defines and imports; nothing for a function that defines others."""
    defined: set[str] = set()
    imported: dict[str, str] = {}
    origin = find_spec(module).origin if _is_module(module) else None  # type: ignore[union-attr]
    for node in ast.parse(Path(origin).read_text()).body if origin else ():
        match node:
            case ast.FunctionDef() | ast.ClassDef():
                defined.add(node.name)
            case ast.Assign() | ast.AnnAssign():
                targets = [target for target in ast.walk(node) if isinstance(target, ast.Name)]
                defined |= {each.id for each in targets if isinstance(each.ctx, ast.Store)}
            case ast.ImportFrom(module=str() as other):
                imported |= {
                    each.asname or each.name: f"{other}.{each.name}" for each in node.names
                }
    return Outline(defined, imported)
