"""Fingerprints: texts that are equal if two values are, across processes."""

from collections.abc import Callable, Iterator, Sequence, Set
from hashlib import sha256
from types import BuiltinFunctionType, FunctionType, ModuleType, NoneType
from typing import Any

import numpy as np

PLAIN = (type(None), bool, int, float, complex, str, bytes)


class _UnknownError(ValueError):
    """A value has no fingerprint."""


def fingerprint(value: Any, place_of: Callable[[Any], object | None] | None = None) -> str | None:
    """Fingerprint of a value, equal only for equal values; None if it has none.

    Parameters
    ----------
    value
        Numbers, texts, arrays, functions of modules, and anything made of them: sequences, sets,
        mappings, dataclasses, copyable objects.
    place_of
        Returns a substitute for a part, such as its address; None: the part itself counts.

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
    """Parts of a value as bytes, each preceded by its type."""
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
        parts: Sequence[Any] = ()
        if isinstance(value, tuple | list):
            parts = value
        elif isinstance(value, Set):  # order does not matter
            names = [fingerprint(part, place_of) for part in value]
            if None in names:
                raise _UnknownError("a part of a set")
            parts = sorted(str(name) for name in names)
        elif isinstance(made := value.__reduce_ex__(2), str):
            parts = (made,)
        else:
            function, arguments, *more = made  # state, list items and mapping items
            parts = [function, arguments, *more[:1], *(list(items or ()) for items in more[1:])]
        yield b"%d" % len(parts)
        for part in parts:
            yield from _words(part, place_of)


def _named(value: Any) -> bytes:
    """Qualified name of a class or function of a module."""
    name: str = value.__qualname__
    has_owner = isinstance(value, BuiltinFunctionType) and not isinstance(
        value.__self__, ModuleType | NoneType
    )
    if "<" in name or has_owner:
        raise _UnknownError(name)
    return f"{value.__module__}.{name}".encode()
