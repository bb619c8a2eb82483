"""Pictures too large for memory as floats: kept as stored, warped in strips."""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from math import prod
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from resample.colors import to_srgb
from resample.files.facts.metadata import FileMetadata
from resample.files.formats import WriteOptions, holds_missing, takes_alpha
from resample.files.pictures import Kind, LoadablePicture, LoadedPicture, Picture, loadable_picture
from resample.files.stores.opening import Place
from resample.memory import ALLOWED, GIB
from resample.types import Floats
from resample_texture.arguments import method_named, within
from resample_texture.command.choices import PictureWarping
from resample_texture.command.inputs import Aim, PictureTarget
from resample_texture.command.rendering import (
    BYTES_IN_STRIP,
    WHOLE,
    as_light,
    bytes_at_once,
    covers_all,
    curved,
    finished,
    placed,
)
from resample_texture.drawing import Drawing, DrawnParts, drawn, parts_of
from resample_texture.geometry.mappings import BackwardMap, ForwardMap, Homography
from resample_texture.geometry.windows import Rect, windows_of
from resample_texture.types import AnyLight, Edge, Warped

MOST_AT_ONCE = 1 << 30  # bytes that a warp of the whole picture may take
MOST_IN_STRIP, LEAST_IN_STRIP = 1 << 24, 1 << 22  # target values per strip
SHARE_OF_STRIP = 8  # a strip takes 1 / 8 of what --memory allows
WHOLE_PICTURE = 1 << 62  # px of a window
ROWS = 32  # strips have a multiple of this, so that files keep their blocks

Roi = tuple[int, int, int, int]  # left, top, width and height, px


class Destination(NamedTuple):
    """Output file of a large picture, and its format."""

    path: Path
    options: WriteOptions


def large_picture(
    path: Place, aim: Aim, choice: PictureWarping, roi: Roi | None, written: Destination
) -> "Large | None":
    """Return a large picture to warp strip by strip; None if it is small or cannot be."""
    form = loadable_picture(path, choice.encoding)
    if form is None or choice.total:
        return None
    target = aim(form.shape[:2])
    shape = target.shape if roi is None else (roi[3], roi[2])
    is_small = bytes_at_once(form.shape, shape) <= min(
        MOST_AT_ONCE, (ALLOWED.get() or GIB * 2) // 2
    )
    if is_small or target.draws is not None or isinstance(target.places, ForwardMap):
        return None
    method = method_named(choice.method, **choice.sampling)
    whole = (0, 0, target.shape[1], target.shape[0])
    large = Large(form, target, choice, method, roi or whole, written)
    return None if large.parts is None else large


@dataclass(frozen=True, eq=False)
class Large:
    """A large picture and its warp.

    `form`: the picture, which can be kept as stored. `target`: geometry and size of the target.
    `choice`, `method`: options of the warp, and the method that they name. `roi`: part of the
    target to make. `written`: output file and format.
    """

    form: LoadablePicture
    target: PictureTarget
    choice: PictureWarping
    method: Any  # a `Method` that may have `visible_tiles`
    roi: Roi
    written: Destination

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the result, px."""
        return self.roi[3], self.roi[2]

    @cached_property
    def parts(self) -> DrawnParts | None:
        """Parts of the whole target, or of its first strip: with maps all strips are alike.

        None if parts of the target cannot be drawn from parts of the source.
        """
        is_plane = isinstance(self.target.places, Homography)
        rows = (0, self.roi[3]) if is_plane else next(self._rows())
        return parts_of(self.form, self._drawing(*rows)[0])

    def _drawing(self, first: int, count: int) -> tuple[Drawing, tuple[slice, slice]]:
        """Return the drawing for a strip of rows, and the part of it that they take."""
        choice, (geometry, shape, part) = self.choice, self._part(first, count)
        drawing = Drawing(self.method, geometry, shape, choice.edge, choice.threads, as_light=True)
        return drawing, part

    @cached_property
    def most(self) -> int:
        """Target values per strip: more values read less of the source twice."""
        of_memory = (ALLOWED.get() or sys.maxsize) // (SHARE_OF_STRIP * BYTES_IN_STRIP)
        most = min(MOST_IN_STRIP, max(LEAST_IN_STRIP, of_memory))
        return min(most, (self.form.shape[2] + 1) * prod(self.shape))

    @property
    def in_strips(self) -> tuple[int, int]:
        """Bytes of the picture as stored, and values that are drawn at a time."""
        return self.form.size, max(self.most, LEAST_IN_STRIP)

    @cached_property
    def loaded(self) -> LoadedPicture:
        """The stored picture; sRGB-encoded if encoded values are warped."""
        loaded = self.form.load(self._source_rect.part)
        if self._is_curved and not loaded.has_levels:
            for first in range(0, len(loaded.data), ROWS):
                rows = loaded.data[first : first + ROWS]
                rows[...] = curved(Picture(rows, loaded.kind), to_srgb)
        return loaded

    @property
    def _source_rect(self) -> Rect:
        """Part of the source that the target shows."""
        size = self.form.shape[:2]
        if self.parts is not None and self.parts.mixed is not None:
            return Rect(0, 0, size[1], size[0])
        return Rect.around([self.bounds(first, count) for first, count in self._rows()], size)

    def bounds(self, first: int, count: int) -> Rect:
        """Return the part of the source, continued beyond its edges, that a strip shows."""
        size = self.form.shape[:2]
        geometry, shape, _ = self._part(first, count)
        seen = self.method.visible_tiles(size, geometry, shape, Edge(self.choice.edge))
        return next(windows_of(seen, size, WHOLE_PICTURE)).source

    @cached_property
    def kind(self) -> Kind:
        """Kind of the result: with transparency unless every pixel shows the picture."""
        kind = self.loaded.kind
        is_closed = kind.has_alpha or self.choice.edge != "transparent" or self.keeps_gaps
        is_closed = is_closed or not takes_alpha(*self.written)
        return (
            kind if is_closed or self._is_whole else kind._replace(channels=(*kind.channels, "A"))
        )

    @cached_property
    def about(self) -> FileMetadata:
        """Metadata of the result."""
        about = self.loaded.about
        return about._replace(geo=placed(about.geo, self.target, self.roi))

    @cached_property
    def keeps_gaps(self) -> bool:
        """Whether uncovered pixels are marked as missing, if the file format can do that."""
        loaded, (path, look) = self.loaded, self.written
        return holds_missing(path, loaded.kind, loaded.about, look, has_nans=loaded.has_nans)

    @property
    def _is_curved(self) -> bool:
        """Whether encoded values are warped, not linear light."""
        return self.form.is_encoded and not self.choice.linear

    @cached_property
    def _is_whole(self) -> bool:
        """Whether every pixel shows the picture and nothing else."""
        if self.loaded.has_gaps:
            rows = self._rows()
            return all((self._drawn(*some).coverage >= WHOLE).all() for some in rows)
        if isinstance(self.target.places, Homography):
            return covers_all(self.target, self.form.shape[:2], self.roi)
        return all(self._covers_all(first, count) for first, count in self._rows())

    def _covers_all(self, first: int, count: int) -> bool:
        """Whether all pixels of rows of a map show the picture and nothing else."""
        geometry, shape, _ = self._part(first, count)
        assert isinstance(geometry, BackwardMap)
        if not np.isfinite(geometry.x + geometry.y).all():
            return False
        height, width, _ = self.form.shape
        seen = self.method.visible_tiles((height, width), geometry, shape, Edge.TRANSPARENT)
        low, high = seen.bounds[:, :2].min(axis=0), seen.bounds[:, 2:].max(axis=0)
        return bool((low >= 0.0).all() and high[0] <= width and high[1] <= height)

    def _rows(self) -> Iterator[tuple[int, int]]:
        """Yield the first row of each strip, and its number of rows."""
        height, width = self.shape
        most = self.most // ((self.form.shape[2] + 1) * width)
        count = max(ROWS, most // ROWS * ROWS)
        yield from ((first, min(count, height - first)) for first in range(0, height, count))

    def _part(
        self, first: int, count: int
    ) -> tuple[Homography | ForwardMap | BackwardMap, tuple[int, int], tuple[slice, slice]]:
        """Return geometry, shape and part of a strip of rows."""
        left, top, width, _ = self.roi
        roi = (left, top + first, width, count)
        return within(self.target.places, self.target.shape, roi, self.method)

    def strips(self) -> Iterator[tuple[int, tuple[Picture, Floats]]]:
        """Yield first row, picture and coverage of each strip, from the top."""
        for first, count in self._rows():
            yield first, self.paint(first, count)

    def paint(self, first: int, count: int) -> tuple[Picture, Floats]:
        """Return picture and coverage of a strip of rows."""
        image, coverage = self._drawn(first, count)
        gaps = {"keeps_gaps": self.keeps_gaps, "is_whole": not self.kind.has_alpha}
        gaps["adds_alpha"] = takes_alpha(*self.written)
        made = finished(image, coverage, self.loaded.kind, self.choice, **gaps)
        made = as_light(made) if self._is_curved else made
        return made._replace(about=self.about), coverage

    def _drawn(self, first: int, count: int) -> Warped:
        """Return a strip in linear light, and its coverage."""
        loaded, choice = self.loaded, self.choice
        drawing, part = self._drawing(first, count)
        drawing = drawing._replace(has_gaps=loaded.has_gaps)
        light: AnyLight = "pixels" if choice.linear and loaded.kind.is_encoded else False
        image, coverage = drawn(loaded.data, drawing, linear_light=light, alpha=None)
        return Warped(image[part], coverage[part])
