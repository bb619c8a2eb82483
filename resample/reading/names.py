"""File names for C++ libraries, which expect UTF-8.

Linux allows any bytes in names; Python represents undecodable ones as lone surrogates, which such
libraries reject.
"""

import atexit
import os
import shutil
import tempfile
from contextlib import suppress
from functools import cache
from hashlib import sha256
from pathlib import Path


def plain(path: str | Path) -> str:
    r"""Name of a file for any library: its own, or a temporary link if it is not valid text.

    Returns
    -------
    Links keep the suffix, are in the folder for temporary files, and are removed at exit.

    Examples
    --------
    >>> from resample.reading.names import plain
    >>> plain("café.png"), plain("caf\udce9.png").isascii()
    ('café.png', True)
    """
    name = str(path)
    try:
        name.encode()
    except UnicodeEncodeError:
        return _link(os.path.abspath(name))
    return name


def _link(target: str) -> str:
    """Link to a file, the same for repeated calls."""
    ending = "".join(Path(target).suffixes[-2:])
    name = sha256(os.fsencode(target)).hexdigest()[:16] + (ending if ending.isascii() else "")
    link = os.path.join(_folder(os.getpid()), name)
    with suppress(FileExistsError):
        os.symlink(target, link)
    return link


@cache
def _folder(process: int) -> str:
    """Folder of a process's links, removed with it but not with its forks."""
    made = tempfile.mkdtemp(prefix="resample-names-")

    def remove() -> None:
        if os.getpid() == process:
            shutil.rmtree(made, ignore_errors=True)

    atexit.register(remove)
    return made
