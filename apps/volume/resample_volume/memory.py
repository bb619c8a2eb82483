"""Does a volume fit into this machine's memory? Asked before anything large is allocated."""

from resample import console

REMEDY = "take a smaller or downsampled volume"


def require_memory(count: int, what: str) -> None:
    """Refuse a volume of `count` bytes that cannot fit, see `resample.console.require_memory`."""
    console.require_memory(count, what, REMEDY)
