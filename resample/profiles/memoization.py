"""Cache of tables made from kernels, filters and interpolations."""

from collections.abc import Callable
from functools import lru_cache, wraps
from typing import Any, TypeVar

R = TypeVar("R")


def once(make: Callable[..., R]) -> Callable[..., R]:
    """Memoize a function of a frozen dataclass, which cannot change, and of other keys.

    Computing tables takes longer than painting a small picture. The results are read only. For
    other objects, such as those of plugins that are not hashable, it is called each time.
    """
    kept = lru_cache(maxsize=64)(make)

    @wraps(make)
    def made(choice: Any, *others: Any) -> R:
        parameters = getattr(type(choice), "__dataclass_params__", None)
        if parameters is None or not parameters.frozen:
            return make(choice, *others)
        try:
            hash(choice)
        except TypeError:  # some field is not hashable
            return make(choice, *others)
        return kept(choice, *others)

    return made
