"""Fingerprints of code that numba compiles: a kernel's function, and the names in it.

numba reads byte code and values, so these count: byte code without positions and docstrings, and
values of globals, of attributes of modules, of defaults and of free variables, as they are when it
compiles. A comment, a docstring, or a function that a kernel does not call changes no fingerprint.
"""

import dis
import hashlib
import sys
from collections.abc import Callable, Iterable
from functools import cache, partial
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np
from numba.core.typing.templates import builtin_registry

COMPILER = f"{__name__.rpartition('.')[0]}.compiling"  # an edit of it changes all machine code
FOREIGN = {*sys.stdlib_module_names, "numpy", "numba", "llvmlite"}  # known to numba by name
TAKES_CONSTANT = np.isin(np.arange(256), dis.hasconst)
STORE, EXTENDED, NOTHING = (dis.opmap[op] for op in ("STORE_NAME", "EXTENDED_ARG", "NOP"))
UNREAD = {"__doc__", "__firstlineno__"}  # what modules and classes store that no kernel reads
KIND = 0xFF  # flags of a code that tell what arguments it takes, and whether it is a generator


def made_from(called: Any, classes: Iterable[type]) -> tuple[str, list[str]]:
    """Fingerprint of a kernel's sources, and their names.

    `called`: the kernel, as kernels and Python call it. `classes`: of the bundles that it is called
    with. Names belong to functions, classes and constants, and to modules that
    count whole.
    """
    walk = _Walk()
    given = [called, *sorted(classes, key=_name)]
    told = [walk.whole(COMPILER), *(walk.text(each, "", ()) for each in given), *walk.described()]
    return hashlib.sha256(repr(told).encode()).hexdigest(), sorted(walk.parts)


class _Walk:
    """Texts of values; functions and classes are numbered as found, and described once."""

    def __init__(self) -> None:
        self.parts: set[str] = set()
        self._numbers: dict[Any, int] = {}  # of things, by their identity
        self._waiting: list[Callable[[], str]] = []  # what describes them, by number
        self._classes: set[type] = {object, type(None)}
        self._roles: list[dict[type, FunctionType]] = []  # bodies of each

    def described(self) -> list[str]:
        """Texts of everything found, and of the bodies that its classes play in roles."""
        told: list[str] = []
        played: list[str] = []
        while len(told) < len(self._waiting):
            told += [describe() for describe in self._waiting[len(told) :]]
            played = [
                f"{n} {_name(of)} {self._function(bodies[of])}"
                for n, bodies in enumerate(self._roles)
                for of in sorted(self._classes & bodies.keys(), key=_name)
            ]
        return told + played

    def whole(self, module: str) -> str:
        """Text of a module's source, without comments and docstrings."""
        self.parts.add(module)
        return f"{module} {_module_digest(module)}"

    def text(self, value: Any, label: str, names: tuple[str, ...]) -> str:
        """Text of a value named in code.

        `value`: what the name stands for. `label`: the name, with its module. `names`: those in the
        code that may be attributes of a module.
        """
        if hasattr(value, "__name__") and _is_foreign(_home(value)):
            return _name(value)
        if isinstance(value, ModuleType):
            told = partial(self._members, vars(value), value.__name__, names)
            return self._numbered((id(value), names), told)
        if isinstance(value, type):
            return self._numbered(id(value), partial(self._class, value))
        if isinstance(value, FunctionType) or hasattr(value, "__wrapped__"):
            return self._called(value)
        self.parts.add(label)
        match value:
            case np.ndarray() | np.generic():
                layout = (value.dtype.descr, value.shape, value.strides, value.flags.writeable)
                return f"{type(value)} {layout} {hashlib.sha256(value.tobytes()).hexdigest()}"
            case tuple():
                of = self.text(type(value), label, names)
                return f"{of}({', '.join(self.text(each, label, names) for each in value)})"
            case None | bool() | int() | float() | complex() | str() | bytes() | np.dtype():
                return f"{type(value)} {value!r}"
        modules = (label.rpartition(".")[0], type(value).__module__)
        return f"{type(value)} {[self.whole(each) for each in modules if not _is_foreign(each)]}"

    def _called(self, value: Any) -> str:
        """Text of a kernel, a role, an intrinsic, or a function with an overload of numba."""
        options = getattr(value, "options", getattr(value, "targetoptions", {}))
        flags = sorted(
            f"{key} {sorted(each) if isinstance(each, set) else each!s}"
            for key, each in options.items()
        )
        told = f"{_name(value)} {flags}"
        if hasattr(value, "bodies"):
            if value.bodies not in self._roles:
                self._roles.append(value.bodies)
            return f"{told} {self._roles.index(value.bodies)}"
        if hasattr(value, "__wrapped__"):
            return f"{told} {self._function(value.__wrapped__)}"
        overloads = [f"{self.whole(_home(o))} {self._function(o)}" for o in _overloads(value)]
        return f"{told} {self._function(value)} {overloads}"

    def _function(self, function: FunctionType) -> str:
        return self._numbered(id(function), partial(self._code, function))

    def _numbered(self, thing: Any, describe: Callable[[], str]) -> str:
        if thing not in self._numbers:
            self._numbers[thing] = len(self._waiting)
            self._waiting.append(describe)
        return f"#{self._numbers[thing]}"

    def _members(self, known: dict[str, Any], home: str, names: tuple[str, ...]) -> str:
        """Text of the objects that names stand for in a module, as far as they exist."""
        told = (f"{n} {self.text(known[n], f'{home}.{n}', names)}" for n in names if n in known)
        return f"{home}({', '.join(told)})"

    def _code(self, function: FunctionType) -> str:
        """Text of a function: its code, and the values of all names in it."""
        self.parts.add(_name(function))
        code, names = _read(function.__code__)
        told = [self._members(function.__globals__, _home(function), names)]
        own = [each.cell_contents for each in function.__closure__ or ()]
        own += [*(function.__defaults__ or ()), *(function.__kwdefaults__ or {}).values()]
        told += [self.text(each, _name(function), names) for each in own]
        return f"{_name(function)} {code} {told}"

    def _class(self, of: type) -> str:
        """Text of a class: the fields of a bundle, and the module of any other."""
        if not (issubclass(of, tuple) and hasattr(of, "_fields")):
            return f"{_name(of)} {self.whole(_home(of))}"
        self.parts.add(_name(of))
        self._classes.add(of)
        given = getattr(of, "_field_defaults", {})
        defaults = [self.text(each, _name(of), ()) for each in given.values()]
        return f"{_name(of)} {of._fields} {defaults}"


def _home(value: Any) -> str:
    """Name of a value's module, or of the value itself if it is a module."""
    if isinstance(value, ModuleType):
        return value.__name__
    return getattr(value, "__module__", None) or type(value).__module__


def _name(value: Any) -> str:
    return f"{_home(value)}.{getattr(value, '__qualname__', value.__name__)}"


def _is_foreign(module: str) -> bool:
    return module.partition(".")[0] in FOREIGN


def _overloads(function: FunctionType) -> list[FunctionType]:
    """Overloads that numba compiles in place of a function."""
    told = (types for value, types in builtin_registry.globals if value is function)
    templates = (each for types in told for each in getattr(types, "templates", ()))
    return [each._overload_func for each in templates if hasattr(each, "_overload_func")]


@cache
def _module_digest(name: str) -> str:
    """Fingerprint of a module's code, or of its file if its importer has no code."""
    module = sys.modules[name]
    find_code = getattr(module.__loader__, "get_code", None)
    code = find_code(name) if find_code is not None else None
    if code is not None:
        return _read(code)[0]
    return hashlib.sha256(Path(str(module.__file__)).read_bytes()).hexdigest()


@cache
def _read(code: CodeType) -> tuple[str, tuple[str, ...]]:
    """Fingerprint of a code without positions and docstrings, and all names in it.

    A constant is told where the code takes it, as a docstring moves the numbers of all others.
    """
    words = bytearray(code.co_code)  # two bytes each: an operation, and its argument
    if not UNREAD.isdisjoint(code.co_names):
        for n in range(2, len(words), 2):
            if words[n] == STORE and code.co_names[words[n + 1]] in UNREAD:
                words[n - 2 : n] = NOTHING, 0
    constants = []
    operations = np.frombuffer(code.co_code[::2], np.uint8)
    for n in (2 * np.flatnonzero(TAKES_CONSTANT[operations])).tolist():
        number, words[n + 1] = words[n + 1], 0
        if n and words[n - 2] == EXTENDED:
            number, words[n - 1] = number + (words[n - 1] << 8), 0
        constants.append(_constant(code.co_consts[number]))
    inner = [_read(each)[1] for each in code.co_consts if isinstance(each, CodeType)]
    names = tuple(dict.fromkeys(each for group in (code.co_names, *inner) for each in group))
    variables = (code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars)
    takes = (code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount)
    told = (words.hex(), constants, variables, takes, code.co_flags & KIND)
    return hashlib.sha256(repr((*told, code.co_exceptiontable)).encode()).hexdigest(), names


def _constant(value: Any) -> str:
    match value:
        case CodeType():
            return _read(value)[0]
        case tuple():
            return f"({', '.join(map(_constant, value))})"
        case frozenset():
            return f"{{{', '.join(sorted(map(_constant, value)))}}}"
    return repr(value)
