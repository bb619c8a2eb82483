"""Addresses of stores, local and remote; open them and report errors in one line.

They are given on the command line or in a program, never by a file. Keys, regions and endpoints
come from the environment, as in obstore: `AWS_ACCESS_KEY_ID`, `AWS_ENDPOINT`,
`AWS_SKIP_SIGNATURE=true` for public data, and so on.
"""

import json
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from os import PathLike
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from resample.messages import one_line, visible
from resample.reading.limits import LimitError

STORE = ".zarr"  # suffix of stores
SCHEMES = ("s3", "s3a", "gs", "az", "abfs", "abfss", "http", "https")
PATIENCE = timedelta(seconds=30)  # for a response, and for all attempts to read a chunk
TRIES = 4
ACCOUNTS = ("AZURE_STORAGE_ACCOUNT_NAME", "AZURE_STORAGE_ENDPOINT", "GOOGLE_BASE_URL")
ENDPOINTS = ("AWS_ENDPOINT", "AWS_ENDPOINT_URL", "AWS_ENDPOINT_URL_S3")
MARKS = ("zarr.json", ".zgroup", ".zarray")  # files that mark a folder as zarr
ZIPS = (".zip", ".ozx")
SETTLING = 5.0  # seconds


@dataclass(frozen=True)
class Address:
    """Address of a store, such as `s3://bucket/heart.ome.zarr`."""

    url: str

    @property
    def name(self) -> str:
        """Last part of the path."""
        parts = urlsplit(self.url)
        return parts.path.rstrip("/").rpartition("/")[2] or parts.netloc

    @property
    def suffix(self) -> str:
        """Suffix of the name, from its last dot on."""
        return Path(self.name).suffix

    def resolve(self) -> "Address":
        """Return itself, for compatibility with paths."""
        return self

    def __truediv__(self, key: str) -> "Address":
        """Address of a part."""
        return Address(f"{self.url.rstrip('/')}/{key}")

    def __str__(self) -> str:
        return self.url

    @property
    def identity(self) -> str:
        """Text that differs for different stores, even if their addresses are equal."""
        return "\n".join(
            [self.url, *(os.environ.get(name, "") for name in (*ENDPOINTS, *ACCOUNTS))]
        )

    def store(self) -> Any:
        """Open as a zarr store for reading."""
        try:
            import obstore
            from zarr.storage import ObjectStore
        except ImportError as error:
            raise ValueError(
                f"{self.url} is remote, and {error.name} is not installed: "
                "pip install 'hybrid-resample[remote]'"
            ) from None
        asked = [self.url, *(os.environ.get(name, "") for name in ENDPOINTS)]
        client: Any = {"timeout": PATIENCE, "connect_timeout": PATIENCE}
        client["allow_http"] = any(url.lower().startswith("http://") for url in asked)
        again: Any = {"max_retries": TRIES, "retry_timeout": PATIENCE}
        place = obstore.store.from_url(self.url, client_options=client, retry_config=again)
        return ObjectStore(place, read_only=True)


Place = Path | Address


def place_of(name: "str | PathLike[str] | Address") -> Place:
    """Convert a name to a path or address.

    Examples
    --------
    >>> place_of("s3://bucket/slide.zarr"), place_of("slide.zarr").name
    (Address(url='s3://bucket/slide.zarr'), 'slide.zarr')
    """
    if isinstance(name, Address):
        return name
    return Address(str(name)) if is_address(name) else Path(name)


def is_address(name: object) -> bool:
    """Whether a name is an address.

    Examples
    --------
    >>> is_address("https://a.org/heart.ome.zarr"), is_address("heart.ome.zarr")
    (True, False)
    """
    scheme, colon, rest = str(name).partition("://")
    return bool(colon and rest) and scheme.lower() in SCHEMES


def is_store(path: Path) -> bool:
    """Whether a folder is a zarr group or array."""
    return path.is_dir() and any((path / mark).is_file() for mark in MARKS)


def require_zarr(what: str) -> Any:
    """Import the package zarr, an extra."""
    try:
        import zarr
    except ImportError as error:
        raise ValueError(
            f"{what} is a zarr store, and {error.name} is not installed: "
            "pip install 'hybrid-resample[zarr]'"
        ) from None
    return zarr


def open_node(path: Place) -> Any:
    """Open a group or array in a folder, a zip file or at an address."""
    zarr = require_zarr(path.name)
    from resample.files.stores.guarding import Folder, GuardedStore, Zip

    if isinstance(path, Address):
        distant = GuardedStore(path.store())
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
            # Path of the topmost metadata in a zip file; None if there are none.
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
    import asyncio

    from zarr.core import sync

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
