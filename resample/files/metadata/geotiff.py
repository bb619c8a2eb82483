"""Georeference of pictures in GeoTIFF tags, also after a warp.

Tags only: coordinate systems are copied without being interpreted.
"""

import re
from typing import NamedTuple

import numpy as np

from resample.files.metadata.tags import DOUBLE, Directory, Tag, text, text_tag
from resample.types import Doubles

SCALE, POINTS, MATRIX, KEYS, NUMBERS, WORDS = 33550, 33922, 34264, 34735, 34736, 34737
FACTS, NODATA, SATELLITE = 42112, 42113, 50844  # GDAL's, and coefficients of a satellite camera
TAGS = (SCALE, POINTS, MATRIX, KEYS, NUMBERS, WORDS, FACTS, NODATA, SATELLITE)
RASTER_TYPE, PIXEL_IS_POINT = 1025, 2  # a key, and its value for coordinates of pixel centers
STATISTICS = re.compile(r"\s*<Item[^>]*\bSTATISTICS_[^>]*>[^<]*</Item>")
STRAIGHT = 1e-12  # fraction of a matrix's largest number below which a rotation counts as 0


class Geo(NamedTuple):
    """Georeference of a picture."""

    matrix: Doubles | None  # (4, 4) of (x, y, z, 1), px from the corner, to Earth coordinates
    points: Doubles | None  # (n, 6) tie points: x, y, z in the picture and on Earth
    words: Directory  # tags that are copied
    nodata: str  # text of the value for missing data; empty if there is none
    is_point: bool  # coordinates start at the first pixel's center

    @property
    def has_place(self) -> bool:
        """Whether the picture is georeferenced."""
        return self.matrix is not None or self.points is not None

    @property
    def missing(self) -> float | None:
        """Value for missing data."""
        try:
            return float(self.nodata) if self.nodata else None
        except ValueError:
            return None


def geo_of(tags: Directory) -> Geo | None:
    """Parse georeference and missing value from tags; None if there are none."""
    if not set(TAGS) & set(tags):
        return None
    keys = _numbers(tags, KEYS).astype(int)
    types = [keys[n + 3] for n in range(4, len(keys) - 3, 4) if keys[n] == RASTER_TYPE]
    is_point = types[:1] == [PIXEL_IS_POINT]
    matrix, points = _matrix(tags), None
    given = _numbers(tags, POINTS)
    if matrix is None and given.size >= 6:
        points = given[: given.size // 6 * 6].reshape(-1, 6).copy()
        points[:, :2] += 0.5 * is_point
    elif matrix is not None and is_point:
        matrix = matrix @ _shift(-0.5)
    words = {tag: tags[tag] for tag in (KEYS, NUMBERS, WORDS) if tag in tags}
    facts = STATISTICS.sub("", text(tags.get(FACTS)))
    if "<Item" in facts:
        words[FACTS] = text_tag(facts)
    return Geo(matrix, points, words, text(tags.get(NODATA)), is_point)


def moved(geo: Geo, matrix: Doubles) -> Geo:
    """Georeference of a warped picture.

    `matrix`: (3, 3) homography from source to target, px from the corners. Result: georeference of
    the target. It is lost if `matrix` is not affine, except for tie points, which are mapped
    exactly.
    """
    bare = matrix / matrix[2, 2] if matrix[2, 2] else matrix
    if geo.points is not None:
        points = geo.points.copy()
        there = np.column_stack([points[:, :2], np.ones(len(points))]) @ bare.T
        points[:, :2] = there[:, :2] / there[:, 2:]
        return geo._replace(points=points)
    if geo.matrix is None or not is_affine(matrix):
        return unplaced(geo)
    full = np.eye(4)
    full[:2, :2], full[:2, 3] = bare[:2, :2], bare[:2, 2]
    return geo._replace(matrix=geo.matrix @ np.linalg.inv(full))


def is_affine(matrix: Doubles) -> bool:
    """Whether a homography (3, 3) maps parallels to parallels."""
    return bool(matrix[2, 2] != 0.0 and (matrix[2, :2] == 0.0).all())


def unplaced(geo: Geo) -> Geo:
    """Copy without the georeference, but with the missing value."""
    words = {tag: value for tag, value in geo.words.items() if tag == FACTS}
    return geo._replace(matrix=None, points=None, words=words)


def tags_of(geo: Geo) -> Directory:
    """Tags for a georeference."""
    tags = dict(geo.words)
    if geo.nodata:
        tags[NODATA] = text_tag(geo.nodata)
    if geo.points is not None:
        points = geo.points.copy()
        points[:, :2] -= 0.5 * geo.is_point
        tags[POINTS] = _tag(points)
    if geo.matrix is not None:
        tags.update(_placement(geo.matrix @ _shift(0.5) if geo.is_point else geo.matrix))
    return tags


def _matrix(tags: Directory) -> Doubles | None:
    """Matrix (4, 4) from either form; None if there is none."""
    given = _numbers(tags, MATRIX)
    if given.size == 16:
        return np.asarray(given.reshape(4, 4), np.float64)
    scale, point = _numbers(tags, SCALE), _numbers(tags, POINTS)
    if scale.size < 2 or point.size < 6:
        return None
    x, y, z = scale[0], -scale[1], scale[2] if scale.size > 2 else 0.0
    matrix = np.diag([x, y, z, 1.0])
    matrix[:3, 3] = point[3:6] - np.array([x, y, z]) * point[:3]
    return matrix


def _placement(matrix: Doubles) -> Directory:
    """Scale and tie point if there is no rotation, else the matrix."""
    plane = matrix[:2, :2]
    is_turned = np.abs([plane[0, 1], plane[1, 0]]).max() > STRAIGHT * np.abs(plane).max()
    others = (matrix[:2, 2], matrix[2, :2], matrix[3])
    is_flat = all((part[:3] == 0.0).all() for part in others)
    if is_turned or not is_flat or plane[0, 0] <= 0.0 or plane[1, 1] >= 0.0:
        return {MATRIX: _tag(matrix)}
    scale = np.array([plane[0, 0], -plane[1, 1], matrix[2, 2]])
    return {SCALE: _tag(scale), POINTS: _tag(np.concatenate([np.zeros(3), matrix[:3, 3]]))}


def _tag(numbers: Doubles) -> Tag:
    return Tag(DOUBLE, np.asarray(numbers, np.float64).ravel())


def _numbers(tags: Directory, name: int) -> Doubles:
    tag = tags.get(name)
    return np.asarray(tag.values, np.float64) if isinstance(tag, Tag) else np.zeros(0)


def _shift(distance: float) -> Doubles:
    """Matrix (4, 4) that adds a distance to x and y."""
    matrix = np.eye(4)
    matrix[:2, 3] = distance
    return matrix
