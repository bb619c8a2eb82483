"""Calls of the kernels of `marshaller.c`, right and wrong: how many, and how many it answers."""

import contextlib
import gc
import importlib.util
import itertools
import sys
import threading
from importlib.machinery import ExtensionFileLoader

import numpy as np

from resample.engine.compiled import library
from tests.small_kernels import Pair

loader = ExtensionFileLoader("_kernels", sys.argv[1])
native = importlib.util.module_from_spec(importlib.util.spec_from_loader("_kernels", loader))
loader.exec_module(native)
native.set_dtype_name(library.dtype_name)


def found(name, names, defaults=()):
    kernel = native.find(f"tests.faults.kernels.{name}", names, defaults)
    for n in range({"four": 2, "made": 1, "pair": 1, "singles": 5}[name]):
        kernel.admit(n)
    return kernel


rng = np.random.default_rng(7)
wide, single = rng.random((6, 9)), rng.random((6, 9)).astype("f4")
readonly = single.copy()
readonly.flags.writeable = False


class Liar(tuple):
    __module__ = "tests.small_kernels"
    __qualname__ = "Pair"


class Nameless(tuple):
    __module__ = None


deep = ()
for _ in range(200_000):
    deep = (deep,)
record = np.zeros((2, 3), [("x", "f4"), ("at", "i8", 2)])
unaligned = np.frombuffer(bytes(4 * 54 + 1), "f4", offset=1).reshape(6, 9)
VALUES = [
    None,
    True,
    0,
    -1,
    1,
    2**31,
    2**63 - 1,
    2**63,
    -(2**63),
    10**400,
    0.5,
    float("nan"),
    1j,
    "text",
    b"bytes",
    object(),
    [],
    [1.0],
    {},
    (),
    (1, 2.0),
    ((((1,),),),),
    Pair(single, wide),
    Pair(1, 2),
    Pair(wide, single),
    Pair(single, None),
    Pair(Pair(single, wide), wide),
    Liar((single, wide)),
    Liar((single,)),
    Liar(()),
    Nameless((1,)),
    deep,
    (0,) * 5000,
    tuple([single] * 3000),
    single,
    single[::2, ::-1],
    single.T,
    np.asfortranarray(single),
    readonly,
    single[:0],
    single[:, :0],
    single[0],
    single[None],
    single[0, 0],
    np.float32(2),
    np.float16(2),
    np.longdouble(2),
    wide,
    single.astype(">f4"),
    single.astype("f2"),
    unaligned,
    record,
    record[0, 0],
    single.astype("M8[s]"),
    single.astype("S4"),
    single.astype(object),
    np.array(3.0, "f4"),
    np.ma.masked_array(single),
    single.view(np.matrix),
    np.broadcast_to(np.float32(1), (6, 9)),
    np.zeros((1,) * 64, "f4"),
    np.lib.stride_tricks.as_strided(single, (6, 9), (0, 0)),
    np.int8(-3),
    np.uint8(250),
    np.uint16(7),
    np.int64(5),
    np.uint64(2**63),
    np.bool_(True),
    np.datetime64("now"),
    np.str_("a"),
]
singles, four = found("singles", ("array",)), found("four", ("a", "b", "c", "d"))
pair, made = found("pair", ("pair", "factor")), found("made", ("count",))
results = []


def call(kernel, *args, **kwargs):
    try:
        results.append(kernel(args, kwargs))
    except (TypeError, ValueError, RuntimeError, MemoryError, OverflowError) as error:
        results.append(type(error))
    return results[-1]


for array in (single, single[::2, ::-1], np.asfortranarray(single), readonly, single[:0]):
    assert abs(call(singles, array) - array.sum(dtype=float)) < 1e-3
assert (
    abs(call(pair, Pair(single, wide[:, ::-2]), 2.0) - 2 * (single.sum() + wide[:, ::-2].sum()))
    < 1e-3
)
assert call(four, 7, 0.5, True, None)[0] == 7
assert call(made, 5).tolist() == [0, 1, 2, 3, 4]
assert call(made, -1) is RuntimeError
for value in VALUES:
    for kernel in (singles, made, four, pair):
        call(kernel, value)
        call(kernel, value, value)
        call(kernel, value, array=value, count=value)
        call(kernel, **{"pair": value, "factor": 1.0})
        call(kernel, Pair(value, value), 2.0)
        call(kernel, Pair(single, value), value)
        for ask in (kernel.match, kernel.key):
            with contextlib.suppress(RecursionError):
                ask((value,), {})
for values in itertools.islice(itertools.permutations(VALUES, 4), 0, None, 911):
    call(four, *values)
for kernel in (singles, four):
    call(kernel, *VALUES)
    call(kernel, **{str(n): value for n, value in enumerate(VALUES)})
    for wrong in ((), (1,), (1, 2), ((), None, 3), ([], {}), ((), 5), ((single,), [1])):
        with contextlib.suppress(TypeError, SystemError):
            kernel(*wrong)
    for place in (-1, 99, 2**70, "a", None, 0.5):
        with contextlib.suppress(IndexError, TypeError, OverflowError):
            kernel.admit(place)
for wrong in ((), ("a",), (1, (), ()), ("x", (), ()), ("x", [], ()), ("\0", (), ())):
    with contextlib.suppress(TypeError, ValueError):
        assert native.find(*wrong) is None
for default in (5, 0.5, "text" * 9000, None, deep):
    call(found("made", ("count",), (default,)))
    call(found("made", ("a", "count"), (default,) * 9), 1)
threads = [
    threading.Thread(target=lambda: [call(made, 1000) for _ in range(300)]) for _ in range(4)
]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
gc.collect()
answered = sum(isinstance(each, float | tuple | np.ndarray) for each in results)
sys.stdout.write(f"{len(results)} {answered}")
