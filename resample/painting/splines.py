"""Compute the spline field of lattice samples, once per volume."""

from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.memory.mapped import array_like, most_of
from resample.types import BlockLevels, Bounds, Coefficients, Flags, SplineField

SHORT = (np.dtype(np.uint8), np.dtype(np.int8))  # types for which 16 bits suffice, see docs
AS_THEY_ARE = (*SHORT, *(np.dtype(name) for name in ("uint16", "int16", "float32")))
# Range of coefficients beyond the samples, in spans of these: usual and maximum. Along an axis they
# are at most three times as large.
LARGEST = 1e37  # data units; coefficients up to 27 times as large are still float32
MARGINS = (4.0, 13.5)
FIELD = "the field"
LEVELS, TINY = 255.0, 1e-300
PLANES = 16  # planes of blocks that are bounded together
# Per sample, temporary memory for the bounds of a picture, and where these are in a file.
BYTES_OF_BOUNDS, BYTES_BESIDE_BOUNDS = 0.3, 0.12


def spline_of(
    values: NDArray[np.generic], sharpness: float = 1.0, like: np.dtype[Any] | None = None
) -> tuple[SplineField, Bounds]:
    """Interpolating field of samples, and its bounds in bricks.

    `values`: (Z, Y, X) of any real type, all finite. `sharpness`: 1: interpolate the samples; 0:
    use them as coefficients, which smooths; in between it is a blend. Result: the field, in 16 bits
    for samples of 8, else in float32. For values in a file (`resample.memory.mapped`) the field is
    in a file too.
    """
    from resample.engine.jit import threads
    from resample.engine.rays.coefficients import BRICK, PAD, bundled, find_bounds

    given, base = _native(values)
    low, high = _range(given)
    span = high - low if high > low else 1.0
    shape = given.shape
    depth, height, width = (count + 2 * PAD for count in shape)
    is_short = (like or given.dtype) in SHORT
    kind = np.uint16 if is_short else np.float32
    flat = array_like(values, (depth * height * width,), kind, FIELD)
    with threads(_threads(shape, most_of(values))):
        scale, zero = _filled(given, low, span, sharpness, flat)
    zero += base
    deep, down, across = (-(-(count + 1) // BRICK) for count in shape)
    size = (deep, down, across)
    found = Bounds(*(array_like(values, size, np.float32, FIELD) for _ in Bounds._fields))
    find_bounds(bundled(flat), shape, found)
    bounds = Bounds(*(array_like(values, size, np.float64, FIELD) for _ in Bounds._fields))
    for bound, raw in zip(bounds, found, strict=True):
        for n, plane in enumerate(raw):
            bound[n] = zero + scale * plane.astype(np.float64)
    field = SplineField(flat, width, height * width, scale, zero, shape, base + low, base + high)
    return field, bounds


def levels_of(bound: NDArray[Any], shift: int, ends: tuple[float, float]) -> BlockLevels:
    """Upper bounds (z, y, x) of blocks of 2^`shift` cells a side, rounded up to 8 bits.

    `ends`: of the values, in data units.
    """
    leaf = array_like(bound, bound.shape, np.uint8, FIELD)
    for n, plane in enumerate(bound):
        leaf[n] = _levels(plane, ends)
    return _in_blocks(leaf, shift, ends)


def levels_of_samples(values: NDArray[Any], is_least: bool) -> BlockLevels:
    """Upper bounds of values between the samples around a place, in blocks of 2³ cells.

    `values`: (Z, Y, X). `is_least`: of negated values.
    """
    take: Any = np.minimum if is_least else np.maximum
    low, high = _range(values)
    ends = (-high, -low) if is_least else (low, high)
    size = tuple(count // 2 + 1 for count in values.shape)
    leaf = array_like(values, size, np.uint8, FIELD)
    for first in range(0, size[0], PLANES):
        part, last = values, min(first + PLANES, size[0])
        for axis, blocks in enumerate([(first, last), (0, size[1]), (0, size[2])]):
            # Block n has samples 2 n - 1 to 2 n + 1: sample n lies between cells n and n + 1.
            at = np.arange(2 * blocks[0] - 1, 2 * blocks[1]).clip(0, values.shape[axis] - 1)
            line = np.moveaxis(part.take(at, axis), axis, 0)
            part = np.moveaxis(take(take(line[:-2:2], line[1:-1:2]), line[2::2]), 0, axis)
        leaf[first:last] = _levels(-part.astype(float) if is_least else part, ends)
    return _in_blocks(leaf, 1, ends)


def _per_value(ends: tuple[float, float]) -> float:
    """Levels per data unit."""
    return LEVELS / max(ends[1] - ends[0], TINY)


def _levels(bound: NDArray[Any], ends: tuple[float, float]) -> Flags:
    """Round bounds up to levels."""
    level = np.ceil((bound - np.float64(ends[0])) * _per_value(ends))
    return np.clip(level, 0, LEVELS).astype(np.uint8)


def _in_blocks(leaf: Flags, shift: int, ends: tuple[float, float]) -> BlockLevels:
    """Bounds of small blocks, and of larger ones."""
    from resample.engine.rays.extremes import BLOCK

    block, side = leaf, 1 << (BLOCK - shift)
    for axis, count in enumerate(leaf.shape):
        block = np.maximum.reduceat(block, np.arange(0, count, side), axis)
    return BlockLevels(leaf, np.ascontiguousarray(block), shift, ends[0], _per_value(ends))


def bytes_of_field(
    shape: tuple[int, int, int], kind: np.dtype[Any], most: int | None = None
) -> int:
    """Bytes of a field of samples (Z, Y, X), and temporary bytes to compute it.

    `most`: budget of pages in memory for samples in a file; their other bytes do not count.
    """
    held = 2 if kind in SHORT else 4 if kind in AS_THEY_ARE else 8
    each = BYTES_OF_BOUNDS if most is None else BYTES_BESIDE_BOUNDS
    bounds = int(prod(shape) * each) + _threads(shape, most) * _bytes_of_slab(shape)
    return bounds if most is not None else bounds + prod(shape) * held


def _bytes_of_slab(shape: tuple[int, ...]) -> int:
    """Bytes of a thread that filters some planes."""
    from resample.engine.rays.coefficients import HALO, SLAB

    depth, height, width = shape
    return (min(depth, SLAB + 2 * HALO) + 1) * height * width * 4


def _threads(shape: tuple[int, ...], most: int | None) -> int:
    """Number of threads; for samples in a file limited so that their data fit into memory."""
    from resample.engine.jit import workers

    slabs = workers() if most is None else min(workers(), most // (4 * _bytes_of_slab(shape)))
    return max(1, slabs)


def _native(values: NDArray[np.generic]) -> tuple[NDArray[np.generic], float]:
    """Samples as kernels take them (contiguous, few types, read only), and the offset removed."""
    native, base = values.dtype.newbyteorder("="), 0.0
    if native.kind == "b":
        native = np.dtype(np.uint8)
    elif native not in AS_THEY_ARE:
        # Samples of other types, relative to the smallest one, and that offset.
        base = float(values.min())
        given = array_like(values, values.shape, np.float32, FIELD)
        with np.errstate(over="ignore"):
            for n, plane in enumerate(values):
                given[n] = plane.astype(np.float64) - base
        given.setflags(write=False)
        return given, base
    given = np.ascontiguousarray(values, native).view()
    given.setflags(write=False)
    return given, base


def _range(values: NDArray[np.generic]) -> tuple[float, float]:
    """Smallest and largest value."""
    low, high = float(values.min()), float(values.max())
    if not max(abs(low), abs(high)) < LARGEST:
        raise ValueError(
            f"values from {low:g} to {high:g}; a field's must be below {LARGEST:g} in size"
        )
    return low, high


def _filled(
    values: NDArray[Any], low: float, span: float, sharpness: float, flat: Coefficients
) -> tuple[float, float]:
    """Store coefficients; returns the scale and zero of the stored values."""
    from resample.engine.rays.coefficients import MOST, SLAB, Form, find_coefficients, values_of

    shape = values.shape
    given, cut = values_of(values), np.zeros(-(-shape[0] // SLAB), np.int64)
    if flat.dtype == np.float32:
        form = Form(low, np.float32(0.0), np.float32(1.0), np.float32(sharpness), False)
        find_coefficients(given, shape, form, flat, cut)
        return 1.0, low
    for margin in MARGINS:
        scale = (1.0 + 2.0 * margin) * span / float(MOST)
        zero = -margin * span
        form = Form(low, np.float32(zero), np.float32(1.0 / scale), np.float32(sharpness), True)
        find_coefficients(given, shape, form, flat, cut)
        if not cut.any():
            break
    return scale, low + zero
