"""Sample volumes: generated, or downloaded from the open SciVis collection."""

import json
import math
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from resample.files.writing import replacing
from resample.types import Doubles, Floats
from resample_volume.data.values import require_memory
from resample_volume.types import Volume

DARK, BRIGHT = 64, 192  # of the Checker Box; neither is transparent


class Capsule(NamedTuple):
    """A piece of vessel: a ball swept along a segment with decreasing radius."""

    start: Doubles  # (3,) x, y, z in 0..1, like all lengths here
    end: Doubles
    wide: float  # radius at the start
    narrow: float  # radius at the end


def checker_box(size: int = 100, block: int = 10) -> Volume:
    """Make alternating blocks of two values, as in the paper: all `size`³ voxels are visible.

    Parameters
    ----------
    size
        Voxels along each side.
    block
        Voxels along the side of a block.

    Returns
    -------
    uint8 with values 64 and 192, spacing 1, origin 0.
    """
    _check("checker-box", size, size)
    if block < 1:
        raise ValueError(f"checker-box: block is at least 1 voxel, not {block}")
    parity = (np.arange(size) // block % 2).astype(np.uint8)
    odd = parity[:, None, None] ^ parity[:, None] ^ parity
    values = np.where(odd, np.uint8(BRIGHT), np.uint8(DARK))
    return Volume(values, name="checker-box")


def marschner_lobb(size: int = 41, fm: float = 6.0, alpha: float = 0.25) -> Volume:
    """Make the test signal of Marschner and Lobb (1994), which reveals interpolation errors.

    Parameters
    ----------
    size
        Samples along each side; the cube is [-1, 1]³.
    fm, alpha
        Frequency and strength of the ripples.

    Returns
    -------
    float32, 0..1.
    """
    _check("marschner-lobb", size, 4 * size)
    if not (math.isfinite(fm) and 0 <= alpha < math.inf):
        raise ValueError(f"marschner-lobb: fm {fm} is a number and alpha {alpha} one from 0 on")
    axis = np.linspace(-1, 1, size)
    distance = np.hypot(axis[:, None], axis)
    ripple = alpha * (1 + np.cos(2 * np.pi * fm * np.cos(np.pi * distance / 2)))
    wave = 1 - np.sin(np.pi * axis / 2)
    values = np.empty((size, size, size), np.float32)
    for z in range(size):
        values[z] = (wave[z] + ripple) / (2 * (1 + alpha))
    step = 2 / (size - 1)
    return Volume(values, np.full(3, step), np.full(3, -1.0), np.eye(3), "marschner-lobb")


def vessel_tree(size: int = 128, seed: int = 7) -> Volume:
    """Make branching, tapering vessels with an aneurysm: mostly empty, mostly thin.

    Parameters
    ----------
    size
        Voxels along each side.
    seed
        Seed of the random tree.

    Returns
    -------
    uint8: 0 outside, rising over two voxels of wall to 255 within; spacing 1, origin 0.
    """
    _check("vessel-tree", size, 4 * size)
    rng = np.random.default_rng(seed)
    bottom = np.array([0.5, 0.5, 0.04])
    capsules = list(_branch(rng, bottom, np.array([0.0, 0.0, 1.0]), 0.03))
    # The aneurysm: a ball at the side of a vessel, near the first fork.
    trunk = capsules[4]
    aside = _unit(np.cross(trunk.end - trunk.start, [0.0, 1.0, 0.0]))
    center = trunk.end + 1.9 * trunk.narrow * aside
    ball = 2.1 * trunk.narrow, 1.9 * trunk.narrow
    capsules.append(Capsule(center, center + 0.01 * aside, *ball))
    depth = np.full((size, size, size), -1, np.float32)
    for capsule in capsules:
        _rasterise(depth, capsule)
    rise = np.clip((depth + 1) / 2, 0, 1)  # the wall is where the depth is 0
    return Volume((255 * rise * rise * (3 - 2 * rise)).round().astype(np.uint8), name="vessel-tree")


GENERATED: dict[str, Callable[..., Volume]] = {
    "checker-box": checker_box,
    "marschner-lobb": marschner_lobb,
    "vessel-tree": vessel_tree,
}


def _branch(rng: np.random.Generator, start: Doubles, heading: Doubles, radius: float) -> Any:
    """Yield the capsules of a vessel and of all its branches."""
    for _ in range(int(rng.integers(3, 6))):
        toward_middle = 0.5 - start
        wander = rng.normal(0, 0.28, 3) + toward_middle * (np.abs(toward_middle).max() > 0.38)
        heading = _unit(heading + wander)
        end = np.clip(start + heading * (0.045 + 0.8 * radius), 0.03, 0.97)
        yield Capsule(start, end, radius, 0.97 * radius)
        start, radius = end, 0.97 * radius
    if radius < 0.005:
        return
    share = rng.uniform(0.35, 0.5)  # Murray's law: radius³ is divided
    aside = _unit(np.cross(heading, rng.normal(size=3)))
    for part, side in ((share, 1.2), (1 - share, -0.6)):
        yield from _branch(rng, start, _unit(heading + side * aside), radius * part ** (1 / 3))


def _rasterise(depth: Floats, capsule: Capsule) -> None:
    """Rasterise a capsule by maximum into `depth` (Z, Y, X), voxels below the surface."""
    size = len(depth)
    start, end = capsule.start * (size - 1), capsule.end * (size - 1)
    wide, narrow = capsule.wide * size, capsule.narrow * size
    low = np.maximum(np.floor(np.minimum(start, end) - wide - 1), 0).astype(int)
    high = np.minimum(np.ceil(np.maximum(start, end) + wide + 2), size).astype(int)
    x, y, z = np.ogrid[tuple(slice(a, b) for a, b in zip(low, high, strict=True))]
    axis = end - start
    offset = [coordinate - begin for coordinate, begin in zip((x, y, z), start, strict=True)]
    dot = sum(part * along for part, along in zip(offset, axis, strict=True))
    way = np.clip(dot / max(axis @ axis, 1e-9), 0, 1)  # a ball that does not move
    gap = [part - way * along for part, along in zip(offset, axis, strict=True)]
    inside = wide + way * (narrow - wide) - np.sqrt(sum(part * part for part in gap))
    box = depth[low[2] : high[2], low[1] : high[1], low[0] : high[0]]
    np.maximum(box, inside.T, out=box, casting="same_kind")


def _unit(vector: Doubles) -> Doubles:
    return vector / np.linalg.norm(vector)


def _check(name: str, size: int, bytes_per_line: int) -> None:
    if size < 2:
        raise ValueError(f"{name}: size is at least 2 voxels, not {size}")
    require_memory(size * size * bytes_per_line, name)


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
    unknown. Raises ValueError: the download differs from the collection's list. It is not kept.
    Raises OSError: the server cannot be reached, or refuses; or the folder cannot be written.
    """
    from resample.files.public import download, place_of

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
    return _header(place / f"{name}.nhdr", known[name], file)


def _header(path: Path, entry: dict[str, Any], file: str) -> Path:
    """Write a NRRD header beside a raw file, in one step."""
    text = NRRD.format(
        **entry,
        sizes=" ".join(map(str, entry["size"])),
        spacings=" ".join(map(str, entry["spacing"])),
        file=file,
    )
    with replacing(path) as temporary:
        temporary.write_text(text, "utf-8")
    return path
