"""Link kernels that numba has compiled into one extension module.

numba stores optimised LLVM bitcode beside its machine code. From that, each kernel is compiled for
any processor of a level (`platforms`), with an entry point that takes its arguments as 8-byte
words; so no kernel is compiled twice by numba. The C compiler links it with the marshaller.
"""

import json
import pickle
import platform
import re
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding as llvm
import numpy as np
from llvmlite import ir
from numba.core import types
from numba.core.registry import cpu_target
from numba.np.numpy_support import as_dtype

from resample.engine.compiled import entries
from resample.engine.compiled.compiling import key_of
from resample.engine.compiled.library import dtype_name, sealed, source_digest
from tools.kernels import platforms
from tools.kernels.outlines import modules_of

HERE = Path(__file__).parent
FAILURES = re.compile(r'@"?\.const\.pickledata\.[^=]*= [^\n]*?c"((?:[^"\\]|\\.)*)"')
WORD = ir.IntType(64)
# Replaces an error whose text numba would build from numbers: shapes of arrays that do not fit.
UNKNOWN = "arrays of a kernel do not fit each other; RESAMPLE_KERNELS=off tells their shapes"
# Kernels that take 4 to 10 % longer without AVX-512 are included twice.
WIDE = (
    "resample.engine.shaped.painting.paint_shapes",
    "resample.engine.rays.painting.paint_rays",
)


class Part(NamedTuple):
    """A kernel specialisation in the library."""

    kernel: str  # module and name
    key: str  # types of the arguments
    sources: str  # fingerprint of its modules' files, and their names
    symbol: str  # name of its entry point
    wide: str  # the same for x86-64-v4, or NULL
    gives: str  # types of the results
    count: int  # number of words of the arguments
    failures: tuple[bytes, ...]  # exceptions that it may raise, as pickled by numba


def build(files: Iterable[Path], library: Path) -> list[Part]:
    """Link compiled kernels to an extension module.

    Parameters
    ----------
    files
        Kernels in the form of `resample.engine.compiled.entries`.
    library
        Path of the module.

    Raises
    ------
    ValueError
        A file does not hold a kernel, or the library does not support a kernel's types.
    OSError
        There is no C compiler.
    """
    with tempfile.TemporaryDirectory() as folder:
        with ProcessPoolExecutor() as pool:
            numbered = [(file, n, folder) for n, file in enumerate(sorted(files))]
            parts = list(pool.map(_emit, *zip(*numbered, strict=True)))
        parts.sort()
        (Path(folder) / "table.c").write_text(_table(parts))
        _link(Path(folder), library)
    return parts


def _emit(file: Path, number: int, folder: str) -> Part:
    """Write the object file of one kernel."""
    entry = entries.read(file)
    if entry is None:
        raise ValueError(f"{file} holds no kernel")
    made = pickle.loads(entry.payload)  # noqa: S301  the builder's own
    (_, _, (_, bitcode)), description = made[0], made[1]
    if entry.key != "".join(map(key_of, description.argtypes)) or "<" in entry.key:
        raise ValueError(f"{entry.kernel}: types of arguments without a name: {entry.key}")
    symbol = f"kernel_{number}"
    level, wide_level = platforms.level(), platforms.wide_level()
    if level is None:
        raise ValueError(f"no library is built for {sys.platform} on {platform.machine()}")
    module = _write_object(bitcode, description, Path(folder, f"{symbol}.o"), level)
    wide = "NULL"
    if wide_level and entry.kernel in WIDE:
        wide = f"{symbol}_wide"
        _write_object(bitcode, description, Path(folder, f"{wide}.o"), wide_level)
    modules = modules_of(entry.parts)
    sources = " ".join([source_digest(*modules), *modules])
    return Part(
        *(entry.kernel, entry.key, sources, symbol, wide),
        gives=_gives(description.restype),
        count=_trampoline(symbol, description)[1],
        failures=tuple(_bytes(found) for found in FAILURES.findall(str(module))),
    )


def _write_object(bitcode: bytes, description: Any, file: Path, level: platforms.Level) -> Any:
    """Compile a kernel for a processor level to an object file; returns the LLVM module."""
    symbol = file.stem
    module = llvm.parse_bitcode(bitcode)
    module.link_in(llvm.parse_assembly(_trampoline(symbol, description)[0]))
    for value in (*module.functions, *module.global_variables):
        if not value.is_declaration and value.name != symbol:
            value.linkage = "internal"
    target = llvm.Target.from_triple(llvm.get_process_triple())
    machine = target.create_target_machine(
        cpu=level.cpu, features=level.features, opt=3, reloc="pic", codemodel="default"
    )
    passes = llvm.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(module, llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(0)))
    file.write_bytes(machine.emit_object(module))
    return module


def _gives(given: types.Type) -> str:
    """Type of a result in the marshaller's notation."""
    match given:
        case types.NoneType():
            return "n"
        case types.Boolean():
            return "b"
        case types.Integer():
            return "q" if given.signed else "Q"
        case types.Float():
            return "d" if given == types.float64 else "f"
        case types.Array():
            return f"A{dtype_name(as_dtype(given.dtype))},{given.ndim};"
        case types.BaseNamedTuple():
            of = given.instance_class
            name = f"{of.__module__}.{of.__qualname__}"
        case types.BaseTuple():
            name = ""
        case _:
            raise ValueError(f"a kernel gives {given}, which the library cannot")
    return f"T{len(given.types)}:{name};{''.join(map(_gives, given.types))}"


def _trampoline(symbol: str, description: Any) -> tuple[str, int]:
    """LLVM code of an entry point, and the number of words of its arguments."""
    context = cpu_target.target_context
    convention = context.call_conv
    called = convention.get_function_type(description.restype, description.argtypes)
    module = ir.Module(symbol)
    module.triple = llvm.get_process_triple()
    body = ir.Function(module, called, description.llvm_func_name)
    pointer = WORD.as_pointer()
    entry = ir.Function(module, ir.FunctionType(ir.IntType(32), [pointer, pointer]), symbol)
    builder = ir.IRBuilder(entry.append_basic_block("entry"))
    given, result = entry.args
    arguments = [
        _from_word(builder, builder.load(builder.gep(given, [WORD(n)])), each)
        for n, each in enumerate(called.args[2:])
    ]
    places = []
    for to in called.args[:2]:  # result, and exception
        places.append(builder.alloca(to.pointee))
        builder.store(ir.Constant(to.pointee, None), places[-1])
    status = builder.call(body, [*places, *arguments])
    is_well = builder.or_(
        *(builder.icmp_signed("==", status, ir.Constant(status.type, n)) for n in (0, -2))
    )
    with builder.if_else(is_well) as (well, failed):
        with well:
            if description.restype != types.none:
                model = context.data_model_manager[description.restype]
                value = model.from_return(builder, builder.load(places[0]))
                _store(builder, description.restype, value, result, 0)
        with failed:
            raised = builder.load(places[1])
            builder.store(builder.ptrtoint(raised, WORD), result)
    builder.ret(status)
    return str(module), len(arguments)


def _from_word(builder: Any, word: Any, kind: Any) -> Any:
    """Convert an 8-byte word to the type in numba's calling convention."""
    match kind:
        case ir.PointerType():
            return builder.inttoptr(word, kind)
        case ir.DoubleType():
            return builder.bitcast(word, kind)
        case ir.FloatType():
            return builder.bitcast(builder.trunc(word, ir.IntType(32)), kind)
    return builder.trunc(word, kind) if kind.width < WORD.width else word


def _store(builder: Any, given: types.Type, value: Any, result: Any, at: int) -> int:
    """Store a result as 8-byte words; returns the position of the next one."""
    if isinstance(given, types.BaseTuple):
        for n, part in enumerate(given.types):
            at = _store(builder, part, builder.extract_value(value, n), result, at)
        return at
    words = [value]
    if isinstance(given, types.Array):
        words = [builder.extract_value(value, n) for n in range(5)]
        for of in (5, 6):  # shape, strides
            every = builder.extract_value(value, of)
            words += [builder.extract_value(every, axis) for axis in range(given.ndim)]
    for word in words:
        is_signed = getattr(given, "signed", False)
        builder.store(_to_word(builder, word, is_signed), builder.gep(result, [WORD(at)]))
        at += 1
    return at


def _to_word(builder: Any, value: Any, is_signed: bool) -> Any:
    match value.type:
        case ir.PointerType():
            return builder.ptrtoint(value, WORD)
        case ir.DoubleType():
            return builder.bitcast(value, WORD)
        case ir.FloatType():
            return builder.zext(builder.bitcast(value, ir.IntType(32)), WORD)
    if value.type.width == WORD.width:
        return value
    return (builder.sext if is_signed else builder.zext)(value, WORD)


def _bytes(text: str) -> bytes:
    r"""Bytes of an LLVM constant, in which \0A stands for one byte."""
    return re.sub(
        rb"\\([0-9A-Fa-f]{2})", lambda found: bytes([int(found[1], 16)]), text.encode("latin-1")
    )


def _table(parts: list[Part]) -> str:
    """C code of the tables of entry points and exceptions."""
    declared, rows = [], []
    for part in parts:
        texts = (part.kernel, part.key, part.sources, part.gives)
        symbols = (part.symbol, part.wide)
        declared += [
            f"int {each}(const int64_t *, int64_t *);" for each in symbols if each != "NULL"
        ]
        fields = (*map(json.dumps, texts), str(part.count), *symbols)
        rows.append(f"{{{', '.join(fields)}}},")
    raised = sorted({each for part in parts for each in part.failures})
    failures = [f"{{{', '.join(row)}}}," for row in map(_failure, raised) if row]
    return "\n".join(
        [
            '#include "entries.h"',
            *declared,
            "const Entry ENTRIES[] = {",
            *rows,
            "{0}};",
            f"const int ENTRY_COUNT = {len(parts)};",
            "const Failure FAILURES[] = {",
            *failures,
            "{0}};",
            f"const int FAILURE_COUNT = {len(failures)};\n",
        ]
    )


def _failure(pickled: bytes) -> Iterator[str]:
    """C fields of a kernel's exception; nothing if the pickle is not an exception."""
    try:
        of, arguments, *_ = pickle.loads(pickled)  # noqa: S301  the builder's own
    except Exception:  # a constant of another kind
        return
    if not (isinstance(of, type) and of.__module__ == "builtins"):
        return
    yield '"' + "".join(f"\\{byte:03o}" for byte in pickled) + '"'
    yield str(len(pickled))
    yield json.dumps(of.__name__)
    is_fixed = not any(isinstance(each, ir.Value) for each in arguments or ())
    yield json.dumps(str(arguments[0]) if arguments and is_fixed else UNKNOWN)


def _link(folder: Path, library: Path) -> None:
    include = ["-I", str(HERE), "-I", np.get_include(), "-I", sysconfig.get_path("include")]
    sources = [str(HERE / "marshal.c"), str(HERE / "runtime.c"), str(folder / "table.c")]
    objects = sorted(str(each) for each in folder.glob("*.o"))
    made = library.with_suffix(".new")
    command = [*platforms.compiler(), *include, *sources, *objects, *platforms.options()]
    subprocess.run([*command, "-o", str(made)], check=True)
    if sys.platform != "darwin":  # there the linker signs the file, and nothing may follow
        made.write_bytes(sealed(made.read_bytes()))
    made.replace(library)
