"""Cache of tables made from kernels and filters."""

from collections.abc import Callable
from functools import lru_cache, wraps
from typing import TypeVar

C = TypeVar("C")
R = TypeVar("R")


def once(make: Callable[[C], R]) -> Callable[[C], R]:
    """Memoize `make` for frozen dataclasses, which cannot change.

    Computing tables takes longer than painting a small picture. The results are read only.
    """
    kept = lru_cache(maxsize=32)(make)

    @wraps(make)
    def made(choice: C) -> R:
        parameters = getattr(type(choice), "__dataclass_params__", None)
        if parameters is None or not parameters.frozen:
            return make(choice)
        try:
            hash(choice)
        except TypeError:  # some field is not hashable
            return make(choice)
        return kept(choice)

    return made
