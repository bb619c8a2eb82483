"""Cache of facts about a source, in memory and on disk.

In this process facts are attached to the source, or kept in a scene. Those that last are also kept
in the user's cache, for later commands, as long as the source, its state and the code that finds
them are the same.
"""

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import Any, NamedTuple, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from resample.files.writing import load_arrays, source_fingerprint, store_arrays
from resample.fingerprints import fingerprint
from resample.memory import mapped
from resample.outofcore.bricks import BrickArray
from resample.reading.texts import json_of

LARGE = 1 << 16  # bytes from which an array is identified by its address
LARGEST = 1 << 26  # bytes of an array that a key for other commands may hold

P = ParamSpec("P")
R = TypeVar("R")

Memo = dict[tuple[Any, ...], Any]  # by function, arguments and values

_kept: ContextVar[Memo | None] = ContextVar("kept", default=None)


@contextmanager
def memoizing(kept: Memo) -> Iterator[None]:
    """Enable memoization within a block.

    Values must neither change nor be freed while results about them are kept.
    """
    token = _kept.set(kept)
    try:
        yield
    finally:
        _kept.reset(token)


def memo_of(values: Any) -> Memo:
    """Return what is kept about values; without a scene nothing is kept for long."""
    kept: Memo | None = getattr(values, "found", _kept.get())
    return {} if kept is None else kept


def memoized(of: Callable[[Any], Any]) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Memoize a function that only depends on values and numbers, in a scene or on the values."""

    def decorated(find: Callable[P, R]) -> Callable[P, R]:
        @wraps(find)
        def found(*args: P.args, **kwargs: P.kwargs) -> R:
            first, *others = args
            kept = memo_of(of(first))
            key = (find, id(of(first)), *others, *sorted(kwargs.items()))
            if key not in kept:
                kept[key] = find(*args, **kwargs)
            result: R = kept[key]
            return result

        return found

    return decorated


class CachedResult(NamedTuple):
    """A cached result."""

    result: Any
    depends: Any  # what it depends on, held so that its address is not reused


@dataclass(frozen=True)
class FactCache:
    """A folder of the user's cache with facts about sources, which have those of a process."""

    folder: str
    code: tuple[str, ...]  # modules that find facts: these are found anew where they have changed
    kinds: tuple[type[Any], ...]  # named tuples that facts are made of, besides numbers and arrays
    most: int  # bytes of all files together
    least: int  # elements of a source from which facts are kept on disk

    def cached(self, source: Any, depends: Any, find: Callable[[], R], *, lasts: bool = False) -> R:
        """Return a fact, cached as long as the source exists; if it lasts, on disk."""
        found = self.found(source, depends, lasts=lasts)
        if found is None:
            found = self.keep(source, depends, find(), lasts=lasts)
        known: R = found.result
        return known

    def found(self, source: Any, depends: Any, *, lasts: bool = True) -> CachedResult | None:
        """Return a fact of this command or, if on disk, of an earlier one; or None."""
        name = fingerprint(depends, _place_of)
        if name is not None and lasts and name not in source.found:
            file = self._file_of(source, depends)
            read = None if file is None else self._read(file)
            if read is not None:
                source.found[name] = read._replace(depends=depends)
        found: CachedResult | None = source.found.get(name)
        return found

    def keep(self, source: Any, depends: Any, result: Any, *, lasts: bool = True) -> CachedResult:
        """Cache a fact for this command and, if it lasts, for later ones."""
        name, found = fingerprint(depends, _place_of), CachedResult(result, depends)
        if name is None or (lasts and name in source.found):
            return found
        source.found[name] = found
        file = self._file_of(source, depends) if lasts else None
        if file is not None:
            arrays: dict[str, Any] = {}
            form = np.array(json.dumps(_formed(result, arrays)))
            store_arrays(file, {**arrays, "form": form}, self.most)
        return found

    def _file_of(self, source: Any, depends: Any) -> Path | None:
        """Return a cache file; None: the source is small, or may change unnoticed."""
        if not isinstance(source, BrickArray) or source.size < self.least:
            return None
        code = source_fingerprint(*self.code)
        name = fingerprint((code, source, depends), _content_of)
        return None if name is None else mapped.folder() / self.folder / f"{name[:40]}.npz"

    def _read(self, file: Path) -> CachedResult | None:
        """Read a file's content, if it exists and is intact."""
        held = load_arrays(file)
        if held is None:
            return None
        kinds = {kind.__name__: kind for kind in self.kinds}
        with suppress(ValueError, LookupError, TypeError):
            return CachedResult(_restored(json_of(str(held["form"])), held, kinds), None)
        return None


def _place_of(part: Any) -> int | None:
    """Identify large arrays and bricks by their address in memory."""
    is_large = isinstance(part, np.ndarray) and part.nbytes > LARGE
    return id(part) if is_large or isinstance(part, BrickArray) else None


def _content_of(part: Any) -> object | None:
    """Identify bricks by their store and its state; large arrays cannot be identified."""
    if isinstance(part, BrickArray):
        state = part.state()
        if state is None:
            raise ValueError("values may change unnoticed")
        return state
    if isinstance(part, np.ndarray) and part.nbytes > LARGEST:
        raise ValueError("an array is too large")
    return None


def _formed(value: Any, arrays: dict[str, NDArray[Any]]) -> Any:
    """Convert a value to JSON form, with its arrays stored separately."""
    if value is None or isinstance(value, bool | int | float):
        return value
    if isinstance(value, tuple):
        kind = "" if type(value) is tuple else type(value).__name__
        return {"kind": kind, "parts": [_formed(part, arrays) for part in value]}
    name = f"array {len(arrays)}"
    arrays[name] = np.asarray(value)
    return {"array": name}


def _restored(form: Any, arrays: Mapping[str, NDArray[Any]], kinds: Mapping[str, Any]) -> Any:
    """Convert the form back to the value."""
    if not isinstance(form, dict):
        return form
    if "array" in form:
        array = arrays[form["array"]]
        return array if array.ndim else array[()]
    parts = [_restored(part, arrays, kinds) for part in form["parts"]]
    return kinds[form["kind"]](*parts) if form["kind"] else tuple(parts)
