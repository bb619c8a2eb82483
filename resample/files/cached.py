"""Limit the size of folders in the user's cache."""

import os
from contextlib import suppress
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
