"""Warp a picture for the command line, in linear light or as encoded."""

from collections.abc import Callable
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from resample.colors import from_srgb, to_srgb
from resample.command.session import OTHERS, Session, bytes_written, libraries, require_picture
from resample.files import pictures
from resample.files.facts.geotiff import Geo, moved, unplaced
from resample.files.pictures import Kind, Picture, form_of
from resample.files.stores.opening import Place
from resample.memory import require
from resample.memory.mapped import pages_of
from resample.types import Floats
from resample_texture.arguments import method_named
from resample_texture.command.choices import PictureWarping
from resample_texture.command.inputs import PictureTarget
from resample_texture.geometry.mappings import ForwardMap, Homography
from resample_texture.types import AnyLight, Warped
from resample_texture.warping import warp

WHOLE = 1.0 - 1e-3  # coverage that counts as complete; float32 sums are off by 1e-4
BYTES_PER_VALUE = 16  # of a target, including the copies made while warping and writing
# Measured as the peak of fresh processes (`python -m benchmarks.memory`).
BYTES_PER_TEXEL = 6  # per texel and channel: the source and its decoding buffers
BYTES_IN_STRIP = 28  # per value of the strip of a large picture that is being drawn
BYTES_OF_FILM = 56, 60  # per texel of the picture, in levels and light, and per pixel of a frame
REMEDY = "take a smaller size, or a part of it by --roi"


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
    """Return the warped picture and the coverage of its pixels.

    Pixels that are not covered are transparent with the edge mode `transparent`, if `adds_alpha`,
    else black, and not a number if `keeps_gaps`. No transparency is added where all pixels are
    covered.
    """
    as_encoded = picture.kind.is_encoded and (choice.total or not choice.linear)
    source = curved(picture, to_srgb) if as_encoded else picture.data
    with session.stage("warp", bar=bar):
        is_seen = picture.kind.is_encoded and not as_encoded
        image, coverage = _drawn(source, target, choice, roi, "pixels" if is_seen else None)
    is_whole = bool((coverage >= WHOLE).all())
    gaps = {"keeps_gaps": keeps_gaps, "is_whole": is_whole, "adds_alpha": adds_alpha}
    result = finished(image, coverage, picture.kind, choice, **gaps)
    if as_encoded:
        result = as_light(result)
    about = picture.about._replace(geo=placed(picture.about.geo, target, roi))
    return result._replace(about=about), coverage


def _drawn(
    source: Floats,
    target: PictureTarget,
    choice: PictureWarping,
    roi: tuple[int, int, int, int] | None,
    linear_light: AnyLight | None,
) -> Warped:
    """Return texels as the target shows them."""
    filtering: dict[str, Any] = {
        **choice.sampling,
        "method": choice.method,
        "fill": "premultiplied",
        "axis": -1,
        "linear_light": linear_light,
        "threads": choice.threads,
    }
    if target.draws is not None:
        return target.draws(source, **filtering)
    place: dict[str, Any] = {"edge": choice.edge, "total": choice.total or None, "roi": roi}
    return warp(source, target.geometry, target.shape, **filtering, **place)


def as_light(picture: Picture) -> Picture:
    """Convert a picture of encoded values to linear light."""
    return picture._replace(data=curved(picture, from_srgb))


def finished(
    image: Floats, coverage: Floats, kind: Kind, choice: PictureWarping, *, keeps_gaps: bool,
    is_whole: bool, adds_alpha: bool = True,
) -> Picture:  # fmt: skip
    """Mark uncovered pixels by alpha or not-a-numbers, unless all are covered."""
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


def covers_all(
    target: PictureTarget, source_shape: tuple[int, int], roi: tuple[int, int, int, int] | None
) -> bool:
    """Tell whether every target pixel lies within the source, as far as known beforehand."""
    if target.draws is not None:
        return True
    geometry, (height, width) = target.geometry, source_shape
    if not isinstance(geometry, Homography):
        return not isinstance(geometry, ForwardMap)
    left, top, across, down = (0, 0, target.shape[1], target.shape[0]) if roi is None else roi
    x, y = np.array([left, left + across] * 2), np.array([top] * 2 + [top + down] * 2)
    u, v, w = np.linalg.inv(geometry.oriented(source_shape)) @ np.stack([x, y, np.ones(4)])
    if not (w > 0.0).all():
        return False
    near = 1e-3  # px that float32 places may be off
    u, v = u / w, v / w
    return bool(
        (np.abs(u - width / 2) <= width / 2 + near).all()
        and (np.abs(v - height / 2) <= height / 2 + near).all()
    )


def report(
    session: Session,
    source: tuple[int, ...],
    result: tuple[int, ...],
    kind: Kind,
    choice: PictureWarping,
) -> dict[str, Any]:
    """Return sizes and times for `--stats`; shapes are (height, width, ...)."""
    return {
        "source": [source[1], source[0]],
        "size": [result[1], result[0]],
        "channels": list(kind.channels),
        "encoding": "sRGB" if kind.is_encoded else "linear",
        "method": choice.method,
        "seconds": session.times(),
    }


def bytes_at_once(source: tuple[int, int, int], shape: tuple[int, int]) -> int:
    """Return the bytes of a source (height, width, channels) and its target."""
    height, width, channels = source
    target = BYTES_PER_VALUE * shape[0] * shape[1]
    return channels * (pictures.BYTES_PER_VALUE * height * width + target)


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
    in_strips: tuple[int, int] | None = None,
) -> None:
    """Refuse a warp that does not fit into memory; log what it needs (DEBUG).

    `shape`: height and width of the result, px. `in_strips`: bytes of a source as stored that is
    drawn strip by strip, and values drawn at a time.
    """
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


def require_film(source: Place, size: tuple[int, int]) -> None:
    """Refuse a flight over a picture that does not fit into memory, as `check_memory` does."""
    (height, width, _), _ = form_of(source)
    texel, pixel = BYTES_OF_FILM
    require_picture(size, pixel, {"the source": texel * height * width})
