"""Interface to numba: the compiler's options, and the disk cache of machine code.

Imported by `resample.engine.jit` when a kernel has to be compiled, or was compiled before.
"""

import ctypes
import hashlib
import importlib.util
import io
import logging
import os
import pickle
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from pathlib import Path
from threading import Lock
from types import FunctionType
from typing import Any

import llvmlite
import numba
from llvmlite import binding, ir
from llvmlite.binding import ffi
from numba.core import cgutils, environment, sigutils
from numba.core import types as numba_types
from numba.core.caching import NullCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, CompileResult
from numba.core.compiler_lock import global_compiler_lock
from numba.core.intrinsics import INTR_MATH
from numba.core.registry import cpu_target
from numba.core.runtime import _nrt_python
from numba.core.serialize import dumps
from numba.extending import intrinsic, overload
from numba.np.numpy_support import as_dtype

from resample.engine.compiled import digests, library
from resample.engine.compiled.entries import FIRST, SUFFIX, Entry, read, write
from resample.reading.limits import check_own

try:
    import fcntl
except ImportError:  # Windows: every process compiles for itself
    fcntl = None  # type: ignore[assignment]

LOG = logging.getLogger("resample")
types: Any = numba_types  # which has more in it than its stubs say


def _leave_locks_untimed() -> None:
    """Disable numba's timing of each call of LLVM.

    A first picture takes 70,000 of them, and each is told to the timers of all kernels that wait
    for the one that is compiled: a tenth of all, for a number that nobody asks for.
    """
    lock = getattr(ffi.lib, "_lock", None)
    for begin, end in list(getattr(lock, "_cblist", ())):
        if begin.__module__ == numba.core.base.__name__:
            ffi.unregister_lock_callback(begin, end)


_leave_locks_untimed()


@cache
def _leave_algebra_unloaded() -> None:
    """Make numba assume SciPy's BLAS, instead of importing all of it for a check.

    That is a fifth of a second before any kernel runs. Code that calls BLAS still imports it.
    """
    from numba.np import linalg

    ensure = linalg.ensure_blas
    linalg.ensure_blas = _find_scipy
    try:
        importlib.import_module("numba.np.arraymath")
    finally:
        linalg.ensure_blas = ensure


def _find_scipy() -> None:
    if importlib.util.find_spec("scipy") is None:
        raise ImportError("scipy")


# Settings of numba's that change machine code; a trial of one must not stay in the cache.
SETTINGS = (
    "BOUNDSCHECK",
    "OPT",
    "LOOP_VECTORIZE",
    "SLP_VECTORIZE",
    "CPU_NAME",
    "CPU_FEATURES",
    "ENABLE_AVX",
    "DISABLE_INTEL_SVML",
    "USING_SVML",
    "LLVM_REFPRUNE_PASS",
    "LLVM_REFPRUNE_FLAGS",
    "DEBUGINFO_DEFAULT",
    "EXTEND_VARIABLE_LIFETIMES",
    "DEBUG_NRT",
    "NRT_STATS",
    "ENABLE_PROFILING",
)
_asked: list[int] = []  # what SLP_VECTORIZE was before a packed kernel set it for itself


def _settings() -> tuple[object, ...]:
    """The compiler's current settings."""
    values = {name: getattr(numba.config, name, None) for name in SETTINGS}
    if _asked:
        values["SLP_VECTORIZE"] = _asked[0]
    return tuple(values.items())


def key_of(given: Any) -> str:
    """Name of an argument's type, equal to `Kernel`'s name for a value.

    `given`: what numba takes the argument for. Names are ``q``, ``d``, ``b``, ``n`` for an int,
    a float, a bool and None; ``sf4`` for a number of NumPy; ``[f4,2,C]`` for an array (dtype,
    dimensions, layout; ``r`` after it: read-only); ``(module.Bundle;...)`` for a bundle and its
    parts, ``(;...)`` for a tuple; ``o`` and the default for an argument that is left out.
    """
    plain = {types.none: "n", types.boolean: "b", types.int64: "q", types.float64: "d"}
    if given in plain:
        return plain[given]
    match given:
        case types.Array():
            readonly = "" if given.mutable else "r"
            return f"[{_dtype(given.dtype)},{given.ndim},{given.layout}{readonly}]"
        case types.Omitted():
            return f"o{given.value!r};"
        case types.Integer() | types.Float():
            return "s" + _dtype(given)
        case types.BaseNamedTuple():
            of = given.instance_class
            return f"({of.__module__}.{of.__qualname__};{''.join(map(key_of, given.types))})"
        case types.BaseTuple():
            return f"(;{''.join(map(key_of, given.types))})"
    return f"<{given}>"  # the library knows none of these


def _dtype(given: Any) -> str:
    """Name of an array's dtype, as in `library.dtype_name`."""
    return library.dtype_name(as_dtype(given))


def _classes(given: Any) -> Iterator[type]:
    """Classes of all bundles in an argument."""
    if isinstance(given, types.BaseNamedTuple):
        yield given.instance_class
    for part in getattr(given, "types", ()):
        yield from _classes(part)


def folder() -> Path:
    """Folder of the kernel cache: NUMBA_CACHE_DIR, else in the user's cache.

    numba's own setting will not do: it may come from a file in the working folder.
    """
    asked = os.environ.get("NUMBA_CACHE_DIR")
    if asked:
        return Path(asked)
    from resample.memory import mapped

    return mapped.folder() / "kernels"


_reading = Lock()


class KernelCache(NullCache):  # type: ignore[misc]
    """Cache of one kernel's machine code, which numba reads before compiling and fills after.

    Settings of the compiler that were changed after a kernel was defined are a trial: nothing is
    taken from the disk then, and nothing stored.
    """

    def __init__(self, called: Any) -> None:
        self._called = called
        self._name = f"{called.__module__}.{called.__qualname__}"
        self._defined_with = called.settings
        self._began = 0.0  # the thread's time when the last was not found
        self._known: dict[Any, tuple[str, list[str]]] = {}  # fingerprints, by types of arguments

    @property
    def cache_path(self) -> str:
        """Folder of the files, for numba's statistics."""
        return str(folder())

    def path(self, signature: Any) -> Path | None:
        """File of the machine code for types of arguments.

        None if it is not kept: the kernel's source is in no file, or settings
        are on trial.
        """
        arguments = sigutils.normalize_signature(signature)[0]
        file = Path(self._called.__wrapped__.__code__.co_filename)
        if _settings() != self._defined_with or not file.is_file():
            return None
        digest = self._made_from(arguments)[0]
        codegen = cpu_target.target_context.codegen()
        parts = (digest, self._name, *arguments, self._defined_with, *codegen.magic_tuple())
        made_by = (FIRST, numba.__version__, llvmlite.__version__, sys.version_info[:2])
        name = hashlib.sha256(repr((parts, made_by)).encode()).hexdigest()[:40]
        return folder() / f"{self._name.rpartition('.')[2]}-{name}{SUFFIX}"

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        path = self.path(signature)
        entry = None if path is None else read(path)
        if path is None or entry is None:
            _get_ready()
            _say_that_it_takes_long()
            LOG.debug("compiling %s", self._name)
            self._began = time.thread_time()
            return None
        LOG.debug("%s: taken from %s", self._name, path)
        _note_use(path)
        for name, address in _nrt_python.c_helpers.items():  # what finished code calls
            binding.add_symbol(name if name.startswith("_") else f"NRT_{name}", address)
        payload = _Unpickler(io.BytesIO(entry.payload)).load()  # the user's own: `read` checks
        return CompileResult._rebuild(target_context, *payload)

    def save_overload(self, signature: Any, made: Any) -> None:
        path = self.path(signature)
        if path is None or made.library.has_dynamic_globals or made.lifted:
            return
        module = made.library._final_module
        named = (*module.functions, *module.global_variables)
        needed = {of.name for of in named if of.is_declaration}
        of_numba = {name for name in needed if name.startswith(("llvm.", "NRT_", "numba_"))}
        if not all(hasattr(ctypes.pythonapi, name) for name in needed - of_numba - INTR_MATH):
            # Modules of numba's functions tell LLVM of the rest, such as the secret in hashes of
            # texts. Code that uses it would kill a process that has not imported these modules.
            made.reload_init.append(_get_ready)
        key = "".join(map(key_of, made.signature.args))
        seconds = time.thread_time() - self._began
        parts = self._made_from(made.signature.args)[1]
        write(path, Entry(self._name, key, parts, seconds, dumps(made._reduce())))
        _note_use(path)

    def _made_from(self, arguments: Any) -> tuple[str, list[str]]:
        with _reading:  # threads that call a kernel at once read its code once
            if arguments not in self._known:
                classes = {of for each in arguments for of in _classes(each)}
                self._known[arguments] = digests.made_from(self._called, classes)
            return self._known[arguments]


class _Unpickler(pickle.Unpickler):
    """Reads machine code without its functions' modules, such as numba's."""

    def find_class(self, module: str, name: str) -> Any:
        return _environment if name == "_rebuild_env" else super().find_class(module, name)


def _environment(module: str, constants: list[object], name: str) -> environment.Environment:
    """Environment of a compiled function, reduced to constants."""
    known = environment.lookup_environment(name)
    if known is None:
        known = environment.Environment({"__name__": module})
        known.consts[:] = constants
        known.env_name = name
        environment.Environment._memo[name] = known
    return known


def _note_use(path: Path) -> None:
    """Append a kernel's file to RESAMPLE_KERNELS_LOG, if any."""
    if log := os.environ.get("RESAMPLE_KERNELS_LOG"):
        with Path(log).open("a") as lines:
            lines.write(f"{path}\n")


@contextmanager
def in_turn(path: Path) -> Iterator[None]:
    """Wait until no other process or thread compiles the kernel of a file."""
    lock_path = path.with_suffix(".lock")
    with ExitStack() as held:
        with suppress(OSError):  # a folder that has gone, a file system without locks: do not wait
            if fcntl is not None:
                path.parent.mkdir(0o755, parents=True, exist_ok=True)
                check_own(path.parent)
                lock = held.enter_context(lock_path.open("ab"))
                fcntl.flock(lock, fcntl.LOCK_EX)
                # To close the file is not enough: a forked process may hold it, too.
                held.callback(fcntl.flock, lock, fcntl.LOCK_UN)
        try:
            yield
        finally:
            with suppress(OSError):  # who comes later finds the kernel, so it needs no lock
                lock_path.unlink()


def _get_ready() -> None:
    """Load numba's parts for compiling, and declare the functions that kernels call.

    Machine code that is kept needs neither, which would take 0.2 s.
    """
    _leave_algebra_unloaded()
    while _overloads:
        _overloads.pop(0)()


@cache
def _say_that_it_takes_long() -> None:
    LOG.info("compiling kernels, once per installation: about 20 seconds")


def _keep(compiled: Any, called: Any) -> None:
    """Cache a kernel's machine code on disk; each file is compiled by one process at a time."""
    compiled._cache = kept = KernelCache(called)
    compile_now = compiled.compile

    def compile_in_turn(signature: Any) -> Any:
        path = kept.path(signature)
        if path is None or path.exists():
            return compile_now(signature)
        with in_turn(path):
            return compile_now(signature)

    compiled.compile = compile_in_turn


_packs = Lock()  # numba has one setting for all threads


def _pack(compiled: Any) -> None:
    """Let the compiler vectorize equal operations on neighbouring numbers."""
    compile_now = compiled.compile

    def compile_packed(signature: Any) -> Any:
        with _packs:
            before = numba.config.SLP_VECTORIZE
            _asked.append(before)
            numba.config.SLP_VECTORIZE = 1
            try:
                return compile_now(signature)
            finally:
                numba.config.SLP_VECTORIZE = before
                _asked.pop()

    compiled.compile = compile_packed


class _Part(JITCodeLibrary):  # type: ignore[misc]
    """Code of a kernel that is inlined into its callers, and is never run by itself.

    numba would compile it and everything that it calls, which nothing would use.
    """

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:  # noqa: ARG002
        return 0

    @property
    def codegen(self) -> "type[_Unheard]":
        return _Unheard


class _Unheard:
    """Stand-in for the execution engine, which inlined parts do not use."""

    @staticmethod
    def set_env(name: str, environment: Any) -> None:
        """Parts raise no exceptions, which would need an environment each."""


class PartCompiler(Compiler):  # type: ignore[misc]
    """numba's compiler for kernels that others call."""

    def compile_extra(self, function: Callable[..., Any]) -> Any:
        self.state.library = _Part(self.state.targetctx.codegen(), function.__qualname__)
        return super().compile_extra(function)


# error_model="numpy": a division by zero is inf or nan, as in NumPy, and costs no branch.
OPTIONS = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
PART = {"no_cpython_wrapper": True, "pipeline_class": PartCompiler}


_overloads: list[Callable[[], None]] = []  # that declare to numba the functions that kernels call


def define(
    called: Callable[..., Any], function: FunctionType, is_packed: bool, options: dict[str, Any]
) -> Any:
    """Return a kernel as a numba dispatcher.

    `called`: what kernels and Python call, by the kernel's name. `function`: its body. `is_packed`:
    whether equal operations on neighbouring numbers become one. `options`: further ones of numba's.
    """
    compiled = numba.njit(function, **OPTIONS, **options)
    _keep(compiled, called)
    if is_packed:
        _pack(compiled)
    return compiled


def define_part(called: Any, function: FunctionType, options: dict[str, Any]) -> None:
    """Declare to numba a kernel that other kernels call.

    It is compiled with them, without the code that unpacks Python's arguments and without its own
    machine code: both would take a fifth of the time.
    """
    called.settings = _settings()
    inner = {**OPTIONS, **options, **PART}
    tell = overload(called, jit_options=inner, strict=False)
    _overloads.append(lambda: tell(lambda *_: function))


def define_role(
    play: Callable[..., Any],
    bodies: dict[type, Callable[..., Any]],
    inline: str,
    options: dict[str, Any],
) -> None:
    """Declare a role to numba; the first argument's class chooses its body."""

    def chosen(*given: Any) -> Callable[..., Any] | None:
        first = given[0]
        of = type(None) if first == types.none else getattr(first, "instance_class", object)
        return bodies.get(of, bodies.get(object))

    inner = {**OPTIONS, **options, **PART}
    tell = overload(play, jit_options=inner, strict=False, inline=inline)
    _overloads.append(lambda: tell(chosen))


def _compile_nothing() -> None:
    """Wait until no thread compiles: a process forked meanwhile could never compile."""
    _packs.acquire()
    global_compiler_lock.acquire()


def _compile_again() -> None:
    global_compiler_lock.release()
    _packs.release()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(
        before=_compile_nothing, after_in_parent=_compile_again, after_in_child=_compile_again
    )


@intrinsic  # type: ignore[untyped-decorator]
def _add_one(_: Any, counter: Any) -> Any:
    """Add 1 atomically to the first number of an int64 array; return the old value."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        one = context.get_constant(numba.int64, 1)
        return builder.atomic_rmw("add", array.data, one, "monotonic")

    return numba.int64(counter), generate


@intrinsic  # type: ignore[untyped-decorator]
def _load_soon(_: Any, array: Any, index: Any) -> Any:
    """Prefetch the cache line of a number of a flat array."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        place = builder.bitcast(builder.gep(data, [arguments[1]]), ir.IntType(8).as_pointer())
        number = ir.IntType(32)
        of_types = ir.FunctionType(ir.VoidType(), [place.type, number, number, number])
        prefetch = cgutils.get_or_insert_function(builder.module, of_types, "llvm.prefetch.p0")
        builder.call(prefetch, [place, number(0), number(3), number(1)])  # to read, keep, data
        return context.get_dummy_value()

    return numba.void(array, index), generate


def define_instructions(next_task: Callable[..., int], load_soon: Callable[..., None]) -> None:
    """Declare to numba the engine's functions of one instruction each."""

    @overload(next_task)
    def add_one(counter):  # type: ignore[no-untyped-def]  # noqa: ARG001
        def compiled(counter):  # type: ignore[no-untyped-def]
            return _add_one(counter)

        return compiled

    @overload(load_soon)
    def prefetch(array, index):  # type: ignore[no-untyped-def]  # noqa: ARG001
        def compiled(array, index):  # type: ignore[no-untyped-def]
            _load_soon(array, index)

        return compiled
