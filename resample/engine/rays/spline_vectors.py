"""`splines.sums_at` and `ends_at` for numba, generated as operations on vectors of four numbers."""

from collections.abc import Callable, Sequence
from typing import Any

import numba
from llvmlite import ir
from numba.core import cgutils
from numba.extending import intrinsic, overload

from resample.engine.rays.weights import SAMPLES, SLOPES, WEIGHTS

SINGLE, SHORT, INDEX = ir.FloatType(), ir.IntType(16), ir.IntType(32)
FOUR = ir.VectorType(SINGLE, 4)
LANES = ("contract", "nsz")  # as in `resample.engine.jit`


class _Fours:
    """Emits operations on vectors of four numbers."""

    def __init__(self, builder: Any) -> None:
        self.builder = builder

    def shuffled(self, one: Any, two: Any, order: Sequence[int]) -> Any:
        """Pick lanes of two vectors; the second's begin at number 4."""
        lanes = ir.Constant(ir.VectorType(INDEX, 4), list(order))
        return self.builder.shuffle_vector(one, two, lanes)

    def constant(self, numbers: Sequence[float]) -> Any:
        return ir.Constant(FOUR, [ir.Constant(SINGLE, number) for number in numbers])

    def all(self, number: Any) -> Any:
        """Broadcast a number to all lanes."""
        one = self.builder.insert_element(ir.Constant(FOUR, ir.Undefined), number, INDEX(0))
        return self.shuffled(one, one, [0] * 4)

    def each(self, vector: Any) -> list[Any]:
        """Broadcast each number of a vector."""
        return [self.shuffled(vector, vector, [n] * 4) for n in range(4)]

    def plus(self, a: Any, b: Any) -> Any:
        return self.builder.fadd(a, b, flags=LANES)

    def times(self, a: Any, b: Any) -> Any:
        return self.builder.fmul(a, b, flags=LANES)

    def mixed(self, weights: Sequence[Any], parts: Sequence[Any]) -> Any:
        """Sum of weighted vectors."""
        total = self.times(weights[0], parts[0])
        for weight, part in zip(weights[1:], parts[1:], strict=True):
            total = self.plus(total, self.times(weight, part))
        return total

    def polynomial(self, rows: Sequence[Sequence[float]], number: Any) -> Any:
        """Polynomials of a number, by Horner's rule."""
        constants = [self.constant(row) for row in rows]
        total, factor = constants[-1], self.all(number)
        for constant in reversed(constants[:-1]):
            total = self.plus(self.times(total, factor), constant)
        return total

    def taps(self, kind: Any, data: Any, at: Any, row: Any, plane: Any) -> list[list[Any]]:
        """Load the four rows of four coefficients of each of four planes."""
        builder, planes = self.builder, []
        for _n in range(4):
            here, rows = at, []
            for _m in range(4):
                pointer = builder.gep(data, [here])
                pointer = builder.bitcast(pointer, ir.VectorType(kind, 4).as_pointer())
                four = builder.load(pointer, align=2 if kind == SHORT else 4)
                if kind == SHORT:
                    four = builder.sitofp(builder.zext(four, ir.VectorType(INDEX, 4)), FOUR)
                rows.append(four)
                here = builder.add(here, row)
            planes.append(rows)
            at = builder.add(at, plane)
        return planes

    def least(self, a: Any, b: Any) -> Any:
        """Smaller numbers of two vectors."""
        return self.builder.select(self.builder.fcmp_ordered("<", a, b), a, b)

    def sums(self, vectors: Sequence[Any]) -> Any:
        """Sums of four vectors each, in one vector: a transposition and three additions."""
        halves = []
        for a, b in (vectors[:2], vectors[2:]):
            low, high = self.shuffled(a, b, (0, 4, 1, 5)), self.shuffled(a, b, (2, 6, 3, 7))
            halves.append(self.plus(low, high))
        one, two = halves
        return self.plus(
            self.shuffled(one, two, (0, 1, 4, 5)), self.shuffled(one, two, (2, 3, 6, 7))
        )


def _sums_of(fours: _Fours, kind: Any, arguments: Sequence[Any]) -> Any:
    """Sum the coefficients of a cell, of one type: the value and its three derivatives."""
    planes, parts = fours.taps(kind, *arguments[:4]), arguments[4:]
    across, over, through = (fours.polynomial(WEIGHTS, part) for part in parts)
    right, down, deep = (fours.polynomial(SLOPES, part) for part in parts)
    # Sum the four rows of each plane along y, under weights and under their derivatives.
    level = [fours.mixed(fours.each(over), rows) for rows in planes]
    rise = [fours.mixed(fours.each(down), rows) for rows in planes]
    # Sum the planes along z, then along x: a derivative takes derived weights along its axis.
    value = fours.mixed(fours.each(through), level)
    along_y = fours.mixed(fours.each(through), rise)
    along_z = fours.mixed(fours.each(deep), level)
    pairs = ((across, value), (right, value), (across, along_y), (across, along_z))
    return fours.sums([fours.times(*pair) for pair in pairs])


def _ends_of(fours: _Fours, kind: Any, arguments: Sequence[Any]) -> Any:
    """Least of the eight samples around a cell, and the least of them negated, twice each."""
    weights = [fours.each(fours.constant(row)) for row in SAMPLES]

    def at_samples(vectors: Sequence[Any]) -> list[Any]:
        # Three coefficients have weight at the first sample, and the last three at the second.
        pairs = ((weights[0][:3], vectors[:3]), (weights[1][1:], vectors[1:]))
        return [fours.mixed(*pair) for pair in pairs]

    planes = [at_samples(rows) for rows in fours.taps(kind, *arguments[:4])]
    lines = [line for one in zip(*planes, strict=True) for line in at_samples(one)]
    before, behind = (
        fours.sums([fours.times(fours.constant(row), line) for line in lines]) for row in SAMPLES
    )
    none = fours.constant((0.0,) * 4)
    least = fours.least(before, behind)
    most = fours.least(*(fours.builder.fsub(none, one) for one in (before, behind)))
    # Fold the four lanes of both into one vector.
    half = fours.least(
        fours.shuffled(least, most, (0, 1, 4, 5)), fours.shuffled(least, most, (2, 3, 6, 7))
    )
    return fours.least(
        fours.shuffled(half, half, (0, 2, 0, 2)), fours.shuffled(half, half, (1, 3, 1, 3))
    )


def _function(module: Any, kind: Any, body: Callable[..., Any]) -> Any:
    """Function of a module for coefficients of one type; made at its first call."""
    name = f"spline{body.__name__}_{kind}"
    if name in module.globals:
        return module.globals[name]
    whole = ir.IntType(64)
    given = [kind.as_pointer(), whole, whole, whole, SINGLE, SINGLE, SINGLE]
    function = ir.Function(module, ir.FunctionType(FOUR, given), name)
    function.linkage = "linkonce_odr"
    function.attributes.add("noinline")
    builder = ir.IRBuilder(function.append_basic_block())
    builder.ret(body(_Fours(builder), kind, function.args))
    return function


def _calling(body: Callable[..., Any]) -> Callable[..., Any]:
    """Code that calls the function of the type that coefficients have."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        row, plane = (builder.extract_value(arguments[1], n) for n in range(2))
        i, j, k = (builder.extract_value(arguments[2], n) for n in range(3))
        first = builder.add(builder.mul(k, plane), builder.add(builder.mul(j, row), i))
        given = [first, row, plane, *(builder.extract_value(arguments[3], n) for n in range(3))]
        arrays = [
            context.make_array(kind)(context, builder, builder.extract_value(arguments[0], n))
            for n, kind in enumerate(signature.args[0].types)
        ]
        # One of the arrays holds coefficients.
        is_short = builder.icmp_signed(">", arrays[0].nitems, arrays[0].nitems.type(0))
        total = cgutils.alloca_once(builder, FOUR)
        with builder.if_else(is_short) as branches:
            for branch, kind, array in zip(branches, (SHORT, SINGLE), arrays, strict=True):
                with branch:
                    called = _function(builder.module, kind, body)
                    builder.store(builder.call(called, [array.data, *given]), total)
        found = builder.load(total)
        numbers = [builder.extract_element(found, INDEX(n)) for n in range(4)]
        return context.make_tuple(builder, signature.return_type, numbers)

    return generate


FOUR_NUMBERS = numba.types.UniTuple(numba.float32, 4)


@intrinsic
def _sums(_, coefficient, strides, cell, fraction):  # type: ignore[no-untyped-def]
    return FOUR_NUMBERS(coefficient, strides, cell, fraction), _calling(_sums_of)


@intrinsic
def _ends(_, coefficient, strides, cell, fraction):  # type: ignore[no-untyped-def]
    return FOUR_NUMBERS(coefficient, strides, cell, fraction), _calling(_ends_of)


def define(sums_at: Callable[..., Any], ends_at: Callable[..., Any]) -> None:
    """Register the intrinsics as numba's implementations of two functions of splines."""

    @overload(sums_at, inline="always")
    def sums(coefficient, strides, cell, fraction):  # type: ignore[no-untyped-def]  # noqa: ARG001
        def compiled(coefficient, strides, cell, fraction):  # type: ignore[no-untyped-def]
            return _sums(coefficient, strides, cell, fraction)

        return compiled

    @overload(ends_at, inline="always")
    def ends(coefficient, strides, cell, fraction):  # type: ignore[no-untyped-def]  # noqa: ARG001
        def compiled(coefficient, strides, cell, fraction):  # type: ignore[no-untyped-def]
            return _ends(coefficient, strides, cell, fraction)

        return compiled
