"""Check that a volume fits in memory, before anything large is allocated."""

from resample import memory

REMEDY = "take a smaller or downsampled volume"


def require_memory(count: int, what: str) -> None:
    """Reject a volume of `count` bytes that cannot fit, see `resample.memory.require_memory`."""
    memory.require_memory(count, what, REMEDY)
