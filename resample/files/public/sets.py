"""Named sets of public files, listed by applications."""

import json
import os
import sys
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

from resample.files.public.downloads import download
from resample.samples.finding import FOLDER_VARIABLE


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

    Parameters
    ----------
    package
        Package that lists the set.
    name
        One of `available(package)`.
    folder
        Parent folder; each set has a folder of its name. See `place_of`.
    base_url
        Mirror that has the files under their names; None: their original addresses.

    Returns
    -------
    Folder of the set.
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
    from resample.console.messages import say

    if name is None:
        lines = [f"{key}  {each.description}\n" for key, each in available(package).items()]
        sys.stdout.write("".join(lines))
        return
    place = fetch(package, name, folder=folder)
    chosen = available(package)[name]
    say(f"{name}: {chosen.terms}")
    say(f"try, in that folder: {chosen.example}")
    sys.stdout.write(f"{place}\n")
