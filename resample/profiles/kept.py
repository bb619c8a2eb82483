"""What is made of a kernel or filter, once for all that are equal."""

from collections.abc import Callable
from functools import lru_cache, wraps
from typing import TypeVar

C = TypeVar("C")
R = TypeVar("R")


def once(make: Callable[[C], R]) -> Callable[[C], R]:
    """`make` whose results are kept for frozen dataclasses, which stay what they are.

    Tables of one kernel take longer than a small picture. Nobody writes into them.
    """
    kept = lru_cache(maxsize=32)(make)

    @wraps(make)
    def made(choice: C) -> R:
        parameters = getattr(type(choice), "__dataclass_params__", None)
        if parameters is None or not parameters.frozen:
            return make(choice)
        try:
            hash(choice)
        except TypeError:  # something in it may change
            return make(choice)
        return kept(choice)

    return made
