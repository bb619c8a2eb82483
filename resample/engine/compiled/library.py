"""Kernels that were compiled ahead, in a shared library beside this file.

`make kernels` builds it, and wheels have it. It holds machine code for a level of processors
(x86-64-v3; any 64-bit one of ARM's), and a marshaller in C that finds the code for the types of a
call's arguments. A kernel of it is used if the sources are those that it was compiled from, the
processor has what it needs, and no numba setting asks for other code; else numba compiles, as
it does without a library. RESAMPLE_KERNELS=off ignores the library.
"""

import hashlib
import logging
import os
import sys
import zlib
from collections.abc import Callable
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

LOG = logging.getLogger("resample")
VARIABLE = "RESAMPLE_KERNELS"
MODULE = "resample.engine.compiled._kernels"
SEAL = b"resample crc32 "  # before the checksum that the library's file ends with, 4 bytes
# Variables of numba's that ask for other machine code than the library's.
OTHER_CODE = (
    "BOUNDSCHECK",
    "CPU_FEATURES",
    "CPU_NAME",
    "DISABLE_JIT",
    "ENABLE_AVX",
    "ENABLE_PROFILING",
    "LOOP_VECTORIZE",
    "OPT",
    "SLP_VECTORIZE",
)

Call = Callable[[tuple[Any, ...], dict[str, Any]], Any]


def dtype_name(dtype: DTypeLike) -> str:
    """Name of an array's dtype: ``f4``, or names, types and places of fields.

    Examples
    --------
    >>> from resample.engine.compiled.library import dtype_name
    >>> dtype_name("u2"), dtype_name([("x", "f4"), ("y", "i8", 2)])
    ('u2', '{x:f4@0,y:i8(2,)@4;20}')
    """
    given = np.dtype(dtype)
    if given.fields is None:
        return given.str[1:] if given.isnative else given.str
    parts = []
    for name, field in given.fields.items():
        of, shape = field[0].base, field[0].shape
        parts.append(f"{name}:{dtype_name(of)}{shape or ''}@{field[1]}".replace(" ", ""))
    return f"{{{','.join(parts)};{given.itemsize}}}"


def kernel(function: Callable[..., Any]) -> Call | None:
    """A kernel of the library; call it with a tuple and a dict of arguments.

    The call gives `NotImplemented` if the library has no code for their types. None if the library
    has no code of the kernel at all, or is not used.
    """
    native = _native()
    if native is None or not isinstance(function, FunctionType):
        return None
    name = f"{function.__module__}.{function.__qualname__}"
    code = function.__code__
    names = code.co_varnames[: code.co_argcount]
    found = native.find(name, names, function.__defaults__ or ())
    if found is None:
        return None

    stale: set[int] = set()  # positions of entries of other sources

    def call(args: tuple[Any, ...], kwargs: dict[str, Any]) -> Any:
        result = found(args, kwargs)
        if result is NotImplemented and _admits(found, stale, function, args, kwargs):
            result = found(args, kwargs)
        return result

    return call


def is_there() -> bool:
    """Whether a library exists and is used."""
    return _native() is not None


def _admits(found: Any, stale: set[int], function: FunctionType, args: Any, kwargs: Any) -> bool:
    """Whether the library has code for a first call, from the current sources."""
    name = f"{function.__module__}.{function.__qualname__}"
    match = found.match(args, kwargs)
    if match is None:
        _say_that_it_is_missing(name, "these types of arguments")
        return False
    position, sources = match
    if position in stale:
        return False
    made_from, *modules = sources.split()
    if source_digest(*modules) != made_from:
        _say_that_it_is_missing(name, "the sources as they are now")
        stale.add(position)
        return False
    found.admit(position)
    return True


def source_digest(*modules: str) -> str:
    """Fingerprint of the files of modules; missing files have their own fingerprint."""
    return hashlib.sha256("".join(map(_file_digest, modules)).encode()).hexdigest()


@cache
def _file_digest(module: str) -> str:
    try:
        return hashlib.sha256(Path(str(find_spec(module).origin)).read_bytes()).hexdigest()  # type: ignore[union-attr]
    except (AttributeError, ImportError, OSError):
        return f"no file of {module}"


@cache
def _say_that_it_is_missing(name: str, what: str) -> None:
    LOG.info("%s is not in the library of kernels for %s: numba compiles it", name, what)


@cache
def _native() -> ModuleType | None:
    """The shared library, if it exists and is enabled."""
    asked = os.environ.get(VARIABLE, "on")
    if asked not in {"on", "off"}:
        raise ValueError(f"{VARIABLE} is {asked!r}: on or off")
    if asked == "off" or any(os.environ.get(f"NUMBA_{name}") for name in OTHER_CODE):
        return None
    try:
        if (found := find_spec(MODULE)) is None or found.origin is None:
            return None
        if not is_whole(Path(found.origin).read_bytes()):
            LOG.warning(
                "the library of kernels is damaged, so numba compiles them; install this package "
                "again: %s",
                found.origin,
            )
            return None
        _kernels = import_module(MODULE)
    except (ImportError, OSError) as error:
        LOG.debug("no library of kernels: %s", error)
        return None
    missing = lacking(_kernels)
    if missing:
        LOG.info("the processor lacks %s: numba compiles all kernels", ", ".join(missing))
        return None
    _kernels.set_dtype_name(dtype_name)
    return _kernels


def sealed(file: bytes) -> bytes:
    """Content of a library's file with its checksum at the end, which loaders ignore."""
    return file + _seal(memoryview(file))


def is_whole(file: bytes) -> bool:
    """Whether the content of a library's file is unchanged since `sealed`.

    macOS checks the signature that its linker has written at the end, after which nothing may be.
    """
    if sys.platform == "darwin":
        return True
    end = max(0, len(file) - len(SEAL) - 4)
    return file[end:] == _seal(memoryview(file)[:end])


def _seal(content: memoryview) -> bytes:
    return SEAL + zlib.crc32(content).to_bytes(4, "little")


def lacking(native: ModuleType) -> tuple[str, ...]:
    """Processor features that the library needs and that are missing."""
    return tuple(native.lacking())
