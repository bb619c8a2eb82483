"""Does it fit into this machine's memory? Asked before anything large is allocated."""

import os

GIB = 1 << 30


def physical_memory() -> int | None:
    """Bytes of memory this machine has; None where the platform does not tell."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return None


def require_memory(count: int, what: str, remedy: str) -> None:
    """Refuse what cannot fit, however long one waits.

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
    installed = physical_memory()
    if installed is not None and count > installed:
        raise ValueError(
            f"{what} needs {count / GIB:.1f} GiB, this machine has {installed / GIB:.1f} GiB "
            f"of memory; {remedy}"
        )
