"""Open zarr stores, local and remote, and report errors in one line."""

import asyncio
import json
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from typing import Any

import zarr
from zarr.core import sync

from resample.files.stores import ENDPOINTS, MARKS, Address, Place, is_store
from resample.messages import one_line, visible
from resample.reading.limits import LimitError
from resample_zarr.guarding import Folder, GuardedStore, Zip

PATIENCE = timedelta(seconds=30)  # for a response, and for all attempts to read a chunk
TRIES = 4
SETTLING = 5.0  # seconds


def distant_store(address: Address) -> Any:
    """Open an address as a store of zarr for reading."""
    try:
        import obstore
    except ImportError as error:
        raise ValueError(
            f"{address.url} is remote, and {error.name} is not installed: "
            "pip install 'hybrid-resample[remote]'"
        ) from None
    asked = [address.url, *(os.environ.get(name, "") for name in ENDPOINTS)]
    client: Any = {"timeout": PATIENCE, "connect_timeout": PATIENCE}
    client["allow_http"] = any(url.lower().startswith("http://") for url in asked)
    again: Any = {"max_retries": TRIES, "retry_timeout": PATIENCE}
    place = obstore.store.from_url(address.url, client_options=client, retry_config=again)
    return zarr.storage.ObjectStore(place, read_only=True)


def open_node(path: Place) -> Any:
    """Open a group or array in a folder, a zip file or at an address."""
    if isinstance(path, Address):
        distant = GuardedStore(distant_store(path))
        with reading_metadata(path.url):
            return zarr.open(distant, mode="r")
    if not path.exists():
        raise FileNotFoundError(f"{path}: there is no such file or folder")
    with reading_metadata(path.name):
        place = path.resolve()
        if path.is_dir():
            store: Any = zarr.storage.LocalStore(place, read_only=True)
            listing: Folder | Zip = Folder(place)
            root = "" if is_store(path) else None
        else:
            listing = packed = Zip(place)
            # Path of the topmost metadata in a zip file; None if missing.
            found = [name for name in packed.members if name.rpartition("/")[2] in MARKS]
            root = min(found, key=len).rpartition("/")[0] if found else None
            store = zarr.storage.ZipStore(place, mode="r")
        if root is None:
            raise ValueError("there is no zarr.json, .zgroup or .zarray")
        # Consolidated metadata may list any number of arrays; so each is opened by itself.
        return zarr.open(GuardedStore(store, listing), path=root, mode="r", use_consolidated=False)


@contextmanager
def reading(what: str) -> Iterator[None]:
    """Convert errors to one line; damaged chunks raise many types."""
    try:
        yield
    except MemoryError:
        raise
    except PermissionError as error:
        raise PermissionError(f"{what} cannot be read: {one_line(error)}") from None
    except ConnectionError:
        raise
    except json.JSONDecodeError as error:
        raise ValueError(f"{what}: its metadata is not JSON: {one_line(error)}") from None
    except Exception as error:
        _settle()
        if isinstance(error, LimitError):
            raise ValueError(f"{what}: {one_line(error):.300}") from None
        if type(error).__module__.startswith("obstore"):
            raise ConnectionError(f"{what} cannot be fetched: {_reason(error)}") from None
        raise ValueError(f"{what} is not zarr, or damaged: {one_line(error):.300}") from None


@contextmanager
def reading_metadata(what: str) -> Iterator[None]:
    """As `reading`, without zarr's warnings about non-standard codecs."""
    with reading(what), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def _settle() -> None:
    """Wait for zarr's pending tasks after a failed read, which would print errors at exit."""

    async def ended() -> None:
        begun = [
            task
            for task in asyncio.all_tasks()
            if getattr(task.get_coro(), "__name__", "") != "_runner"  # of tasks that wait for these
        ]
        if begun:
            await asyncio.wait(begun, timeout=SETTLING)

    if sync.loop[0] is not None:
        sync.sync(ended())


def _reason(error: Exception) -> str:
    """Message of an obstore error, without its source code."""
    return visible(" ".join(str(error).partition("Debug source")[0].split()))[:300]
