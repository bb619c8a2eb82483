"""Limits of files raised for one command and all that it starts, as its flags have it."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

from resample.reading import limits, neighbours


@contextmanager
def raised(limit: str | None = None, *, allow_outside: bool = False) -> Iterator[None]:
    """Let files hold more, or name others outside of their folder, within this block.

    Parameters
    ----------
    limit
        As `RESAMPLE_LIMIT` has it: unpacked=8GiB,ratio=5000. It goes before the environment's.
    allow_outside
        As `RESAMPLE_ALLOW_OUTSIDE=1`.

    Raises
    ------
    ValueError
        A limit, of these or of the environment, is none.

    Examples
    --------
    >>> from resample.reading.limits import limits
    >>> from resample.reading.raising import raised
    >>> with raised("depth=90"):
    ...     limits().depth
    90
    """
    names = (limits.SETTING, neighbours.SETTING)
    before = {name: os.environ.get(name) for name in names}
    if limit is not None:
        os.environ[limits.SETTING] = ",".join(filter(None, (before[limits.SETTING], limit)))
    if allow_outside:
        os.environ[neighbours.SETTING] = "1"
    try:
        limits.limits()
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
