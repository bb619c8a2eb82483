"""What the fuzzer is to find, by seeds; in a module of its own, which a process loads at once."""

import time
from pathlib import Path

import numpy as np

FOUND = ("IndexError", "refused", "crash", "hang")  # by seed


def make():
    """What a seed is to do."""
    return lambda seed, folder: (_talk, _take_much, _crash, _hang)[seed](folder)


def _talk(_folder: Path):
    raise IndexError("\x1b[2J")


def _take_much(_folder: Path):
    return np.ones(1 << 33)


def _crash(_folder: Path):
    import ctypes

    ctypes.string_at(0)


def _hang(_folder: Path):
    time.sleep(6000)
