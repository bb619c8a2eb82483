"""Download and verify volumes of the open SciVis collection."""

import json
import math
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from resample.files.public import download, place_of
from resample.files.writing import replacing

# NRRD, because it has a spacing; the raw file beside it is unchanged.
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
    """Return the volumes that `fetch` knows, by name.

    Result: for each: `name`, `type`, `size` and `spacing` (x, y, z), `sha512`, `url`,
    `description`, `acknowledgement`.
    """
    text = files("resample_volume").joinpath("data/open_scivis.json").read_text("utf-8")
    known: dict[str, dict[str, Any]] = json.loads(text)
    return known


def fetch(name: str, *, folder: str | Path | None = None, base_url: str | None = None) -> Path:
    """Download a volume, unless it was downloaded before.

    `name`: one of `available()`. `folder`: folder to keep it in; None: HYBRID_RESAMPLE_DATA, or the
    user's cache. `base_url`: address of a mirror of the raw files; None: their public home. Result:
    path of a header for `open_volume`, with the raw file beside it. Raises LookupError: the name is
    unknown. Raises ValueError: the download differs from what the collection lists. It is not kept.
    Raises OSError: the server cannot be reached, or refuses; or the folder cannot be written.
    """
    known = available()
    if name not in known:
        raise LookupError(f"unknown volume {name!r}; known are {', '.join(known)}")
    place = place_of(folder)
    url = known[name]["url"]
    file = url.rpartition("/")[2]
    if base_url is not None:
        url = f"{base_url.rstrip('/')}/{file}"
    size = math.prod(known[name]["size"]) * np.dtype(known[name]["type"]).itemsize
    download(url, place / file, size, known[name]["sha512"])
    path = place / f"{name}.nhdr"
    entry = known[name]
    # Write a NRRD header beside a raw file, in one step
    text = NRRD.format(
        **entry,
        sizes=" ".join(map(str, entry["size"])),
        spacings=" ".join(map(str, entry["spacing"])),
        file=file,
    )
    with replacing(path) as temporary:
        temporary.write_text(text, "utf-8")
    return path
