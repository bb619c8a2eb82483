"""`octets.spread` for numba, generated as operations on vectors of eight doubles."""

from collections.abc import Callable
from typing import Any

import numba
from llvmlite import ir
from numba.extending import intrinsic, overload

MOST_TAPS = 8
EIGHT = ir.VectorType(ir.DoubleType(), 8)


def _all(builder: Any, number: Any) -> Any:
    """Broadcast a number to all eight lanes."""
    one = builder.insert_element(ir.Constant(EIGHT, ir.Undefined), number, ir.IntType(32)(0))
    return builder.shuffle_vector(
        one,
        ir.Constant(EIGHT, ir.Undefined),
        ir.Constant(ir.VectorType(ir.IntType(32), 8), [0] * 8),
    )


def _eight(builder: Any, data: Any, first: Any) -> Any:
    """Pointer to eight consecutive numbers of an array."""
    return builder.bitcast(builder.gep(data, [first]), EIGHT.as_pointer())


@intrinsic
def _spread(_, cells, layout, amount, line, rounding, weight, taps):  # type: ignore[no-untyped-def]  # noqa: ARG001
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        # Unpack the arrays to their data pointers, and load the eight amounts.
        cells, amount, weight = (
            context.make_array(signature.args[n])(context, builder, arguments[n]).data
            for n in (0, 2, 5)
        )
        line, rounding = arguments[3], _all(builder, arguments[4])
        first, pitch = (builder.extract_value(arguments[1], n) for n in range(2))
        across, down, step, taps = (builder.extract_value(arguments[6], n) for n in range(4))
        whole = first.type
        amounts = builder.load(_eight(builder, amount, line), align=8)

        def weights(begin: Any, count: int) -> list[Any]:
            # Broadcast the weights of `count` rows or columns.
            places = [builder.add(begin, builder.mul(step, whole(n))) for n in range(count)]
            return [_all(builder, builder.load(builder.gep(weight, [n]))) for n in places]

        def spread_over(count: int) -> None:
            # Emit the loops unrolled, with the arithmetic of `octets.spread`.
            columns = weights(across, count)
            for row, share in enumerate(weights(down, count)):
                shares = builder.fadd(builder.fmul(amounts, share), rounding)
                # Round to whole steps, so that all sums are exact.
                shares = builder.fsub(shares, rounding)
                begin = builder.add(first, builder.mul(pitch, whole(row)))
                for column, weighed in enumerate(columns):
                    cell = _eight(builder, cells, builder.add(begin, whole(8 * column)))
                    # A fused multiply-add gives the same bits, as products and sums are exact.
                    added = builder.fmul(shares, weighed, flags=["contract"])
                    total = builder.fadd(builder.load(cell, align=8), added, flags=["contract"])
                    builder.store(total, cell, align=8)

        # Emit one unrolled block per number of taps, and switch between them.
        end = builder.append_basic_block("spread")
        choice = builder.switch(taps, end)
        for count in range(1, MOST_TAPS + 1):
            block = builder.append_basic_block(f"taps{count}")
            choice.add_case(whole(count), block)
            with builder.goto_block(block):
                spread_over(count)
                builder.branch(end)
        builder.position_at_end(end)
        return context.get_dummy_value()

    # Signature of the intrinsic.
    whole, array, number = numba.int64, numba.float64[::1], numba.float64
    layout, taps = numba.types.UniTuple(whole, 2), numba.types.UniTuple(whole, 4)
    return numba.void(array, layout, array, whole, number, array, taps), generate


def define(spread: Callable[..., None]) -> None:
    """Register the intrinsic as numba's implementation of `spread`."""

    @overload(spread, inline="always")
    def vectors(cells, layout, amount, line, rounding, weight, taps):  # type: ignore[no-untyped-def]  # noqa: ARG001
        def compiled(cells, layout, amount, line, rounding, weight, taps):  # type: ignore[no-untyped-def]
            return _spread(cells, layout, amount, line, rounding, weight, taps)

        return compiled
