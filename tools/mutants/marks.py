"""Marks in functions, which record what each case of the tests runs through.

`python -m pytest -p tools.mutants.marks` writes a line for each case to a file of the folder that
MUTANTS_MARKS names: the case, its CPU seconds, whether it passed, and the marks that it met. Marks
are put in while modules are imported; files stay as they are. Kernels have none, as they are
compiled; of those that Python calls, the names are recorded.
"""

import ast
import atexit
import builtins
import json
import os
import re
from collections.abc import Callable, Iterator
from functools import wraps
from importlib.machinery import SourceFileLoader
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
SOURCES = ("resample", "apps", "plugins")
FOLDER = "MUTANTS_MARKS"  # variable
KERNEL = re.compile(r"(\w*kernel|\w*_step|\w*role|plays|overload|intrinsic)\b")
met: set[str] = set()
_load = SourceFileLoader.get_code


def blocks(tree: ast.Module) -> Iterator[tuple[str, list[ast.stmt]]]:
    """Bodies of all functions, and of what they repeat or run on a condition.

    A block's name is the function's and a number, which is 0 for the whole body.
    """
    yield from _blocks(tree, "", None)


def _blocks(node: ast.AST, prefix: str, inside: Iterator[str] | None) -> Iterator[tuple[str, Any]]:
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef):
            names = (f"{prefix}{child.name}:{n}" for n in range(1 << 20))
            yield next(names), child.body
            yield from _blocks(child, f"{prefix}{child.name}.", names)
        elif isinstance(child, ast.ClassDef):
            yield from _blocks(child, f"{prefix}{child.name}.", None)
        else:
            if inside and isinstance(
                child, ast.If | ast.For | ast.While | ast.ExceptHandler | ast.match_case
            ):
                yield next(inside), child.body
                if getattr(child, "orelse", None) and not _is_elif(child):
                    yield next(inside), child.orelse
            yield from _blocks(child, prefix, inside)


def _is_elif(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and len(node.orelse) == 1 and isinstance(node.orelse[0], ast.If)


def is_kernel(node: ast.AST) -> bool:
    """Whether a function has the decorator of a kernel, or of what becomes part of kernels."""
    return any(KERNEL.match(ast.unparse(each)) for each in getattr(node, "decorator_list", ()))


def _marked(tree: ast.Module, file: str) -> ast.Module:
    """A module with a call at the beginning of each block outside kernels."""
    kernels = (node for node in ast.walk(tree) if is_kernel(node))
    compiled = {
        id(getattr(part, field, None))
        for kernel in kernels
        for part in ast.walk(kernel)
        for field in ("body", "orelse")
    }
    for name, body in list(blocks(tree)):
        if id(body) in compiled:
            continue
        first = body[0]
        is_text = isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant)
        call = ast.Call(ast.Name("__met__", ast.Load()), [ast.Constant(f"{file}:{name}")], [])
        mark = ast.copy_location(ast.Expr(call), first)
        body.insert(1 if is_text else 0, ast.fix_missing_locations(mark))
    if file == "resample/engine/compiled/library.py":
        tree.body += ast.parse("kernel = __noting__(kernel)").body
    return tree


def _noting(kernel: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Record names of kernels that Python calls; `kernel` looks for one in the library."""

    @wraps(kernel)
    def kernel_that_tells(function: Any) -> Any:
        ready = kernel(function)
        mark = f"{function.__module__}:{function.__qualname__}"

        def call(args: Any, kwargs: Any) -> Any:
            met.add(mark)
            return NotImplemented if ready is None else ready(args, kwargs)

        return call

    return kernel_that_tells


def _get_code(loader: SourceFileLoader, name: str) -> Any:
    path = Path(loader.get_filename(name))
    if not path.is_relative_to(ROOT) or path.relative_to(ROOT).parts[0] not in SOURCES:
        return _load(loader, name)
    tree = ast.parse(loader.get_data(str(path)))
    marked = _marked(tree, path.relative_to(ROOT).as_posix())
    return compile(marked, str(path), "exec", dont_inherit=True)


def _write(case: str, seconds: float, outcome: str, marks: set[str]) -> None:
    line = json.dumps([case, round(seconds, 3), outcome, sorted(marks)])
    with Path(os.environ[FOLDER], f"{os.getpid()}.jsonl").open("a") as file:
        file.write(f"{line}\n")


def _spent() -> float:
    """CPU seconds of this process and of those that it has waited for."""
    return sum(os.times()[:4])


class Recorder:
    """Plugin of pytest: what each case meets, with what its fixtures met when they were made."""

    def __init__(self) -> None:
        self.outcome = ""
        self.fixtures: dict[object, set[str]] = {}

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.when == "call" or not report.passed:
            self.outcome = report.outcome

    def pytest_fixture_setup(self, fixturedef: Any) -> Iterator[None]:
        before = set(met)
        met.clear()
        result = yield
        self.fixtures[fixturedef] = set(met)
        met.update(before)
        return result

    def pytest_runtest_protocol(self, item: Any) -> Iterator[None]:
        met.clear()
        self.outcome, begin = "", _spent()
        result = yield
        for known in item._fixtureinfo.name2fixturedefs.values():
            for each in known:
                met.update(self.fixtures.get(each, ()))
        _write(item.nodeid, _spent() - begin, self.outcome, met)
        return result


def pytest_configure(config: Any) -> None:
    """Add the recorder to the plugins of pytest."""
    import pytest

    for name in ("pytest_fixture_setup", "pytest_runtest_protocol"):
        setattr(Recorder, name, pytest.hookimpl(wrapper=True)(getattr(Recorder, name)))
    config.pluginmanager.register(Recorder())


if FOLDER in os.environ:
    builtins.__met__ = met.add  # type: ignore[attr-defined]
    builtins.__noting__ = _noting  # type: ignore[attr-defined]
    SourceFileLoader.get_code = _get_code  # type: ignore[method-assign]
    if "PYTEST_CURRENT_TEST" in os.environ:  # a process that a case has started
        _case = os.environ["PYTEST_CURRENT_TEST"].rpartition(" (")[0]
        atexit.register(lambda: _write(_case, 0.0, "", met))
