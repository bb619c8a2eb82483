"""Texts that tell whether two values say the same, in this process or in another."""

from collections.abc import Callable, Iterator, Sequence, Set
from hashlib import sha256
from types import BuiltinFunctionType, FunctionType, ModuleType, NoneType
from typing import Any

import numpy as np

PLAIN = (type(None), bool, int, float, complex, str, bytes)


class _UnknownError(ValueError):
    """What a value says cannot be told."""


def fingerprint(value: Any, place_of: Callable[[Any], object | None] | None = None) -> str | None:
    """Text that values share only where they say the same; None: that cannot be told.

    Parameters
    ----------
    value
        Numbers, texts, arrays, functions of modules, and whatever is made of such: sequences,
        sets, mappings, dataclasses, objects that can be copied.
    place_of
        What stands for a part of it, such as its place in memory; None: the part says it all.

    Examples
    --------
    >>> fingerprint({"size": (2, 3)}) == fingerprint({"size": (2, 3)}) != fingerprint({"size": 2})
    True
    >>> fingerprint(lambda: 2) is None
    True
    """
    digest = sha256()
    try:
        for word in _words(value, place_of or (lambda _: None)):
            digest.update(b"%d:" % len(word) + word)
    except (ValueError, TypeError, AttributeError, RecursionError):
        return None
    return digest.hexdigest()


def _words(value: Any, place_of: Callable[[Any], object | None]) -> Iterator[bytes]:
    """What a value consists of, each part after what it is."""
    place = place_of(value)
    kind = type(value)
    if place is not None:
        yield f"at {place}".encode()
    elif kind in PLAIN:
        yield f"{kind.__name__} {value!r}".encode()
    elif isinstance(value, type | FunctionType | BuiltinFunctionType):
        yield _named(value)
    elif isinstance(value, np.ndarray):
        if value.dtype.hasobject:
            raise _UnknownError("objects in an array")
        yield f"array {value.dtype.descr} {value.shape}".encode()
        yield np.ascontiguousarray(value).tobytes()
    else:
        yield _named(kind)
        parts = _parts(value, place_of)
        yield b"%d" % len(parts)
        for part in parts:
            yield from _words(part, place_of)


def _parts(value: Any, place_of: Callable[[Any], object | None]) -> Sequence[Any]:
    """What a compound value is made of."""
    if isinstance(value, tuple | list):
        return value
    if isinstance(value, Set):  # in any order
        names = [fingerprint(part, place_of) for part in value]
        if None in names:
            raise _UnknownError("a part of a set")
        return sorted(str(name) for name in names)
    made: Any = value.__reduce_ex__(2)
    if isinstance(made, str):
        return (made,)
    function, arguments, *more = made  # these are its state, items of a list and of a mapping
    return [function, arguments, *more[:1], *(list(items or ()) for items in more[1:])]


def _named(value: Any) -> bytes:
    """The name by which a module has a class or function."""
    name: str = value.__qualname__
    has_owner = isinstance(value, BuiltinFunctionType) and not isinstance(
        value.__self__, ModuleType | NoneType
    )
    if "<" in name or has_owner:
        raise _UnknownError(name)
    return f"{value.__module__}.{name}".encode()
