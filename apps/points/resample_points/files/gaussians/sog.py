"""Read SOG, pictures with Gaussians as texels, in a folder or a zip file; write version 2.

Pictures are read byte by byte, with colors that are not multiplied by alpha.
"""

import json
import math
import zipfile
import zlib
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.files.images import open_file
from resample.messages import one_line
from resample.reading.limits import check_members, check_size, check_unpacked, neighbour
from resample.reading.texts import json_of
from resample.types import Doubles, Floats
from resample_points.data.gaussians import Gaussians
from resample_points.data.harmonics import COUNTS
from resample_points.files.gaussians.decoding import (
    ROOT,
    check_count,
    exponentials,
    palette_of,
    quaternions_of,
    sigmoids,
    three_of,
)

META = "meta.json"
FIRST_TAG = 252  # alpha of a quaternion with w as largest component
MOST = 1e30  # size of a number, which float32 holds
PER_ROW = 64  # entries of the palette of harmonics
LEVELS = 16  # halvings of Gaussians by their harmonics: a palette has up to 2 ** 16 entries
BOOK_STEPS = 20  # of k-means
PARTS = {"means": 2, "scales": 1, "quats": 1, "sh0": 1}  # pictures of each
Texels = NDArray[np.uint8]  # (N, 4)


class _Pictures:
    """The description of a scene, and the pictures with its Gaussians.

    `file`: gives the path of a picture by its name.
    """

    def __init__(self, text: bytes, file: Callable[[str], Path]) -> None:
        try:
            meta = json_of(text.decode("utf-8-sig"))
        except UnicodeDecodeError:
            raise ValueError(f"has a {META} that is not a text") from None
        if not is_description(meta):
            raise ValueError(f"has a {META} that is not of SOG: it must have {', '.join(PARTS)}")
        version, shape = meta.get("version", 1), meta["means"].get("shape")
        if version not in (1, 2):
            raise ValueError(f"has the SOG version {version!r:.40}; known are 1 and 2")
        count = meta.get("count", shape[0] if isinstance(shape, list) and shape else None)
        if not isinstance(count, int) or isinstance(count, bool):
            raise ValueError(
                f"has {count!r:.40} Gaussians; a {META} has a whole number as its count"
            )
        self.meta, self.file, self.is_second = meta, file, version == 2
        self.count = check_count(META, count)

    def described(self, part: str) -> dict[str, Any]:
        """Return the description of a part."""
        found: Any = self.meta[part]
        if not isinstance(found, dict):
            raise ValueError(f"has {part} that are not described")
        return found

    def numbers(self, part: str, key: str, count: int | None = None) -> Doubles:
        """Return numbers of the description, within float32's range."""
        given: Any = self.described(part).get(key)
        listed: list[Any] = given if isinstance(given, list) else [given]
        if listed[:1] == [None] and len(listed) > 2 and None not in listed[1:]:
            # Old writers leave out the first entry of a palette; extrapolate it linearly.
            listed = [listed[1] + (listed[1] - listed[-1]) / 255, *listed[1:]]
        is_right = all(isinstance(n, int | float) and abs(n) <= MOST for n in listed)
        if not is_right or (count is not None and len(listed) != count):
            raise ValueError(f"has {key} of {part} that are not {count or 'finite'} numbers")
        return np.array(listed, np.float64)

    def picture(self, part: str, n: int = 0) -> tuple[str, NDArray[np.uint8]]:
        """Return a picture's name and bytes (H, W, 4); alpha is 255 where it has none."""
        files = self.described(part).get("files")
        if not isinstance(files, list) or len(files) <= n or not isinstance(files[n], str):
            raise ValueError(f"names no picture {n + 1} of {part}")
        name: str = files[n]
        file = open_file(self.file(name))
        height, width, channels = file.shape
        if file.form != "uint8" or channels not in {3, 4}:
            raise ValueError(
                f"has the picture {name!r:.60} of {channels} channels of {file.form}; "
                "it must have 3 or 4 of uint8"
            )
        made, done = np.full((height, width, 4), 255, np.uint8), 0
        for strip in file.strips("uint8"):
            made[done : done + len(strip), :, :channels] = strip
            done += len(strip)
        return name, made

    def texels(self, part: str, n: int = 0) -> Texels:
        """Return the texels (N, 4) of a picture, one per Gaussian."""
        name, picture = self.picture(part, n)
        texels = picture.reshape(-1, 4)
        if len(texels) < self.count:
            raise ValueError(
                f"has {self.count} Gaussians, and {len(texels)} texels of them in {name!r:.60}"
            )
        return texels[: self.count]

    def decoded(self, part: str, texels: NDArray[np.uint8], ends: int) -> Floats:
        """Return numbers (..., K): between `ends` ends in version 1, of a palette in version 2."""
        if self.is_second:
            palette = self.numbers(part, "codebook")
            if texels.size and int(texels.max()) >= len(palette):
                raise ValueError(
                    f"has {part} of entry {texels.max()} of a codebook, which has {len(palette)}"
                )
            with np.errstate(over="ignore"):
                return palette.astype(np.float32)[texels]
        low, high = self.numbers(part, "mins", ends), self.numbers(part, "maxs", ends)
        tables = (low + (high - low) * np.arange(256)[:, None] / 255).astype(np.float32)
        return tables[texels, np.arange(texels.shape[-1]) % ends]


def read_sog(path: Path) -> Gaussians:
    """Read Gaussians of a folder's meta.json, or of a zip file."""
    if path.suffix.lower() == ".json":
        check_size(str(path), path.stat().st_size, "tree")
        return _gaussians(_Pictures(path.read_bytes(), lambda name: neighbour(path, name)))
    with TemporaryDirectory(prefix="resample-sog-") as folder:
        return _gaussians(_Pictures(*_unpacked(path, Path(folder))))


def _gaussians(scene: _Pictures) -> Gaussians:
    """Decode the pictures of a scene."""
    scale = exponentials(scene.decoded("scales", scene.texels("scales")[:, :3], 3))
    texels = scene.texels("sh0")
    if scene.is_second:
        color = scene.decoded("sh0", texels[:, :3], 4)
        opacity = texels[:, 3].astype(np.float32) / np.float32(255)
    else:
        both = scene.decoded("sh0", texels, 4)
        color, opacity = np.ascontiguousarray(both[:, :3]), sigmoids(both[:, 3])
    harmonics, step = _harmonics(scene)
    # Positions have 16 bits between ends, of sign(x) log(1 + |x|).
    lower, upper = scene.texels("means", 0), scene.texels("means", 1)
    low, high = scene.numbers("means", "mins", 3), scene.numbers("means", "maxs", 3)
    position = np.empty((scene.count, 3), np.float32)
    with np.errstate(over="ignore"):
        for axis in range(3):
            levels = lower[:, axis] + 256.0 * upper[:, axis]
            levels *= (high[axis] - low[axis]) / 65535
            levels += low[axis]
            position[:, axis] = np.copysign(np.expm1(np.abs(levels)), levels)
    # Quaternions are 0 where the tag of the largest component is unknown.
    texels = scene.texels("quats")
    three = (texels[:, :3].astype(np.float32) * np.float32(2 / 255) - 1) * ROOT
    return Gaussians(
        position=position,
        scale=scale,
        rotation=quaternions_of(three, texels[:, 3] - np.uint8(FIRST_TAG)),
        opacity=opacity,
        color=color,
        harmonics=harmonics,
        harmonic_step=step,
        is_antialiased=scene.meta.get("model") == "antialiased"
        or scene.meta.get("antialias") is True,
    )


def _unpacked(path: Path, folder: Path) -> tuple[bytes, Callable[[str], Path]]:
    """Return a zip file's description, and a function that unpacks its pictures to a folder."""
    try:
        with zipfile.ZipFile(path) as packed:
            members = {info.filename: info for info in packed.infolist()}
            if META not in members:
                raise ValueError(f"is a zip file without {META}, so it is not a SOG file")
            check_members(path.name, members.values(), "members")
            check_size(META, members[META].file_size, "tree")
            meta = packed.read(META)
    except (zipfile.BadZipFile, RuntimeError, EOFError, zlib.error, NotImplementedError) as error:
        raise OSError(f"{path} is damaged: {one_line(error):.200}") from None

    def unpack(name: str) -> Path:
        if name not in members:
            raise ValueError(f"names the picture {name!r:.60}, which is not in the file")
        info = members[name]
        check_unpacked(name, info.compress_size, info.file_size)
        ending = "".join(letter for letter in Path(name).suffix if letter.isalnum())[:8]
        target = folder / f"{len(list(folder.iterdir()))}.{ending}"
        try:
            with zipfile.ZipFile(path) as packed:
                target.write_bytes(packed.read(info))
        except (zipfile.BadZipFile, RuntimeError, EOFError, zlib.error) as error:
            raise OSError(f"{path} is damaged: {one_line(error):.200}") from None
        return target

    return meta, unpack


def is_description(meta: Any) -> bool:
    """Whether the content of a meta.json is of SOG."""
    return isinstance(meta, dict) and all(isinstance(meta.get(part), dict) for part in PARTS)


def _harmonics(scene: _Pictures) -> tuple[NDArray[np.int16], float]:
    """Return coefficients (N, K, 3) and their step; a Gaussian names an entry of a palette."""
    if scene.meta.get("shN") is None:
        return np.zeros((scene.count, 0, 3), np.int16), 1.0
    texels = scene.picture("shN", 0)[1][..., :3]
    width = texels.shape[1] // PER_ROW
    degree = COUNTS.index(width) if width in COUNTS else 0
    bands = scene.described("shN").get("bands", degree)
    if texels.shape[1] % PER_ROW or not degree or bands != degree:
        raise ValueError(
            f"has a palette of harmonics {texels.shape[1]} texels wide; degrees 1 to 3 have "
            f"{', '.join(str(PER_ROW * count) for count in COUNTS[1:])}"
        )
    palette, step = palette_of(scene.decoded("shN", texels, 1).reshape(-1, width, 3))
    both = scene.texels("shN", 1)[:, :2].astype(np.uint16)
    label = both[:, 0] + (both[:, 1] << np.uint16(8))
    if int(label.max()) >= len(palette):
        raise ValueError(f"has harmonics of entry {label.max()} of a palette of {len(palette)}")
    return palette[label], step


def sog_bytes(gaussians: Gaussians) -> Iterator[bytes]:
    """Yield the bytes of a zip file of version 2; neighbours should follow each other."""
    count, width = len(gaussians.opacity), gaussians.harmonics.shape[1]
    place = gaussians.position.astype(np.float64)
    logarithm = np.copysign(np.log1p(np.abs(place)), place)
    low, high = logarithm.min(axis=0), logarithm.max(axis=0)
    share = (logarithm - low) / np.maximum(high - low, 1e-30)
    level = np.rint(share * 65535).astype(np.uint16)
    three, largest = three_of(gaussians.rotation)
    quats = np.rint((np.clip(three / ROOT, -1, 1) + 1) * 127.5)
    scales, scale_book = _codebook(np.log(gaussians.scale))
    colors, color_book = _codebook(gaussians.color)
    opacity = np.rint(gaussians.opacity * 255)[:, None]
    pictures = {
        "means_l.webp": level & 255,
        "means_u.webp": level >> 8,
        "quats.webp": np.column_stack([quats, FIRST_TAG + largest]),
        "scales.webp": scales,
        "sh0.webp": np.column_stack([colors, opacity]),
    }
    meta = {
        "version": 2,
        "count": count,
        "antialias": gaussians.is_antialiased,
        "means": {"mins": low.tolist(), "maxs": high.tolist(), "files": [*pictures][:2]},
        "quats": {"files": ["quats.webp"]},
        "scales": {"codebook": scale_book, "files": ["scales.webp"]},
        "sh0": {"codebook": color_book, "files": ["sh0.webp"]},
    }
    made = {name: _webp(texels, _width_for(count)) for name, texels in pictures.items()}
    if width:
        label, palette = _palette(gaussians.harmonics * np.float32(gaussians.harmonic_step))
        entries, book = _codebook(palette)
        both = np.column_stack([label & 255, label >> 8])
        made["shN_labels.webp"] = _webp(both, _width_for(count))
        made["shN_centroids.webp"] = _webp(entries.reshape(-1, 3), PER_ROW * width)
        files = ["shN_centroids.webp", "shN_labels.webp"]
        bands = COUNTS.index(width)
        meta["shN"] = {"count": len(palette), "bands": bands, "codebook": book, "files": files}
    whole = BytesIO()
    with zipfile.ZipFile(whole, "w", zipfile.ZIP_STORED) as packed:
        packed.writestr(META, json.dumps(meta))
        for name, data in made.items():
            packed.writestr(name, data)
    yield whole.getvalue()


def _width_for(count: int) -> int:
    """Return the width of a picture of some texels, about as wide as high."""
    return 4 * max(1, round(math.sqrt(count) / 4))


def _webp(texels: NDArray[Any], width: int) -> bytes:
    """Return a picture of texels (N, 2 to 4), in rows of a width, without loss."""
    from PIL import Image

    count, channels = texels.shape
    data = np.zeros((-(-count // width) * width, max(channels, 3)), np.uint8)
    data[:count, :channels] = texels
    file = BytesIO()
    picture = Image.fromarray(data.reshape(-1, width, data.shape[1]))
    picture.save(file, "WEBP", lossless=True, exact=True, method=4)
    return file.getvalue()


def _codebook(values: Floats) -> tuple[NDArray[np.uint8], list[float]]:
    """Return the index of the nearest of 256 numbers for each value, and the numbers (k-means).

    The numbers are ascending; they begin as quantiles of the values' ranks and of their range.
    """
    flat = np.sort(values.ravel().astype(np.float64))
    sums = np.concatenate([[0.0], np.cumsum(flat)])
    ranks = flat[np.linspace(0, len(flat) - 1, 256).round().astype(np.int64)]
    book = np.sort(0.5 * (ranks + np.linspace(flat[0], flat[-1], 256)))
    for _ in range(BOOK_STEPS):
        ends = np.searchsorted(flat, 0.5 * (book[1:] + book[:-1]))
        first, last = np.concatenate([[0], ends]), np.concatenate([ends, [len(flat)]])
        many = np.maximum(last - first, 1)
        book = np.where(last > first, (sums[last] - sums[first]) / many, book)
    entry = np.searchsorted(0.5 * (book[1:] + book[:-1]), values)
    return entry.astype(np.uint8), book.tolist()


def _palette(harmonics: Floats) -> tuple[NDArray[np.int64], Floats]:
    """Return entries (N,) of a palette, and the palette (K, W, 3) of at most 65,536 entries.

    All are split at the mean of the coefficient that differs most, time and again.
    """
    flat = harmonics.reshape(len(harmonics), -1)
    group = np.zeros(len(flat), np.int64)
    for _ in range(LEVELS):
        order = np.argsort(group, kind="stable")
        first = np.flatnonzero(np.diff(group[order], prepend=-1))
        many = np.diff(np.append(first, len(flat)))[:, None]
        mean = np.add.reduceat(flat[order], first, axis=0) / many
        number = np.repeat(np.arange(len(first)), many[:, 0])
        apart = np.add.reduceat((flat[order] - mean[number]) ** 2, first, axis=0)
        axis = apart.argmax(axis=1)
        value = flat[order, axis[number]]
        group[order] = 2 * number + (value > mean[number, axis[number]])
    _, label = np.unique(group, return_inverse=True)
    sums = np.zeros((label.max() + 1, flat.shape[1]))
    np.add.at(sums, label, flat)
    palette = sums / np.bincount(label)[:, None]
    return label, palette.astype(np.float32).reshape(-1, *harmonics.shape[1:])
