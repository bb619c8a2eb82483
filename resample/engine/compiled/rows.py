"""`bundles.loaded` and `store` for numba, generated as loads and stores of words."""

from collections.abc import Callable, Iterator
from typing import Any

from llvmlite import ir
from numba.core import types as numba_types
from numba.extending import intrinsic, overload

from resample.engine.compiled.compiling import OPTIONS, PART

types: Any = numba_types  # which has more in it than its stubs say
WORD = ir.IntType(64)
WITHIN = {**OPTIONS, **PART, "_nrt": False, "forceinline": True}  # as in `jit.inner_step`


def _words(context: Any, builder: Any, kind: Any, row: Any) -> Iterator[Any]:
    """Pointers to the words of a row, one after the other."""
    from numba.np.arrayobj import make_array  # 20 ms, for code that is kept in vain

    data = make_array(kind)(context, builder, row).data
    at = 0
    while True:
        yield builder.gep(data, [WORD(at)])
        at += 1


def _read(context: Any, builder: Any, kind: Any, words: Iterator[Any]) -> Any:
    """Value of a type, from the next words."""
    from numba.np.arrayobj import make_array, populate_array

    if isinstance(kind, types.BaseTuple):
        parts = [_read(context, builder, part, words) for part in kind.types]
        return context.make_tuple(builder, kind, parts)
    if isinstance(kind, types.Array):
        address = builder.load(next(words))
        shape = [builder.load(next(words)) for _ in range(kind.ndim)]
        size = context.get_abi_sizeof(context.get_data_type(kind.dtype))
        strides = [WORD(size)]
        for length in reversed(shape[1:]):
            strides.insert(0, builder.mul(strides[0], length))
        array = make_array(kind)(context, builder)
        data = builder.inttoptr(address, array.data.type)
        populate_array(array, data, shape, strides, WORD(size), None)
        return array._getvalue()
    if isinstance(kind, types.Float):
        own = context.get_value_type(kind)
        return builder.load(builder.bitcast(next(words), own.as_pointer()))
    return context.cast(builder, builder.load(next(words)), types.int64, kind)


def _write(context: Any, builder: Any, kind: Any, value: Any, words: Iterator[Any]) -> None:
    """Store a value of a type to the next words."""
    if isinstance(kind, types.BaseTuple):
        for n, part in enumerate(kind.types):
            _write(context, builder, part, builder.extract_value(value, n), words)
    elif isinstance(kind, types.Float):
        builder.store(value, builder.bitcast(next(words), value.type.as_pointer()))
    else:
        builder.store(context.cast(builder, value, kind, types.int64), next(words))


@intrinsic  # type: ignore[untyped-decorator]
def _loaded(_: Any, row: Any, like: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        words = _words(context, builder, signature.args[0], arguments[0])
        return _read(context, builder, signature.return_type, words)

    return like(row, like), generate


@intrinsic  # type: ignore[untyped-decorator]
def _store(_: Any, row: Any, value: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        words = _words(context, builder, signature.args[0], arguments[0])
        _write(context, builder, signature.args[1], arguments[1], words)
        return context.get_dummy_value()

    return types.void(row, value), generate


def define(loaded: Callable[..., Any], store: Callable[..., Any]) -> None:
    """Register the intrinsics as numba's implementations of two functions of bundles."""

    @overload(loaded, jit_options=WITHIN)
    def load(row, like):  # type: ignore[no-untyped-def]  # noqa: ARG001
        def compiled(row, like):  # type: ignore[no-untyped-def]
            return _loaded(row, like)

        return compiled

    @overload(store, jit_options=WITHIN)
    def keep(row, value):  # type: ignore[no-untyped-def]  # noqa: ARG001
        def compiled(row, value):  # type: ignore[no-untyped-def]
            _store(row, value)

        return compiled
