"""Folders of the user's cache, which hold no more than so many bytes."""

import os
from contextlib import suppress
from pathlib import Path


def make_room(folder: Path, wanted: int, most: int) -> None:
    """Remove the files of a folder that were not used for longest until there is room.

    Parameters
    ----------
    folder
        All files in it may be made again.
    wanted
        Bytes that are to be added.
    most
        Bytes that all of them may take together.
    """
    files = [(entry.stat(), entry) for entry in folder.glob("*.np[yz]")]
    total = sum(stat.st_size for stat, _ in files)
    for stat, entry in sorted(files, key=lambda pair: pair[0].st_mtime):
        if total + wanted <= most:
            return
        entry.unlink(missing_ok=True)
        total -= stat.st_size


def note_use(file: Path) -> None:
    """Let a file be one of those that were used last."""
    with suppress(OSError):
        os.utime(file)
