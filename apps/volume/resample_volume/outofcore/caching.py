"""Cache of results about volumes in bricks: what all pictures of one look depend on."""

from collections.abc import Callable
from typing import Any, TypeVar

from resample.cameras.viewpoints import Sphere
from resample.outofcore.caching import FactCache
from resample_volume.data.values import bricks_of
from resample_volume.files.stores import statistics_cache
from resample_volume.outofcore.outline import VisibleBlocks
from resample_volume.types import Volume
from resample_volume.voxels.cropping import Steep

CODE = "resample_volume.voxels", "resample_volume.classification"
MOST_BYTES = 1 << 28  # bytes of all that is kept

R = TypeVar("R")


def facts() -> FactCache:
    """Return the cache of facts about volumes."""
    kinds = VisibleBlocks, Steep, Sphere
    return FactCache("looks", CODE, kinds, MOST_BYTES, statistics_cache.LEAST)


def cached(volume: Volume, depends: Any, find: Callable[[], R], *, lasts: bool = False) -> R:
    """Return a result about a volume in bricks, cached as long as the bricks exist."""
    return facts().cached(bricks_of(volume), (depends, volume[1:4]), find, lasts=lasts)


def cached_visible(volume: Volume, depends: Any) -> VisibleBlocks | None:
    """Return the cached scan for a look, if there is one; arguments as of `cached`."""
    found = facts().found(bricks_of(volume), (depends, volume[1:4]))
    return None if found is None else found.result


def cache_visible(volume: Volume, depends: Any, found: VisibleBlocks) -> None:
    """Cache the scan for pictures of a look; arguments as of `cached`."""
    facts().keep(bricks_of(volume), (depends, volume[1:4]), found)
