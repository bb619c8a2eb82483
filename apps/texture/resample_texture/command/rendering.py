"""Warp a picture for the command line, or fly over it, in linear light or as encoded.

Pictures too large for memory as floats are kept as stored, and warped in strips.
"""

import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import cached_property
from math import prod
from pathlib import Path
from typing import Any, Literal

import numpy as np

from resample.cameras.models import AnyCamera, Camera
from resample.cameras.poses import look_at
from resample.colors import from_srgb, to_srgb
from resample.command.session import OTHERS, Session, bytes_written, libraries
from resample.files import pictures
from resample.files.animations import Levels, Shots, check_count, fingerprint
from resample.files.formats import WriteOptions, holds_missing, takes_alpha
from resample.files.metadata.fields import FileMetadata
from resample.files.metadata.tags import Geo, moved, unplaced
from resample.files.pictures import Kind, LoadablePicture, LoadedPicture, Picture, loadable_picture
from resample.files.saving import screen_levels
from resample.files.stores import Place
from resample.memory import ALLOWED, GIB, require
from resample.memory.mapped import pages_of
from resample.types import Floats
from resample_texture.arguments import method_named, within
from resample_texture.command.choices import Aim, PictureTarget, PictureWarping
from resample_texture.drawing import Drawing, DrawnParts, drawn, parts_of
from resample_texture.geometry.mappings import BackwardMap, ForwardMap, Homography
from resample_texture.geometry.regions import Rect, windows_of
from resample_texture.types import AnyLight, Edge, Method, Warped
from resample_texture.warping import warp

WHOLE = 1.0 - 1e-3  # coverage that counts as complete; float32 sums are off by 1e-4
BYTES_PER_VALUE = 16  # of a target, including the copies made while warping and writing
# Measured as the peak of fresh processes (`python -m benchmarks.memory`).
BYTES_PER_TEXEL = 6  # per texel and channel: the source and its decoding buffers
BYTES_IN_STRIP = 28  # per value of the strip of a large picture that is being drawn
BYTES_OF_FILM = 56, 60  # per texel of the picture, in levels and light, and per pixel of a frame
REMEDY = "take a smaller size, or a part of it by --roi"
MOST_AT_ONCE = 1 << 30  # bytes that a warp of the whole picture may take
MOST_IN_STRIP, LEAST_IN_STRIP = 1 << 24, 1 << 22  # target values per strip
SHARE_OF_STRIP = 8  # a strip takes 1 / 8 of what --memory allows
WHOLE_PICTURE = 1 << 62  # px of a window
ROWS = 32  # strips have a multiple of this, so that files keep their blocks
FOV = 50.0  # degrees along the frame's shorter side

Roi = tuple[int, int, int, int]  # left, top, width and height, px


def warped(
    session: Session,
    picture: Picture,
    target: PictureTarget,
    choice: PictureWarping,
    roi: tuple[int, int, int, int] | None = None,
    *,
    keeps_gaps: bool = False,
    adds_alpha: bool = True,
    bar: str | None = "warping",
) -> tuple[Picture, Floats]:
    """Return the warped picture and the coverage of its pixels; see `finished`."""
    as_encoded = picture.kind.is_encoded and (choice.total or not choice.linear)
    source = curved(picture, to_srgb) if as_encoded else picture.data
    filtering: dict[str, Any] = {
        **choice.sampling,
        "method": choice.method,
        "fill": "premultiplied",
        "axis": -1,
        "linear_light": "pixels" if picture.kind.is_encoded and not as_encoded else None,
        "threads": choice.threads,
    }
    with session.stage("warp", bar=bar):
        if target.draws is not None:
            image, coverage = target.draws(source, **filtering)
        else:
            place: dict[str, Any] = {"edge": choice.edge, "total": choice.total or None, "roi": roi}
            image, coverage = warp(source, target.geometry, target.shape, **filtering, **place)
    is_whole = bool((coverage >= WHOLE).all())
    gaps = {"keeps_gaps": keeps_gaps, "is_whole": is_whole, "adds_alpha": adds_alpha}
    result = finished(image, coverage, picture.kind, choice, **gaps)
    if as_encoded:
        result = result._replace(data=curved(result, from_srgb))
    about = picture.about._replace(geo=placed(picture.about.geo, target, roi))
    return result._replace(about=about), coverage


def finished(
    image: Floats, coverage: Floats, kind: Kind, choice: PictureWarping, *, keeps_gaps: bool,
    is_whole: bool, adds_alpha: bool = True,
) -> Picture:  # fmt: skip
    """Mark uncovered pixels by alpha, if `adds_alpha`, or NaN, if `keeps_gaps`; else black."""
    if kind.has_alpha or choice.total:
        return Picture(image, kind)
    if not (keeps_gaps or (choice.edge == "transparent" and adds_alpha)):
        return Picture(image, kind)
    if is_whole or keeps_gaps:
        share = coverage[..., None]
        mean = np.divide(image, share, out=np.full_like(image, np.nan), where=share >= 0.5)
        return Picture(mean, kind)
    opaque = kind._replace(channels=(*kind.channels, "A"))
    data = np.concatenate([image, coverage[..., None]], axis=2, dtype=np.float32)
    return Picture(data, opaque)


def placed(
    geo: Geo | None, target: PictureTarget, roi: tuple[int, int, int, int] | None
) -> Geo | None:
    """Return the georeference of a warped picture, if known."""
    if geo is None or not geo.has_place:
        return geo
    there = unplaced(geo)
    if target.draws is None and isinstance(target.geometry, Homography):
        left, top = (0, 0) if roi is None else roi[:2]
        part = np.array([[1.0, 0.0, -left], [0.0, 1.0, -top], [0.0, 0.0, 1.0]])
        there = moved(geo, part @ target.geometry.matrix)
    return there


def curved(picture: Picture, curve: Callable[[Floats], Floats]) -> Floats:
    """Apply a curve to the straight color of premultiplied values."""
    data = picture.data
    if not picture.kind.has_alpha:
        return np.ascontiguousarray(curve(data))
    alpha = data[..., -1:]
    color = np.divide(data[..., :-1], alpha, out=np.zeros_like(data[..., :-1]), where=alpha > 0.0)
    return np.concatenate([curve(color) * alpha, alpha], axis=2, dtype=np.float32)


def check_memory(
    form: tuple[int, int, int],
    shape: tuple[int, int],
    choice: PictureWarping,
    output: Path,
    *,
    has_alpha: bool = False,
    in_strips: tuple[int, int] | None = None,  # bytes of a stored source, and values at a time
) -> None:
    """Reject a warp to (height, width) that does not fit into memory, or log its need (DEBUG)."""
    height, width = shape
    what = f"a picture of {width} x {height} pixels"
    if in_strips is not None:
        stored, strip = in_strips
        parts = {"the source": pages_of(stored) or stored, "a strip": BYTES_IN_STRIP * strip}
    else:
        opens = choice.edge == "transparent" and not (has_alpha or choice.total)
        values = form[2] + opens
        parts = {
            "the source": BYTES_PER_TEXEL * prod(form),
            "the result": values * bytes_written(shape, output),
        }
    compiles = getattr(method_named(choice.method), "compiles", True)
    require(what, {"libraries": libraries() if compiles else OTHERS, **parts}, REMEDY)


def large_picture(
    path: Place,
    aim: Aim,
    choice: PictureWarping,
    roi: Roi | None,
    written: tuple[Path, WriteOptions],
) -> "Large | None":
    """Return a large picture to warp strip by strip; None if it is small or cannot be."""
    form = loadable_picture(path, choice.encoding)
    if form is None or choice.total:
        return None
    target = aim(form.shape[:2])
    shape = target.shape if roi is None else (roi[3], roi[2])
    height, width, channels = form.shape
    needed = pictures.BYTES_PER_VALUE * height * width + BYTES_PER_VALUE * prod(shape)
    is_small = channels * needed <= min(MOST_AT_ONCE, (ALLOWED.get() or GIB * 2) // 2)
    if is_small or target.draws is not None or isinstance(target.places, ForwardMap):
        return None
    method = method_named(choice.method, **choice.sampling)
    whole = (0, 0, target.shape[1], target.shape[0])
    large = Large(form, target, choice, method, roi or whole, written)
    return None if large.parts is None else large


@dataclass(frozen=True, eq=False)
class Large:
    """A large picture and its warp."""

    form: LoadablePicture  # which can be kept as stored
    target: PictureTarget
    choice: PictureWarping
    method: Any  # that `choice` names, a `Method` that may have `visible_tiles`
    roi: Roi  # part of the target to make
    written: tuple[Path, WriteOptions]

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the result, px."""
        return self.roi[3], self.roi[2]

    @cached_property
    def parts(self) -> DrawnParts | None:
        """Parts of the target, or of a map's first strip; None if it is not drawn in parts."""
        is_plane = isinstance(self.target.places, Homography)
        rows = (0, self.roi[3]) if is_plane else next(self._rows())
        return parts_of(self.form, self._drawing(*rows)[0])

    def _drawing(self, first: int, count: int) -> tuple[Drawing, tuple[slice, slice]]:
        """Return the drawing for a strip of rows, and their part of it."""
        left, top, width, _ = self.roi
        roi, choice = (left, top + first, width, count), self.choice
        geometry, shape, part = within(self.target.places, self.target.shape, roi, self.method)
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
        """The visible part of the picture; sRGB-encoded if encoded values are warped."""
        size = self.form.shape[:2]
        seen = Rect(0, 0, size[1], size[0])
        if self.parts is None or self.parts.mixed is None:
            parts, edge = [], Edge(self.choice.edge)
            for rows in self._rows():  # continued beyond the source's edges
                drawing, _ = self._drawing(*rows)
                tiles = self.method.visible_tiles(size, drawing.geometry, drawing.shape, edge)
                parts.append(next(windows_of(tiles, size, WHOLE_PICTURE)).source)
            seen = Rect.around(parts, size)
        loaded = self.form.load(seen.part)
        if self._is_curved and not loaded.has_levels:
            for first in range(0, len(loaded.data), ROWS):
                part = loaded.data[first : first + ROWS]
                part[...] = curved(Picture(part, loaded.kind), to_srgb)
        return loaded

    @cached_property
    def kind(self) -> Kind:
        """Kind of the result: with transparency unless every pixel shows the picture."""
        kind = self.loaded.kind
        is_open = self.choice.edge == "transparent" and takes_alpha(*self.written)
        if kind.has_alpha or not is_open or self.keeps_gaps:
            return kind
        if self.loaded.has_gaps:
            strips = (self._drawn(*rows).coverage for rows in self._rows())
            is_whole = all((coverage >= WHOLE).all() for coverage in strips)
        elif isinstance(self.target.places, Homography):
            (height, width, _), (left, top, across, down) = self.form.shape, self.roi
            x, y = np.array([left, left + across] * 2), np.array([top] * 2 + [top + down] * 2)
            matrix = self.target.places.oriented((height, width))
            u, v, w = np.linalg.inv(matrix) @ np.stack([x, y, np.ones(4)])
            with np.errstate(divide="ignore", invalid="ignore"):
                far = np.abs(u / w - width / 2).max(), np.abs(v / w - height / 2).max()
            # Places of float32 may be off by a thousandth of a px.
            is_in = far[0] <= width / 2 + 1e-3 and far[1] <= height / 2 + 1e-3
            is_whole = bool((w > 0.0).all() and is_in)
        else:
            is_whole = all(self._covers_all(*rows) for rows in self._rows())
        return kind if is_whole else kind._replace(channels=(*kind.channels, "A"))

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

    def _covers_all(self, first: int, count: int) -> bool:
        """Whether all pixels of rows of a map show the picture and nothing else."""
        (_, geometry, shape, *_), _ = self._drawing(first, count)
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
        made = made._replace(data=curved(made, from_srgb)) if self._is_curved else made
        return made._replace(about=self.about), coverage

    def _drawn(self, first: int, count: int) -> Warped:
        """Return a strip in linear light, and its coverage."""
        loaded, choice = self.loaded, self.choice
        drawing, part = self._drawing(first, count)
        light: AnyLight = "pixels" if choice.linear and loaded.kind.is_encoded else False
        drawing = drawing._replace(has_gaps=loaded.has_gaps, linear_light=light)
        image, coverage = drawn(loaded.data, drawing)
        return Warped(image[part], coverage[part])


@dataclass(frozen=True)
class Flyover:
    """A closed path of a camera; the picture's longer side has length 1."""

    path: Literal["fly", "turn"] = "fly"  # low over the picture and back, or around its center
    frames: int = 48
    size: tuple[int, int] = (240, 426)  # height and width of a frame, px

    def __post_init__(self) -> None:
        check_count(self.frames)

    def camera(self, n: int) -> AnyCamera:
        """Return the camera of frame `n`."""
        phase = 2.0 * np.pi * n / self.frames
        if self.path == "fly":
            eye = np.array([0.12 * np.sin(phase), -0.35 - 0.2 * np.cos(phase), 0.16])
            target = eye + np.array([0.06 * np.sin(phase + 0.5), 0.4, -0.18])
        else:
            elevation, target = np.radians(35.0), np.zeros(3)
            around = np.array([np.sin(phase), -np.cos(phase)]) * np.cos(elevation)
            eye = 1.3 * np.array([*around, np.sin(elevation)])
        height, width = self.size
        pose = look_at(eye, target)
        return Camera.from_fov(FOV, height=height, width=width, world_to_camera=pose)


@dataclass(frozen=True)
class FlightOptions:
    """Options of frames: method, edge mode and background."""

    method: Method
    edge: Edge = Edge.TRANSPARENT
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)  # linear light
    light: AnyLight | None = None  # `pixels`, if the picture's levels are sRGB


def shots(source: Floats, flight: Flyover, paint: FlightOptions) -> Shots:
    """Return the frames of a flight over a picture (H, W, 4), see `with_alpha`."""
    job = {
        **asdict(flight),
        "picture": fingerprint(source),
        "method": repr(paint.method),
        "edge": paint.edge.value,
        "background": paint.background,
        "light": paint.light,
    }
    return Shots(flight.frames, lambda n: frame(source, flight, paint, n), job)


def frame(source: Floats, flight: Flyover, paint: FlightOptions, n: int) -> Levels:
    """Paint frame n (H, W, 3), sRGB-encoded, 8 bits, of a source as `with_alpha` gives it."""
    from resample_texture.geometry.cameras import plane_homography

    texel_size = 1.0 / max(source.shape[:2])
    geometry = plane_homography(flight.camera(n), source.shape[:2], texel_size=texel_size)
    drawing = Drawing(paint.method, geometry, flight.size, paint.edge, linear_light=paint.light)
    image = drawn(source, drawing).image
    return screen_levels(image, background=paint.background)


def with_alpha(picture: Floats) -> Floats:
    """Return RGB and alpha (H, W, 4) of a gray or RGB picture with or without alpha."""
    channels = picture.shape[2]
    if channels not in (1, 2, 3, 4):
        raise ValueError(f"a picture of {channels} channels; gray and RGB ones can be shown")
    color = picture[..., [0, 0, 0]] if channels < 3 else picture[..., :3]
    alpha = picture[..., -1:] if channels in (2, 4) else np.ones_like(color[..., :1])
    return np.ascontiguousarray(np.concatenate([color, alpha], axis=2), np.float32)
