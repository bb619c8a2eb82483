"""Memory budgets: check whether work fits before anything large is allocated.

A command adds up its peak memory (`require`): libraries, input, intermediate data, the picture and
its copies. `RESAMPLE_LOG=debug` logs the sum; it is rejected if it exceeds `--memory` or the
free memory. The log ends with the actual peak (`peak_memory`).
"""

import logging
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

GIB = 1 << 30
GIVEN_BACK = 8 << 20  # bytes above which freed arrays are returned to the system
# Bytes of address space and of data that libraries and their threads reserve without using.
OF_ADDRESSES, OF_DATA = 1 << 30, 400 << 20
M_MMAP_THRESHOLD = -3  # of glibc's mallopt
LOG = logging.getLogger("resample")
ALLOWED: ContextVar[int | None] = ContextVar("allowed", default=None)


def return_freed_memory() -> None:
    """Return freed memory to the system now, and large arrays from now on.

    By default glibc keeps arrays of up to 32 MiB in each thread. No effect elsewhere.
    """
    import ctypes

    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).mallopt(M_MMAP_THRESHOLD, GIVEN_BACK)
        ctypes.CDLL(None).malloc_trim(0)


def physical_memory() -> int | None:
    """Bytes of physical memory; None if the platform does not tell."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return None


def available_memory() -> int | None:
    """Bytes of memory available to programs now; None if the platform does not tell."""
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
    """Parse an amount of memory such as 2GiB, 512MB or 1.5G to bytes."""
    found = re.fullmatch(r"\s*(\d+(?:\.\d*)?|\.\d+)\s*([KMGT])(i?)B?\s*", text, re.IGNORECASE)
    number = float(found[1]) if found else 0.0
    if found is None or not number > 0:
        raise ValueError(f"{text!r} is not an amount of memory; give one such as 2GiB or 500MB")
    power = "KMGT".index(found[2].upper()) + 1
    return int(number * (1024 if found[3] else 1000) ** power)


def amount(count: int) -> str:
    """Format bytes for the user."""
    return f"{count / GIB:.2f} GiB" if count >= GIB / 10 else f"{count / (1 << 20):.2f} MiB"


def memory_in_use() -> int:
    """Bytes of memory that this process holds now; 0 if the platform does not tell."""
    return _of_status("VmRSS")


def peak_memory() -> int:
    """Peak memory of this process in bytes; 0 if the platform does not tell."""
    return _of_status("VmHWM")


def mapped_memory() -> int:
    """Bytes of files that are mapped into memory now; 0 if the platform does not tell."""
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
    """Limit the memory of work in this block, as `--memory` does; None: all free memory."""
    check_limits()
    token = ALLOWED.set(None if memory is None else bytes_of(memory))
    try:
        yield
    finally:
        ALLOWED.reset(token)


def check_limits() -> None:
    """Reject limits of the process that would end it while libraries are loaded."""
    if _limit() == 0:
        raise ValueError(
            f"the limits of this process (ulimit) leave no room for libraries; allow more than "
            f"{amount(OF_DATA)} of data and {amount(OF_ADDRESSES)} of addresses"
        )


def allow(count: int) -> None:
    """Set the limit in bytes until the end of the enclosing block of `allowing`."""
    ALLOWED.set(count)


def require(what: str, parts: dict[str, int], remedy: str) -> None:
    """Log (DEBUG) the peak memory of some work, and reject it if it is not allowed.

    Examples
    --------
    >>> from resample.memory import allowing, require
    >>> with allowing("1GiB"):
    ...     require("a warp", {"libraries": 200 << 20, "the picture": 600 << 20}, "take less")
    """
    need = sum(parts.values())
    each = ", ".join(f"{name} {amount(count)}" for name, count in parts.items())
    LOG.debug("%s needs about %s of memory: %s", what, amount(need), each)
    allowed, free, installed = ALLOWED.get(), available_memory(), physical_memory()
    if free is not None:  # or already held by this process
        free = None if installed is None else min(free + memory_in_use(), installed)
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
    """Bytes that this process's limits allow; None if unlimited."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    kinds = ((resource.RLIMIT_AS, OF_ADDRESSES), (resource.RLIMIT_DATA, OF_DATA))
    limits = [(resource.getrlimit(kind)[0], apart) for kind, apart in kinds]
    left = [max(0, most - apart) for most, apart in limits if most != resource.RLIM_INFINITY]
    return min(left, default=None)


def require_memory(count: int, what: str, remedy: str) -> None:
    """Reject work that can never fit into this machine; its need is logged (DEBUG)."""
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
