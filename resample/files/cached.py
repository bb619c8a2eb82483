"""Arrays in the user's cache: files of limited size, and keys by the code that made them."""

import os
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.files.writing import replacing
from resample.reading.arrays import read_npz


def load_arrays(file: Path, *names: str) -> dict[str, NDArray[Any]] | None:
    """Load the arrays of a cache file and mark it as used; None if it is missing or damaged."""
    if not file.is_file():
        return None
    try:
        held = read_npz(file, *names)  # checks its checksums
    except (ValueError, OSError, LookupError):
        return None
    with suppress(OSError):
        os.utime(file)
    return held


def store_arrays(file: Path, arrays: Mapping[str, Any], most: int | None = None) -> bool:
    """Write arrays to a cache file, and return whether that succeeded.

    Parameters
    ----------
    most
        Limit on the bytes of all files in its folder, of which the least recently used are removed;
        None: the folder is not ours, so that none are.
    """
    size = sum(np.asarray(array).nbytes for array in arrays.values())
    if most is not None and size > most:
        return False
    with suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        if most is not None:
            _evict(file.parent, size, most)
        with replacing(file) as temporary, temporary.open("wb") as stream:
            np.savez(stream, **arrays)
        return True
    return False


def _evict(folder: Path, wanted: int, most: int) -> None:
    """Remove the least recently used files of a folder until `wanted` bytes fit."""
    files = [(entry.stat(), entry) for entry in folder.glob("*.np[yz]")]
    total = sum(stat.st_size for stat, _ in files)
    for stat, entry in sorted(files, key=lambda pair: pair[0].st_mtime):
        if total + wanted <= most:
            return
        entry.unlink(missing_ok=True)
        total -= stat.st_size


@cache
def source_fingerprint(*names: str) -> str:
    """Fingerprint of the source code of modules and packages, and of the engine.

    Cached results that such code computed are keyed by it.
    """
    from resample.engine.compiled.sources import engine_digest

    digest = sha256(engine_digest().encode())
    for name in names:
        spec = find_spec(name)
        if spec is None or spec.origin is None:
            raise ModuleNotFoundError(f"no source code of {name}", name=name)
        folders = spec.submodule_search_locations or ()
        files = [file for folder in folders for file in sorted(Path(folder).rglob("*.py"))]
        for file in files or [Path(spec.origin)]:
            digest.update(file.read_bytes())
    return digest.hexdigest()
