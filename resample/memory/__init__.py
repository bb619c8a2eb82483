"""Does it fit into memory? Asked before anything large is allocated.

A command adds up what its work will hold at its height (`require`): the libraries, what is read,
what is made of it, the picture and its copies. The sum is said with `RESAMPLE_LOG=debug`, and
refused where it is more than `--memory`, or more than is free. Beside it stands, in the end, what
the process really held (`held_at_most`).
"""

import logging
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

GIB = 1 << 30
GIVEN_BACK = 8 << 20  # bytes from which on arrays go back to the machine when they are freed
# Bytes of addresses, and of data, that libraries and their threads take without holding memory.
OF_ADDRESSES, OF_DATA = 1 << 30, 400 << 20
M_MMAP_THRESHOLD = -3  # of glibc's mallopt
LOG = logging.getLogger("resample")
ALLOWED: ContextVar[int | None] = ContextVar("allowed", default=None)


def give_back() -> None:
    """Let this process give large arrays back to the machine when they are freed.

    By itself glibc holds on to arrays of up to 32 MiB, in each thread. Does nothing elsewhere.
    """
    _tell_glibc("mallopt", M_MMAP_THRESHOLD, GIVEN_BACK)


def trim() -> None:
    """Give what was freed back to the machine now, of arrays of any size and in all threads.

    For between two parts of work that each take much. Does nothing where there is no glibc.
    """
    _tell_glibc("malloc_trim", 0)


def _tell_glibc(name: str, *numbers: int) -> None:
    """Call a function of glibc's, if this is one."""
    import ctypes

    with suppress(AttributeError, OSError, TypeError):
        getattr(ctypes.CDLL(None), name)(*numbers)


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


def held() -> int:
    """Bytes of memory that this process has now; 0 where the platform does not tell."""
    return _of_status("VmRSS")


def held_at_most() -> int:
    """Bytes of memory that this process had at its height; 0 where the platform does not tell."""
    return _of_status("VmHWM")


def held_of_files() -> int:
    """Bytes of files that are in the memory of this process now; 0 where that is not told."""
    return _of_status("RssFile")


def _of_status(name: str) -> int:
    try:
        text = Path("/proc/self/status").read_text(encoding="ascii", errors="replace")
    except OSError:
        return 0
    found = re.search(rf"^{name}:\s*(\d+) kB", text, re.MULTILINE)
    return int(found[1]) << 10 if found else 0


@contextmanager
def allowing(memory: str | None) -> Iterator[None]:
    """Let work within this block hold so much memory, as `--memory` has it; None: what is free.

    Raises
    ------
    ValueError
        It is no amount, or the limits of the process leave no room for libraries.
    """
    check_limits()
    token = ALLOWED.set(None if memory is None else bytes_of(memory))
    try:
        yield
    finally:
        ALLOWED.reset(token)


def check_limits() -> None:
    """Refuse to begin in a process whose limits end it while libraries are loaded.

    Raises
    ------
    ValueError
        They leave no room.
    """
    if _limit() == 0:
        raise ValueError(
            f"the limits of this process (ulimit) leave no room for libraries; allow more than "
            f"{amount(OF_DATA)} of data and {amount(OF_ADDRESSES)} of addresses"
        )


def allow(count: int) -> None:
    """Let work hold so many bytes, from here to the end of the block of `allowing` around it."""
    ALLOWED.set(count)


def require(what: str, parts: dict[str, int], remedy: str) -> None:
    """Say (DEBUG) what work will hold at its height, and refuse what is not allowed.

    Parameters
    ----------
    what
        Name of the work for the message.
    parts
        Bytes by what they are for; libraries are one of them.
    remedy
        What to do about it, for the message.

    Raises
    ------
    ValueError
        It is more than `--memory` allows, or than is free beside what the process holds already.

    Examples
    --------
    >>> from resample.memory import allowing, require
    >>> with allowing("1GiB"):
    ...     require("a warp", {"libraries": 200 << 20, "the picture": 600 << 20}, "take less")
    """
    need = sum(parts.values())
    each = ", ".join(f"{name} {amount(count)}" for name, count in parts.items())
    LOG.debug("%s needs about %s of memory: %s", what, amount(need), each)
    allowed, free = ALLOWED.get(), _free()
    if allowed is not None and need > allowed:
        raise ValueError(
            f"{what} needs about {amount(need)} of memory, --memory allows {amount(allowed)}; "
            f"{remedy}, or allow more"
        )
    if allowed is None and free is not None and need > free:
        raise ValueError(
            f"{what} needs about {amount(need)} of memory, {amount(free)} are free; {remedy}"
        )
    limit = _limit()
    if limit is not None and need > limit:
        raise ValueError(
            f"{what} needs about {amount(need)} of memory, the limits of this process (ulimit) "
            f"leave {amount(limit)} beside libraries; {remedy}, or raise them"
        )


def _limit() -> int | None:
    """Bytes that the limits of this process let it hold; None if there are none."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    kinds = ((resource.RLIMIT_AS, OF_ADDRESSES), (resource.RLIMIT_DATA, OF_DATA))
    limits = [(resource.getrlimit(kind)[0], apart) for kind, apart in kinds]
    left = [max(0, most - apart) for most, apart in limits if most != resource.RLIM_INFINITY]
    return min(left, default=None)


def _free() -> int | None:
    """Bytes that this process can have, with those that it has; None if the platform is silent."""
    free, installed = available_memory(), physical_memory()
    if free is None or installed is None:
        return None
    return min(free + held(), installed)


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
        `--memory` allows less, or the machine has less, used or not.
    """
    LOG.debug("%s: %.3g GiB of memory", what, count / GIB)
    allowed, installed = ALLOWED.get(), physical_memory()
    if allowed is not None and count > allowed:
        raise ValueError(
            f"{what} needs {amount(count)} of memory, --memory allows {amount(allowed)}; {remedy}"
        )
    if installed is not None and count > installed:
        raise ValueError(
            f"{what} needs {count / GIB:.1f} GiB, this machine has {installed / GIB:.1f} GiB "
            f"of memory; {remedy}"
        )
