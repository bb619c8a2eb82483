"""Warps of pictures larger than memory, chunk by chunk."""

from typing import TYPE_CHECKING

from resample.lazy import attributes, listing

if TYPE_CHECKING:
    from resample_chunks.chunks import warp_chunks

_HOMES = {"warp_chunks": "chunks"}

__all__ = ["warp_chunks"]

__getattr__ = attributes(__name__, _HOMES)
__dir__ = listing(_HOMES)
