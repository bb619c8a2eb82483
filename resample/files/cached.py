"""Folders in the user's cache: limit their size, and key results by the code that made them."""

import os
from contextlib import suppress
from functools import cache
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path


def evict(folder: Path, wanted: int, most: int) -> None:
    """Remove the least recently used files of a folder until `wanted` bytes fit.

    Parameters
    ----------
    folder
        Every file in it can be created again.
    wanted
        Bytes to be added.
    most
        Limit on the total in bytes.
    """
    files = [(entry.stat(), entry) for entry in folder.glob("*.np[yz]")]
    total = sum(stat.st_size for stat, _ in files)
    for stat, entry in sorted(files, key=lambda pair: pair[0].st_mtime):
        if total + wanted <= most:
            return
        entry.unlink(missing_ok=True)
        total -= stat.st_size


def note_use(file: Path) -> None:
    """Mark a file as recently used."""
    with suppress(OSError):
        os.utime(file)


@cache
def source_fingerprint(*names: str) -> str:
    """Fingerprint of the source code of modules and packages, and of the engine.

    Cached results that such code computed are keyed by it.

    Raises
    ------
    ModuleNotFoundError
        There is no module of a name.
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
