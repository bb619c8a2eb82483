"""Robust downloads: limits on size and time, checksums, no partial files."""

import hashlib
import json
import os
import shutil
import sys
import time
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

from resample.console import Progress, progress_bar, say
from resample.files.writing import replacing
from resample.memory import amount
from resample.samples.finding import FOLDER_VARIABLE

TRIES = 3
CONNECTING, SILENCE = 10.0, 30.0  # seconds to wait for a connection, and for data
SLOWEST = 10_000  # bytes per second on average, after the first minute
PATIENCE = 60.0  # seconds
CHUNK = 1 << 16  # bytes
BARE = {"Accept-Encoding": "identity"}  # no compressed transfer


class WrongFileError(ValueError):
    """The received file is not the requested one."""


def download(url: str, target: Path, size: int, digest: str) -> None:
    """Download a file of a size in bytes and a digest (SHA-256 or SHA-512), unless it exists."""
    if target.is_file() and _digest(target, digest) == digest:
        return
    target.parent.mkdir(parents=True, exist_ok=True)
    free = shutil.disk_usage(target.parent).free
    if free < size:
        raise OSError(f"{target.parent} has {amount(free)} left, and {target.name} {amount(size)}")
    for attempt in range(TRIES):
        try:
            with replacing(target) as temporary, progress_bar(target.name) as progress:
                _receive(url, temporary, size, progress)
                if _digest(temporary, digest) != digest:
                    raise WrongFileError(
                        f"{url} gave another file than the collection lists (wrong "
                        f"{_kind(digest)}); nothing was kept"
                    )
            return
        except (ConnectionError, WrongFileError):
            if attempt == TRIES - 1:
                raise
            time.sleep(attempt + 1)


def _receive(url: str, target: Path, size: int, progress: Progress | None) -> None:
    """Write a response, which must have `size` bytes."""
    import requests
    from urllib3.exceptions import HTTPError

    begin, count = time.monotonic(), 0
    try:
        with (
            requests.get(url, headers=BARE, stream=True, timeout=(CONNECTING, SILENCE)) as answer,
            target.open("wb") as file,
        ):
            answer.raise_for_status()
            for chunk in answer.raw.stream(CHUNK, decode_content=False):  # undecoded
                count += len(chunk)
                if count > size:
                    break
                file.write(chunk)
                if progress is not None:
                    progress(count / size)
                passed = time.monotonic() - begin
                if passed > PATIENCE and count < SLOWEST * passed:
                    raise ConnectionError(
                        f"{url}: {amount(count)} of {amount(size)} came in {passed:.0f} s, which "
                        "is too slow; try again later"
                    )
    except requests.HTTPError as error:
        status = error.response.status_code if error.response is not None else "nothing"
        raise ConnectionError(f"{url}: the server answers {status}; try again later") from None
    except (requests.RequestException, HTTPError) as error:
        raise ConnectionError(
            f"{url} cannot be reached ({type(error).__name__}); put the file into {target.parent} "
            "by hand, or try again"
        ) from None
    if count != size:
        more = "more than" if count > size else f"{count} of"
        raise WrongFileError(f"{url} gave {more} the {size} bytes that it has; nothing was kept")


def _kind(digest: str) -> str:
    return "SHA-512" if len(digest) == 128 else "SHA-256"


def _digest(path: Path, like: str) -> str:
    """Digest of a file, with the algorithm of another digest."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, _kind(like).replace("-", "")).hexdigest()


class PublicFile(NamedTuple):
    """A file of a set."""

    name: str  # file name in the folder
    url: str
    size: int  # bytes
    digest: str  # SHA-256


class PublicSet(NamedTuple):
    """Files that belong together."""

    description: str
    terms: str  # conditions of use and credits
    example: str  # command that shows them, run in their folder
    files: tuple[PublicFile, ...]


def available(package: str) -> dict[str, PublicSet]:
    """Sets listed in a package's `data/public.json`, by name."""
    text = files(package).joinpath("data/public.json").read_text("utf-8")
    return {
        name: PublicSet(**{**entry, "files": tuple(PublicFile(*each) for each in entry["files"])})
        for name, entry in json.loads(text).items()
    }


def place_of(folder: str | Path | None) -> Path:
    """Folder for public files; None: HYBRID_RESAMPLE_DATA if set, else a cache."""
    from platformdirs import user_cache_dir

    return Path(folder or os.environ.get(FOLDER_VARIABLE) or user_cache_dir("hybrid-resample"))


def fetch(
    package: str, name: str, *, folder: str | Path | None = None, base_url: str | None = None
) -> Path:
    """Download a set, unless it is there already.

    `package`: package that lists the set. `name`: one of `available(package)`. `folder`: parent
    folder; each set has a folder of its name. See `place_of`. `base_url`: mirror that has the files
    under their names; None: their original addresses. Result: folder of the set.
    """
    known = available(package)
    if name not in known:
        raise LookupError(f"unknown set {name!r}; known are {', '.join(known)}")
    place = place_of(folder) / name
    for file in known[name].files:
        url = file.url if base_url is None else f"{base_url.rstrip('/')}/{file.name}"
        download(url, place / file.name, file.size, file.digest)
    return place


def print_sets(package: str, name: str | None, folder: Path | None) -> None:
    """Print the results of a `fetch` command: the sets, or a set's folder and terms."""
    if name is None:
        lines = [f"{key}  {each.description}\n" for key, each in available(package).items()]
        sys.stdout.write("".join(lines))
        return
    place = fetch(package, name, folder=folder)
    chosen = available(package)[name]
    say(f"{name}: {chosen.terms}")
    say(f"try, in that folder: {chosen.example}")
    sys.stdout.write(f"{place}\n")
