"""Files that a file names: textures, materials, buffers, raw data.

A file that came from anywhere must not have others read that its user never meant: what it names
lies in or under its own folder. `RESAMPLE_ALLOW_OUTSIDE=1` in the environment, or a command's
`--allow-outside`, lets all of them in.
"""

import os
import re
from pathlib import Path

SETTING = "RESAMPLE_ALLOW_OUTSIDE"  # name of an environment variable
ADDRESS = re.compile(r"^[A-Za-z][A-Za-z0-9+.-]+:")  # not a drive's single letter


def neighbour(source: Path, name: str) -> Path:
    """File that another names, whether it is there or not.

    Parameters
    ----------
    source
        The file that names it.
    name
        As it stands there.

    Raises
    ------
    ValueError
        It is an address, lies outside of the folder of `source`, or is no plain file.

    Examples
    --------
    >>> from pathlib import Path
    >>> from resample.reading.neighbours import neighbour
    >>> neighbour(Path("scans/head.nhdr"), "head.raw").as_posix()
    'scans/head.raw'
    """
    if ADDRESS.match(name):
        raise _refusal(source, name, "an address, not a file; fetch it, and name the copy")
    if "\0" in name:
        raise _refusal(source, name, "no name of a file")
    file = source.parent / name
    if not allows_outside():
        remedy = "files are read from its own folder only; put it there, or give --allow-outside"
        path = Path(name.replace("\\", "/"))
        if path.is_absolute() or re.match(r"^[A-Za-z]:", name):
            raise _refusal(source, name, f"an absolute path; {remedy}")
        if ".." in path.parts:
            raise _refusal(source, name, f"a path that leads outside; {remedy}")
        if not _is_within(source, file):
            raise _refusal(source, name, f"a link that leads outside; {remedy}")
    if file.exists() and not (file.is_file() or file.is_dir()):
        raise _refusal(source, name, "a device or a pipe, not a file")
    return file


def allows_outside() -> bool:
    """Whether files may name others outside of their folder."""
    return os.environ.get(SETTING, "") not in ("", "0")


def _is_within(source: Path, file: Path) -> bool:
    """Whether a file lies under the folder of another, or of what that is a link to."""
    try:
        real = file.resolve()
        homes = (source.parent.resolve(), source.resolve().parent)
    except (OSError, RuntimeError):  # a circle of links
        return False
    return any(real.is_relative_to(home) for home in homes)


def _refusal(source: Path, name: str, reason: str) -> ValueError:
    return ValueError(f"{source.name} names {name!r:.100}, {reason}")
