"""Sample volumes from the open SciVis collection, downloaded once and checked."""

import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.resources import files
from pathlib import Path
from typing import Any

FOLDER_VARIABLE = "HYBRID_RESAMPLE_DATA"
RETRIES = 2

# NRRD, because it knows the spacing; the raw file beside it is as it came.
NRRD = """NRRD0004
# {acknowledgement}
content: {name}: {description}
type: {type}
dimension: 3
sizes: {sizes}
spacings: {spacings}
endian: little
encoding: raw
data file: {file}
"""


def available() -> dict[str, dict[str, Any]]:
    """Volumes that `fetch` knows, by name.

    Returns
    -------
    For each: `name`, `type`, `size` and `spacing` (x, y, z), `sha512`, `url`, `description`,
    `acknowledgement`.
    """
    text = files("resample_volume").joinpath("data/open_scivis.json").read_text("utf-8")
    known: dict[str, dict[str, Any]] = json.loads(text)
    return known


def fetch(name: str, *, folder: str | Path | None = None, base_url: str | None = None) -> Path:
    """Download a volume, or find it where it was downloaded before.

    Parameters
    ----------
    name
        One of `available()`.
    folder
        Where it is kept; None: what HYBRID_RESAMPLE_DATA says, or the user's cache.
    base_url
        Where a mirror has the raw files; None: their public home.

    Returns
    -------
    A header for `open_volume`, with the raw file beside it.

    Raises
    ------
    LookupError
        The name is unknown.
    ValueError
        What came is not what the collection lists. It is not kept.
    OSError
        The server cannot be reached, or refuses; or the folder cannot be written.
    """
    known = available()
    if name not in known:
        raise LookupError(f"unknown volume {name!r}; known are {', '.join(known)}")
    import pooch

    place = Path(folder or os.environ.get(FOLDER_VARIABLE) or pooch.os_cache("hybrid-resample"))
    url = known[name]["url"]
    file = url.rpartition("/")[2]
    if base_url is not None:
        url = f"{base_url.rstrip('/')}/{file}"
    _download(url, place / file, known[name]["sha512"])
    return _header(place / f"{name}.nhdr", known[name], file)


def _download(url: str, target: Path, sha512: str) -> None:
    import pooch
    import requests

    pooch.get_logger().setLevel("WARNING")
    store = pooch.create(
        target.parent,
        base_url="",
        registry={target.name: f"sha512:{sha512}"},
        urls={target.name: url},
        retry_if_failed=RETRIES,
    )
    try:
        with _progress(target.name) as progress:
            store.fetch(target.name, downloader=pooch.HTTPDownloader(progress, chunk_size=1 << 16))
    except requests.HTTPError as error:
        status = error.response.status_code if error.response is not None else "nothing"
        raise ConnectionError(f"{url}: the server answers {status}; try again later") from None
    except requests.RequestException as error:
        raise ConnectionError(
            f"{url} cannot be reached ({type(error).__name__}); put the file into {target.parent} "
            "by hand, or try again"
        ) from None
    except ValueError:
        raise ValueError(
            f"{url} gave another file than the collection lists (wrong SHA-512); nothing was kept"
        ) from None


class Bar:
    """A progress bar as pooch drives it, drawn by rich."""

    def __init__(self, progress: Any, name: str) -> None:
        self._progress = progress
        self._task = progress.add_task(name, total=None)
        self.total = 0  # bytes; set by pooch

    def update(self, count: int) -> None:
        """Move on by some bytes."""
        self._progress.update(self._task, advance=count, total=self.total or None)

    def reset(self) -> None:
        """Go back to the start."""
        self._progress.reset(self._task)

    def close(self) -> None:
        """Stop; rich does it when its block ends."""


@contextmanager
def _progress(name: str) -> Iterator[Bar | bool]:
    """Draw a bar on a terminal; give False elsewhere."""
    if not sys.stderr.isatty():
        yield False
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True)) as progress:
        yield Bar(progress, name)


def _header(path: Path, entry: dict[str, Any], file: str) -> Path:
    """Write a NRRD header beside a raw file, in one step."""
    text = NRRD.format(
        **entry,
        sizes=" ".join(map(str, entry["size"])),
        spacings=" ".join(map(str, entry["spacing"])),
        file=file,
    )
    partial = path.with_suffix(".partial")
    partial.write_text(text, "utf-8")
    partial.replace(path)
    return path
