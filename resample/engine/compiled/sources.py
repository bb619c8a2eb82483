"""Fingerprints of all sources that a kernel's machine code is made from.

These are the kernel's module, those of the bundles that it is called with and of the bodies that
these play in its roles, and all that any of them imports, within their own packages and this one.
"""

import hashlib
import re
import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator
from functools import cache
from importlib.machinery import PathFinder
from pathlib import Path
from typing import NamedTuple

CORE = __name__.partition(".")[0]
# An edit of these changes all machine code; what they import changes none.
TOOLS = tuple(f"{CORE}.engine.{name}" for name in ("jit", "roles", "compiled.compiling"))
IMPORT = re.compile(
    rb"^[ \t]*(?:from[ \t]+([\w.]+)[ \t]+import[ \t]+(\([^)]*\)|[^\n;]+)|import[ \t]+([^\n;]+))",
    re.MULTILINE,
)
NAME = re.compile(rb"([A-Za-z_][\w.]*)(?:[ \t]+as[ \t]+\w+)?")
COMMENT = re.compile(rb"#[^\n]*")

# For each class of bundles, modules of the roles that it plays and of the bodies that it plays.
PLAYED: defaultdict[type, set[tuple[str, str]]] = defaultdict(set)


class ModuleSource(NamedTuple):
    """A module's source."""

    digest: str
    imports: tuple[str, ...]  # modules, and names that may be modules, which it imports


def digest(module: str, classes: Iterable[type] = ()) -> str | None:
    """Fingerprint of what a kernel is compiled from.

    Parameters
    ----------
    module
        The kernel's.
    classes
        Of the bundles that it is called with.

    Returns
    -------
    str or None
        None if the module has no file to be read.
    """
    needed = modules(module, classes)
    return _digest_of(needed) if module in needed else None


def modules(module: str, classes: Iterable[type] = ()) -> frozenset[str]:
    """Names of the modules that a kernel is compiled from, of those that have files."""
    classes = list(classes)
    needed = closure(module, *(each.__module__ for each in classes))
    bodies = {body for each in classes for role, body in PLAYED[each] if role in needed}
    return needed.union(*(closure(body) for body in bodies))


@cache
def engine_digest() -> str:
    """Fingerprint of the whole engine, for what is kept of its results."""
    folder = Path(__file__).parents[1]
    files = [folder.parent / "types.py", *sorted(folder.rglob("*.py"))]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


@cache
def _digest_of(modules: frozenset[str]) -> str:
    lines = (f"{name} {source(name).digest}\n" for name in sorted(modules))  # type: ignore[union-attr]
    return hashlib.sha256("".join(lines).encode()).hexdigest()


@cache
def closure(*modules: str) -> frozenset[str]:
    """Names of modules and of all that they import within their packages and this one."""
    tops = {CORE, *(name.partition(".")[0] for name in modules)}
    needed: set[str] = set()
    waiting = [*TOOLS, *modules]
    while waiting:
        name = waiting.pop()
        found = source(name) if name not in needed else None
        if found is None:
            continue
        needed.add(name)
        if name not in TOOLS:
            waiting += (other for other in found.imports if other.partition(".")[0] in tops)
    return frozenset(needed)


@cache
def source(module: str) -> ModuleSource | None:
    """A module's source as it is on disk; None if there is no such module, or no file of it."""
    path = _path(module)
    try:
        text = path.read_bytes() if path is not None else None
    except OSError:
        text = None
    if text is None:
        return None
    return ModuleSource(hashlib.sha256(text).hexdigest(), tuple(dict.fromkeys(_imports(text))))


def _imports(text: bytes) -> Iterator[str]:
    for origin, names, plain in IMPORT.findall(COMMENT.sub(b"", text)):
        if plain:
            yield from (name.decode() for name in NAME.findall(plain))
            continue
        yield origin.decode()
        for name in NAME.findall(names):
            yield f"{origin.decode()}.{name.decode()}"


def _path(module: str) -> Path | None:
    """Where a module's source is; it need not have been imported."""
    origin = getattr(sys.modules.get(module), "__file__", None)
    if origin is not None:
        return Path(origin) if origin.endswith(".py") else None
    top, *inner = module.split(".")
    root = _root(top)
    if root is None:
        return None
    path = root.joinpath(*inner)
    return next((p for p in (path.with_suffix(".py"), path / "__init__.py") if p.is_file()), None)


@cache
def _root(top: str) -> Path | None:
    """Folder of a package."""
    loaded = sys.modules.get(top)
    spec = getattr(loaded, "__spec__", None) or PathFinder.find_spec(top)
    folders = getattr(spec, "submodule_search_locations", None)
    return Path(next(iter(folders))) if folders else None
