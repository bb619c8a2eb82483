"""Names of files as libraries in C++ take them: texts in UTF-8.

Linux has names of any bytes; Python keeps those that are no letters as lone surrogates, on which
such libraries fail.
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
    r"""Name of a file that any library takes: its own or, where that is no text, a link to it.

    Parameters
    ----------
    path
        File, which need not be there.

    Returns
    -------
    Links keep the suffix, are where temporary files are, and go when the process ends.

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
    """Link to a file, the same one each time."""
    ending = "".join(Path(target).suffixes[-2:])
    name = sha256(os.fsencode(target)).hexdigest()[:16] + (ending if ending.isascii() else "")
    link = os.path.join(_folder(os.getpid()), name)
    with suppress(FileExistsError):
        os.symlink(target, link)
    return link


@cache
def _folder(process: int) -> str:
    """Folder of a process's links, which goes with it, and not with those that it was forked to."""
    made = tempfile.mkdtemp(prefix="resample-names-")

    def remove() -> None:
        if os.getpid() == process:
            shutil.rmtree(made, ignore_errors=True)

    atexit.register(remove)
    return made
