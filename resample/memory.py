"""Does it fit into this machine's memory? Asked before anything large is allocated."""

import logging
import os
import re
from pathlib import Path

GIB = 1 << 30
LOG = logging.getLogger("resample")


def physical_memory() -> int | None:
    """Bytes of memory this machine has; None where the platform does not tell."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return None


def available_memory() -> int | None:
    """Bytes of memory that programs can have now; None where the platform does not tell."""
    try:
        text = Path("/proc/meminfo").read_text(encoding="ascii")
        kib = next(line for line in text.splitlines() if line.startswith("MemAvailable:"))
        free: int | None = int(kib.split()[1]) << 10
    except (OSError, StopIteration, ValueError):
        free = physical_memory()
    try:
        folder = Path("/sys/fs/cgroup")
        most, used = (
            int((folder / name).read_text(encoding="ascii"))
            for name in ("memory.max", "memory.current")
        )
    except (OSError, ValueError):
        return free
    left = max(0, most - used)
    return left if free is None else min(free, left)


def bytes_of(text: str) -> int:
    """Bytes of a text such as 2GiB, 512MB or 1.5G.

    Raises
    ------
    ValueError
        It is none.
    """
    found = re.fullmatch(r"\s*(\d+(?:\.\d*)?|\.\d+)\s*([KMGT])(i?)B?\s*", text, re.IGNORECASE)
    number = float(found[1]) if found else 0.0
    if found is None or not number > 0:
        raise ValueError(f"{text!r} is no amount of memory; give one such as 2GiB or 500MB")
    power = "KMGT".index(found[2].upper()) + 1
    return int(number * (1024 if found[3] else 1000) ** power)


def amount(count: int) -> str:
    """Bytes for a user's eyes."""
    return f"{count / GIB:.2f} GiB" if count >= GIB / 10 else f"{count / (1 << 20):.2f} MiB"


def require_memory(count: int, what: str, remedy: str) -> None:
    """Refuse what cannot fit, however long one waits; what it needs is logged (DEBUG).

    Parameters
    ----------
    count
        Bytes that will be held at once.
    what
        Name for the message.
    remedy
        What to do about it, for the message.

    Raises
    ------
    ValueError
        The machine has less memory than that, used or not.
    """
    LOG.debug("%s: %.3g GiB of memory", what, count / GIB)
    installed = physical_memory()
    if installed is not None and count > installed:
        raise ValueError(
            f"{what} needs {count / GIB:.1f} GiB, this machine has {installed / GIB:.1f} GiB "
            f"of memory; {remedy}"
        )
