"""Pictures compared bit by bit, and made on one thread and on two."""

import numpy as np

from resample.engine.jit import threads

ARRAYS = ("rgba", "depth", "first_depth", "coverage")


def assert_same(first, second, names=ARRAYS):
    """Refuse frames that differ in a bit."""
    for name in names:
        one, two = getattr(first, name), getattr(second, name)
        are_same = np.asarray(one).tobytes() == np.asarray(two).tobytes()
        assert are_same, f"{name} differs by {np.nanmax(abs(one - two))}"


def assert_threads_change_nothing(draw):
    """Refuse a call whose arrays on one thread differ in a number from those on two."""
    pictures = []
    for count in (1, 2):
        with threads(count):
            pictures.append(draw())
    for one, two in zip(*pictures, strict=True):
        np.testing.assert_array_equal(one, two)
