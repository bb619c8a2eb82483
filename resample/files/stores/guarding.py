"""Chunks of zarr that hold far more than their values are refused before they are unpacked."""

from collections.abc import Iterable
from math import prod
from typing import Any

from zarr.storage import WrapperStore

from resample.memory import amount
from resample.reading.limits import check_free

PER_VALUE, BESIDE = 2, 4096  # what packed data may take, by what their values do, and besides
METADATA = ("zarr.json", ".zarray", ".zattrs", ".zgroup", ".zmetadata")


class GuardedStore(WrapperStore[Any]):  # type: ignore[misc]
    """A store of which no chunk is read that is much larger than all of its values.

    Honest packing makes values smaller, or hardly larger; what unpacks to gigabytes does not fit
    behind a small chunk then.
    """

    most: int | None = None  # bytes that a chunk may take as it is stored; None: not known yet

    @property
    def within(self) -> Any:
        """The store that is guarded."""
        return self._store

    async def get(self, key: str, prototype: Any, byte_range: Any = None) -> Any:
        """Chunk or metadata of a key, see zarr."""
        return self._checked(key, await self._store.get(key, prototype, byte_range))

    async def get_partial_values(
        self, prototype: Any, key_ranges: Iterable[tuple[str, Any]]
    ) -> list[Any]:
        """Parts of chunks, see zarr."""
        asked = list(key_ranges)
        found = await self._store.get_partial_values(prototype, asked)
        return [self._checked(key, part) for (key, _), part in zip(asked, found, strict=True)]

    def _checked(self, key: str, found: Any) -> Any:
        is_chunk = found is not None and key.rpartition("/")[2] not in METADATA
        if is_chunk and self.most is not None and len(found) > self.most:
            raise ValueError(
                f"its chunk {key} takes {amount(len(found))}, where its values take "
                f"{amount((self.most - BESIDE) // PER_VALUE)}"
            )
        return found


def guard(array: Any, name: str) -> None:
    """Let no chunk of an array be read that cannot be one of its.

    Raises
    ------
    ValueError
        Values of one chunk take more memory than is free.
    """
    size = prod(getattr(array, "shards", None) or array.chunks) * array.dtype.itemsize
    check_free(f"a chunk of {name}", prod(array.chunks) * array.dtype.itemsize)
    store = array.store
    if isinstance(store, GuardedStore):
        store.most = max(store.most or 0, PER_VALUE * size + BESIDE)
