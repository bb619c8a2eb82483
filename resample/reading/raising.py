"""Raise the limits on files for one command and its child processes."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

from resample.reading import limits, neighbours


@contextmanager
def raised(limit: str | None = None, *, allow_outside: bool = False) -> Iterator[None]:
    """Raise limits, or allow files to refer to others outside their folder, in this block.

    Parameters
    ----------
    limit
        As in `RESAMPLE_LIMIT`: unpacked=8GiB,ratio=5000. Overrides the environment.
    allow_outside
        As `RESAMPLE_ALLOW_OUTSIDE=1`.

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
