"""Addresses of remote stores: object stores and web servers.

They are given on the command line or in a program, never by a file. Keys, regions and endpoints
come from the environment, as in obstore: `AWS_ACCESS_KEY_ID`, `AWS_ENDPOINT`,
`AWS_SKIP_SIGNATURE=true` for public data, and so on.
"""

import os
from dataclasses import dataclass
from datetime import timedelta
from os import PathLike
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

STORE = ".zarr"  # suffix of stores
SCHEMES = ("s3", "s3a", "gs", "az", "abfs", "abfss", "http", "https")
PATIENCE = timedelta(seconds=30)  # for a response, and for all attempts to read a chunk
TRIES = 4
ACCOUNTS = ("AZURE_STORAGE_ACCOUNT_NAME", "AZURE_STORAGE_ENDPOINT", "GOOGLE_BASE_URL")
ENDPOINTS = ("AWS_ENDPOINT", "AWS_ENDPOINT_URL", "AWS_ENDPOINT_URL_S3")


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
    >>> from resample.files.stores.addresses import place_of
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
    >>> from resample.files.stores.addresses import is_address
    >>> is_address("https://a.org/heart.ome.zarr"), is_address("heart.ome.zarr")
    (True, False)
    """
    scheme, colon, rest = str(name).partition("://")
    return bool(colon and rest) and scheme.lower() in SCHEMES
