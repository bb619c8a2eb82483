"""Coordinate systems of laser scans, from their WKT or GeoTIFF keys, as tags of a GeoTIFF.

LAS 1.4 takes both over as they are in OGC's WKT and GeoTIFF 1.0; only EPSG's codes are read.
"""

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from resample.files.metadata.tags import ASCII, DOUBLE, KEYS, NUMBERS, SHORT, WORDS, Directory, Tag
from resample_points.files.las import records_of

OWNER, WKT = "LASF_Projection", 2112
MODEL, RASTER, GEOGRAPHIC, PROJECTED, VERTICAL = 1024, 1025, 2048, 3072, 4096  # GeoTIFF keys
IS_PROJECTED, IS_GEOGRAPHIC, IS_AREA = 1, 2, 1  # values of the first two
NAME = re.compile(r'\w+\s*\[\s*"([^"]*)"')
CODE = re.compile(r'"EPSG"\s*,\s*"?(\d+)"?\s*\]\s*\]$')  # of the whole, not of a part
PARTS = {  # of WKT 1 and 2, by the key that has their code
    PROJECTED: re.compile(r"\bPROJ(?:CS|CRS|ECTEDCRS)\s*\["),
    GEOGRAPHIC: re.compile(r"\bGEO(?:GCS|GCRS|GRAPHICCRS|DCRS|DETICCRS)\s*\["),
    VERTICAL: re.compile(r"\bVERT(?:_CS|CRS|ICALCRS)\s*\["),
}


class CoordinateSystem(NamedTuple):
    """Coordinate system of a file."""

    name: str  # for people
    is_geographic: bool  # x and y are degrees
    tags: Directory  # of a GeoTIFF; empty if it has no code of EPSG


def coordinate_system_of(path: Path) -> CoordinateSystem | None:
    """Read the coordinate system of a LAS or LAZ file; None if it says nothing."""
    held = records_of(path, OWNER)
    if WKT in held:
        return _of_wkt(held[WKT].decode("utf-8", "replace").strip("\0 "))
    shorts = np.frombuffer(held.get(KEYS, b"")[: len(held.get(KEYS, b"")) // 8 * 8], "<u2")
    entries = shorts.reshape(-1, 4)[1:]
    known = dict(entries[:, [0, 3]].tolist())
    code = next((known[key] for key in (PROJECTED, GEOGRAPHIC) if key in known), None)
    if code is None:
        return None
    rest = [entry for entry in entries.tolist() if entry[0] != RASTER]
    tags: dict[int, Tag | Directory] = {KEYS: _keys(rest)}
    numbers, words = held.get(NUMBERS, b""), held.get(WORDS, b"")
    if len(numbers) >= 8:
        tags[NUMBERS] = Tag(DOUBLE, np.frombuffer(numbers[: len(numbers) // 8 * 8], "<f8"))
    if words:
        tags[WORDS] = Tag(ASCII, np.frombuffer(words, np.uint8))
    return CoordinateSystem(f"EPSG:{code}", PROJECTED not in known, tags)


def _of_wkt(text: str) -> CoordinateSystem:
    """Read a system's name and the codes of its horizontal and vertical parts."""
    name, code = NAME.match(text), CODE.search(text)
    told = f"{name[1] if name else text:.80}" + (f" (EPSG:{code[1]})" if code else "")
    found = {
        key: _code_of(text, begin.start())
        for key, part in PARTS.items()
        if (begin := part.search(text))
    }
    is_projected = PROJECTED in found
    code_of_place = found.get(PROJECTED if is_projected else GEOGRAPHIC)
    if code_of_place is None:
        return CoordinateSystem(told, not is_projected, {})
    kept = {MODEL: IS_PROJECTED if is_projected else IS_GEOGRAPHIC}
    kept[PROJECTED if is_projected else GEOGRAPHIC] = code_of_place
    if found.get(VERTICAL) is not None:
        kept[VERTICAL] = found[VERTICAL] or 0
    tags = {KEYS: _keys([[key, 0, 1, value] for key, value in kept.items()])}
    return CoordinateSystem(told, not is_projected, tags)


def _code_of(text: str, begin: int) -> int | None:
    """Return EPSG's code of the part of a WKT that begins at a place."""
    depth = 0
    for place in range(begin, len(text)):
        depth += (text[place] == "[") - (text[place] == "]")
        if depth == 0 and text[place] == "]":
            code = CODE.search(text, begin, place + 1)
            return int(code[1]) if code and int(code[1]) < 1 << 16 else None
    return None


def _keys(entries: list[list[int]]) -> Tag:
    """Return GeoTIFF's directory of keys, with the one that says that values are of areas."""
    whole = sorted([*entries, [RASTER, 0, 1, IS_AREA]])
    return Tag(SHORT, np.array([[1, 1, 0, len(whole)], *whole], np.uint16).ravel())
