"""Noise from hashed integers, identical on every machine."""

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles


def mixed(x: NDArray[np.int64], y: NDArray[np.int64], seed: int = 0) -> Doubles:
    """Pseudo-random number from 0 to 1 for every pair of integers."""
    state = x.astype(np.uint32) * np.uint32(0x9E3779B1) + y.astype(np.uint32) * np.uint32(
        0x85EBCA77
    )
    state = state + np.uint32(seed * 0x27D4EB2F & 0xFFFFFFFF)
    for shift, factor in ((15, 0x2C1B3C6D), (12, 0x297A2D39), (15, 0x1)):
        state = (state ^ (state >> np.uint32(shift))) * np.uint32(factor)
    return np.asarray(state / np.float64(2**32))


def smooth(x: Doubles, y: Doubles, seed: int = 0) -> Doubles:
    """Smooth noise from 0 to 1 with features about 1 wide."""
    left, top = np.floor(x), np.floor(y)
    across, down = x - left, y - top
    across, down = across * across * (3 - 2 * across), down * down * (3 - 2 * down)
    column, row = left.astype(np.int64), top.astype(np.int64)
    upper = mixed(column, row, seed) * (1 - across) + mixed(column + 1, row, seed) * across
    lower = mixed(column, row + 1, seed) * (1 - across) + mixed(column + 1, row + 1, seed) * across
    return np.asarray(upper * (1 - down) + lower * down)


def rough(x: Doubles, y: Doubles, octaves: int = 4, seed: int = 0) -> Doubles:
    """Sum of noise at several octaves, from 0 to 1."""
    total = sum(smooth(x * 2**n, y * 2**n, seed + n) / 2**n for n in range(octaves))
    return np.asarray(total / (2 - 2 ** (1 - octaves)))


def grain(height: int, width: int, seed: int = 0) -> Doubles:
    """White noise (height, width) from 0 to 1."""
    rows, columns = np.mgrid[:height, :width]
    return mixed(columns, rows, seed)
