"""What is found of a volume's values is found once, where a scene keeps it, or the values do."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

Kept = dict[tuple[Any, ...], Any]  # by what was asked for, and of which values

_kept: ContextVar[Kept | None] = ContextVar("kept", default=None)


@contextmanager
def keeping(kept: Kept) -> Iterator[None]:
    """Let what is found here be kept, and what was found before be used.

    Values must neither change nor go away as long as something of them is kept.
    """
    token = _kept.set(kept)
    try:
        yield
    finally:
        _kept.reset(token)


def found_once(of: Callable[[Any], Any]) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorate what depends on values and numbers alone.

    Parameters
    ----------
    of
        Gives the array of values of the first argument; all others are numbers and names. What
        has an attribute `found` keeps what is found there.
    """

    def decorated(find: Callable[P, R]) -> Callable[P, R]:
        @wraps(find)
        def found(*args: P.args, **kwargs: P.kwargs) -> R:
            first, *others = args
            kept = getattr(of(first), "found", _kept.get())
            if kept is None:
                return find(*args, **kwargs)
            key = (find, id(of(first)), *others, *sorted(kwargs.items()))
            if key not in kept:
                kept[key] = find(*args, **kwargs)
            result: R = kept[key]
            return result

        return found

    return decorated
