"""Addresses of zarr stores, local and remote, and their detection.

They are given on the command line or in a program, never by a file. Keys, regions and endpoints
come from the environment, as in obstore: `AWS_ACCESS_KEY_ID`, `AWS_ENDPOINT`,
`AWS_SKIP_SIGNATURE=true` for public data, and so on. What reads and writes stores is a plugin.
"""

import os
from collections.abc import Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import urlsplit

from numpy.typing import NDArray

from resample import registry

STORE = ".zarr"  # suffix of stores
SCHEMES = ("s3", "s3a", "gs", "az", "abfs", "abfss", "http", "https")
ACCOUNTS = ("AZURE_STORAGE_ACCOUNT_NAME", "AZURE_STORAGE_ENDPOINT", "GOOGLE_BASE_URL")
ENDPOINTS = ("AWS_ENDPOINT", "AWS_ENDPOINT_URL", "AWS_ENDPOINT_URL_S3")
MARKS = ("zarr.json", ".zgroup", ".zarray")  # files that mark a folder as zarr
ZIPS = (".zip", ".ozx")

Part = tuple[slice, slice]  # rows and columns


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


Place = Path | Address


def place_of(name: "str | PathLike[str] | Address") -> Place:
    """Convert a name to a path or address."""
    if isinstance(name, Address):
        return name
    return Address(str(name)) if is_address(name) else Path(name)


def is_address(name: object) -> bool:
    """Whether a name is an address."""
    scheme, colon, rest = str(name).partition("://")
    return bool(colon and rest) and scheme.lower() in SCHEMES


def is_store(path: Path) -> bool:
    """Whether a folder is a zarr group or array."""
    return path.is_dir() and any((path / mark).is_file() for mark in MARKS)


def is_in_store(path: Place) -> bool:
    """Whether a picture is a zarr store: a folder, a zip file, or at an address."""
    if isinstance(path, Address):
        return True
    return is_store(path) or (path.suffix.lower() in ZIPS and path.is_file())


class StoredPicture(Protocol):
    """Protocol of pictures in chunks."""

    @property
    def array(self) -> Any:
        """The array, with `size` and `dtype`."""

    @property
    def shape(self) -> tuple[int, int, int]:
        """Height, width and number of channels."""

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels, of R, G, B, A and Y."""

    @property
    def bits(self) -> int:
        """Bits of a value: 8, 16, or 32 for floats."""

    def strips(self, seen: Part | None = None) -> Iterator[NDArray[Any]]:
        """Read all rows (N, W, C), or a part's, from the top."""

    def levels(self, seen: Part | None = None) -> NDArray[Any]:
        """Read all rows (H, W, C); with `seen`, only that part is defined."""


class StoreFormat(Protocol):
    """Protocol of the plugin that reads and writes pictures in stores."""

    def open_picture(self, path: Place) -> StoredPicture:
        """Open a picture; for several sizes the finest."""

    def check_store(self, path: Path) -> None:
        """Reject a store that could not be written, before any work is done."""

    def writing_store(self, path: Path, height: int) -> AbstractContextManager[Any]:
        """Write a picture; the context's method `put` takes its rows (N, W, C) from the top."""


def store_format(path: Place) -> StoreFormat:
    """Return the plugin for a store, or raise a ValueError that says which package has it."""
    try:
        found: StoreFormat = registry.build("stores", "zarr")
    except LookupError as error:
        raise ValueError(f"{path.name} is a zarr store; {error}") from None
    return found
