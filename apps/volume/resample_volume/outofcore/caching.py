"""Cache of results about volumes in bricks, in memory and on disk.

In this process results are attached to the bricks. What all pictures of one look depend on,
whatever their camera, is also kept in the user's cache: later commands need not scan all voxels
again, and read no hidden bricks.
"""

import json
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from resample.cameras.viewpoints import Sphere
from resample.files.writing import load_arrays, source_fingerprint, store_arrays
from resample.memory import mapped
from resample_volume.data.fingerprints import fingerprint
from resample_volume.data.values import bricks_of, streamed
from resample_volume.files.stores import statistics_cache
from resample_volume.outofcore.outline import VisibleBlocks
from resample_volume.types import Volume
from resample_volume.voxels.cropping import Steep

LARGE = 1 << 16  # bytes from which an array is identified by its address
LARGEST = 1 << 26  # bytes of an array that a key for other commands may hold
MOST_BYTES = 1 << 28  # bytes of all that is kept
KINDS = {kind.__name__: kind for kind in (VisibleBlocks, Steep, Sphere)}  # that files hold

R = TypeVar("R")


class CachedResult(NamedTuple):
    """A cached result."""

    result: Any
    depends: Any  # what it depends on, held so that its address is not reused


def cached(volume: Volume, depends: Any, find: Callable[[], R], *, lasts: bool = False) -> R:
    """Return a result about a volume in bricks, cached as long as the bricks exist."""
    found = _found_before(volume, depends, lasts=lasts)
    if found is None:
        found = CachedResult(find(), depends)
        _keep(volume, found, lasts=lasts)
    known: R = found.result
    return known


def cached_visible(volume: Volume, depends: Any) -> VisibleBlocks | None:
    """Return the cached scan for a look, if there is one; arguments as of `cached`."""
    found = _found_before(volume, depends, lasts=True)
    return None if found is None else found.result


def cache_visible(volume: Volume, depends: Any, looked: VisibleBlocks) -> None:
    """Cache the scan for pictures of a look; arguments as of `cached`."""
    bricks = bricks_of(volume)
    if _name_of(volume, depends) not in bricks.found:
        _keep(volume, CachedResult(looked, depends), lasts=True)


def _found_before(volume: Volume, depends: Any, *, lasts: bool) -> CachedResult | None:
    """Return the cached result of this command or, if on disk, of an earlier one; or None."""
    bricks = bricks_of(volume)
    name = _name_of(volume, depends)
    if name is not None and lasts and name not in bricks.found:
        file = _file_of(volume, depends)
        read = None if file is None else _read(file)
        if read is not None:
            bricks.found[name] = read._replace(depends=depends)
    found: CachedResult | None = bricks.found.get(name)
    return found


def _keep(volume: Volume, found: CachedResult, *, lasts: bool) -> None:
    """Cache a result for this command and, if it lasts, for later ones."""
    bricks = bricks_of(volume)
    name = _name_of(volume, found.depends)
    if name is None:
        return
    bricks.found[name] = found
    file = _file_of(volume, found.depends) if lasts else None
    if file is not None:
        _write(file, found.result)


def _name_of(volume: Volume, depends: Any) -> str | None:
    """Return the key of a result; None if its inputs cannot be identified."""
    return fingerprint((depends, volume[1:4]), _place_of)


def _place_of(part: Any) -> int | None:
    """Identify large arrays and bricks by their address in memory."""
    is_large = isinstance(part, np.ndarray) and part.nbytes > LARGE
    return id(part) if is_large or streamed(part) else None


def _file_of(volume: Volume, depends: Any) -> Path | None:
    """Return the cache file for a volume in a store; None: it is small, or may change unnoticed."""
    bricks = streamed(volume.values)
    if bricks is None or bricks.size < statistics_cache.LEAST:
        return None
    code = source_fingerprint("resample_volume.voxels", "resample_volume.classification")
    name = fingerprint((code, bricks, depends, volume[1:4]), _content_of)
    return None if name is None else mapped.folder() / "looks" / f"{name[:40]}.npz"


def _content_of(part: Any) -> object | None:
    """Identify bricks by their store and its state; large arrays cannot be identified."""
    bricks = streamed(part)
    if bricks is not None:
        state = bricks.state()
        if state is None:
            raise ValueError("values may change unnoticed")
        return state
    if isinstance(part, np.ndarray) and part.nbytes > LARGEST:
        raise ValueError("an array is too large")
    return None


def _read(file: Path) -> CachedResult | None:
    """Read a file's content, if it exists and is intact."""
    held = load_arrays(file)
    if held is None:
        return None
    with suppress(ValueError, LookupError, TypeError):
        return CachedResult(_restored(json.loads(str(held["form"])), held), None)
    return None


def _write(file: Path, found: Any) -> None:
    """Write a result, if possible."""
    arrays: dict[str, Any] = {}
    form = np.array(json.dumps(_formed(found, arrays)))
    store_arrays(file, {**arrays, "form": form}, MOST_BYTES)


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


def _restored(form: Any, arrays: Mapping[str, NDArray[Any]]) -> Any:
    """Convert the form back to the value."""
    if not isinstance(form, dict):
        return form
    if "array" in form:
        array = arrays[form["array"]]
        return array if array.ndim else array[()]
    parts = [_restored(part, arrays) for part in form["parts"]]
    return KINDS[form["kind"]](*parts) if form["kind"] else tuple(parts)
