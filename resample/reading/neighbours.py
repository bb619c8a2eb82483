"""Files that other files refer to: textures, materials, buffers, raw data.

An untrusted file must not cause others to be read that the user did not intend: the files it refers
to must be in or below its own folder. `RESAMPLE_ALLOW_OUTSIDE=1` in the environment, or a command's
`--allow-outside`, allows all.
"""

import os
import re
from pathlib import Path

SETTING = "RESAMPLE_ALLOW_OUTSIDE"  # name of an environment variable
ADDRESS = re.compile(r"^[A-Za-z][A-Za-z0-9+.-]+:")  # not a drive's single letter


def neighbour(source: Path, name: str) -> Path:
    """Path of a file that another refers to, whether it exists or not.

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
    """Whether files may refer to others outside their folder."""
    return os.environ.get(SETTING, "") not in ("", "0")


def _is_within(source: Path, file: Path) -> bool:
    """Whether a file is under the folder of another, or of the target if that is a link."""
    try:
        real = file.resolve()
        homes = (source.parent.resolve(), source.resolve().parent)
    except (OSError, RuntimeError):  # a cycle of links
        return False
    return any(real.is_relative_to(home) for home in homes)


def _refusal(source: Path, name: str, reason: str) -> ValueError:
    return ValueError(f"{source.name} names {name!r:.100}, {reason}")
