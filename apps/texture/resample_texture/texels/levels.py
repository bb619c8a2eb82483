"""Levels between texels, light under pixels.

What people see, and what a camera's curve has made, are levels: these are interpolated. What a
pixel averages is light. So a pixel that is hardly longer than a texel is interpolated in levels,
one that is `LONG` texels or longer is a mean of light, and between these both are mixed.
"""

import dataclasses
import math
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from resample.colors import from_srgb, to_srgb
from resample.types import Floats
from resample_texture.geometry.mappings import ForwardMap, Geometry, Homography
from resample_texture.texels.encoding import LEVELS, Encoding, decoded
from resample_texture.types import AnyAlpha, AnyLight, Edge, Method, Warped

if TYPE_CHECKING:
    from resample_texture.texels.kernels.gather import Plane

SHORT, LONG = 1.15, 1.75  # texels along a pixel's longer axis
HARDLY = 0.5 / 255  # of the levels, a bound that is several times what light does differ by
STEPS = 65536  # of a curve's table, between which it is linear


def light_for(
    linear_light: AnyLight | None, dtype: np.dtype[Any], is_encoded: bool | None = None
) -> AnyLight:
    """What is filtered in linear light: by default pixels of encoded levels, as uint8 are."""
    if linear_light is not None:
        return linear_light
    return "pixels" if (dtype == np.uint8 if is_encoded is None else is_encoded) else False


def in_levels(method: Method) -> Method:
    """The method as it interpolates levels: with limits that fit these, unless others are chosen.

    `limit=usual` is `levels` here: no texel stands out farther than it is seen to.
    """
    if hasattr(method, "in_levels"):
        levels: Method = method.in_levels
        return levels
    interpolation = getattr(method, "interpolation", None)
    if getattr(interpolation, "limit", None) != "usual" or not dataclasses.is_dataclass(method):
        return method
    kept = dataclasses.replace(interpolation, limit="levels")
    return dataclasses.replace(method, interpolation=kept)


def share_of_levels(
    method: Method,
    geometry: Geometry,
    shape: tuple[int, int],
    size: tuple[int, int],
    part: tuple[slice, slice] = np.s_[:, :],
) -> Floats:
    """Share of levels in the pixels of a target (height, width), or in those of a part of it.

    (h, w, 1), or (1, 1, 1) if all are as long. `size`: height and width of the source, texels.
    """
    is_mixing = getattr(method, "interpolation", None) is not None or hasattr(method, "in_levels")
    if not is_mixing:
        return np.zeros((1, 1, 1), np.float32)
    if isinstance(geometry, ForwardMap):
        return _projected_shares(method, geometry, shape)
    from resample_texture.texels.gather import places_of
    from resample_texture.texels.kernels.gather import Plane
    from resample_texture.texels.kernels.mixing import put_shares

    places, rows, columns = places_of(size, geometry, shape), range(shape[0]), range(shape[1])
    rows, columns = rows[part[0]], columns[part[1]]
    form = len(rows), len(columns)
    if isinstance(places, Plane):
        left, top = places.left + columns.start, places.top + rows.start
        places = places._replace(left=left, top=top)
        if not places.inverse[2, :2].any():
            form = 1, 1
        elif _longest_on(places, form) <= SHORT:
            return np.ones((1, 1, 1), np.float32)
    shares = np.empty((*form, 1), np.float32)
    put_shares(places, (SHORT, LONG), form, shares.reshape(-1))
    return shares


def _projected_shares(method: Method, geometry: ForwardMap, shape: tuple[int, int]) -> Floats:
    """Share of levels in pixels (height, width) along a forward map: texels bring their own.

    A pixel's longer axis in texels is the inverse of a texel's shorter one in pixels.
    """
    along_x, along_y = (
        np.gradient(part) if min(part.shape) > 1 else np.zeros((2, *part.shape))
        for part in (geometry.x, geometry.y)
    )
    squares = sum(part * part for part in (*along_x, *along_y))
    area = np.abs(along_x[1] * along_y[0] - along_x[0] * along_y[1])
    longer = np.sqrt(0.5 * (squares + np.sqrt(np.maximum(squares**2 - 4.0 * area**2, 0.0))))
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.clip((LONG - longer / area) / (LONG - SHORT), 0.0, 1.0)
    share[np.isnan(share)] = 1.0  # beside texels that are dropped, and of single rows
    if share.min(initial=1.0) == share.max(initial=1.0):
        return np.full((1, 1, 1), share.min(initial=1.0), np.float32)
    texels = np.ascontiguousarray(share[..., None], np.float32)
    warped, coverage = method(texels, geometry, shape, Edge.TRANSPARENT)
    image: Floats = np.divide(
        warped, coverage[..., None], out=warped, where=coverage[..., None] > 0.0
    )
    image.clip(0.0, 1.0, out=image)
    return image


def spared(share: Floats, levels: Floats, geometry: Geometry, shape: tuple[int, int]) -> Floats:
    """`share_of_levels` that is 1, too, where light would hardly differ from levels.

    `levels`: texels (H, W, C) of the source, or of the part of it that `geometry` has.
    """
    from resample_texture.texels.gather import places_of
    from resample_texture.texels.kernels.gather import Plane
    from resample_texture.texels.kernels.mixing import Differences, put_differences, spare_light

    if isinstance(geometry, ForwardMap):
        return share
    height, width, channels = levels.shape
    places = places_of((height, width), geometry, shape)
    # Along the axes all pixels are drawn at once.
    is_along = isinstance(places, Plane) and not places.inverse[[0, 1, 2, 2], [1, 0, 0, 1]].any()
    if is_along or not ((share > 0.0) & (share < 1.0)).any():
        return share
    region = geometry.region if isinstance(geometry, Homography) else None
    first = (0, 0) if region is None else region.first
    found = Differences(np.empty(height * width, np.float32), (height, width), first)
    put_differences(levels.reshape(-1), channels, found)
    shares = np.array(np.broadcast_to(share, (*shape, 1)))
    spare_light(places, found, HARDLY, shape, shares.reshape(-1))
    return shares


def _longest_on(plane: "Plane", form: tuple[int, int]) -> float:
    """Bound of the longer axes of a picture's (height, width) pixels in perspective, texels.

    A pixel's sides are affine in its place, divided by the square of its depth. So their norm is
    largest at a corner, and the square least at another.
    """
    x, y = plane.left + np.array([0, form[1]] * 2), plane.top + np.repeat([0, form[0]], 2)
    u, v, depth = plane.inverse @ np.stack([x, y, np.ones(4)])
    if not depth.min() > 0.0:
        return math.inf
    sides = plane.inverse[None, :2, :2] * depth[:, None, None]
    sides = sides - np.stack([u, v], axis=1)[:, :, None] * plane.inverse[2, :2]
    return float(np.linalg.norm(sides, 2, axis=(1, 2)).max() / depth.min() ** 2)


def texels_in_levels(
    image: NDArray[Any], alpha: AnyAlpha | None, gaps: int = 0
) -> tuple[Floats, Encoding]:
    """Texels (H, W, C) in levels, of a picture of levels or of light; and its encoding."""
    if image.dtype.name in LEVELS:
        texels, encoding = decoded(image, linear_light=False, alpha=alpha, gaps=gaps)
        return texels, encoding._replace(is_encoded=True)
    light, encoding = decoded(image, alpha=alpha, gaps=gaps)
    return curved(light, None, encoding), encoding


def mixed_light(
    levels: Warped, averaged: Warped | None, share: Floats, encoding: Encoding
) -> Warped:
    """Light of warped levels, and of warped light by 1 - `share`; both times their coverage.

    Either may have left out pixels, with a coverage of 0, that are the other's alone.
    """
    made = curved(levels.image, levels.coverage[..., None], encoding, is_back=True)
    if averaged is None:
        return Warped(made, levels.coverage)
    made -= averaged.image
    made *= share
    made += averaged.image
    return Warped(made, np.maximum(levels.coverage, averaged.coverage))


def curved(
    values: Floats, weight: Floats | None, encoding: Encoding, *, is_back: bool = False
) -> Floats:
    """Levels of light, or light of levels (`is_back`).

    What has multiplied the colors is divided out and multiplied again: `weight`, or opacity.
    """
    from resample.engine.levels import bend

    # Opacity and marks of values that exist are multiplied by the coverage themselves.
    colors = values.shape[2] - encoding.gaps
    if encoding.is_straight or (encoding.dtype.kind == "f" and colors in (2, 4)):
        colors -= 1
        weight = values[..., colors : colors + 1]
    elif encoding.gaps:
        weight = values[..., -encoding.gaps :]
    color = np.ascontiguousarray(values[..., :colors])
    if weight is not None and (weight == 1.0).all():
        weight = None
    if weight is not None:
        color = np.divide(color, weight, out=np.zeros_like(color), where=weight > 0.0)
    bent = np.empty_like(color)
    bend(_table(is_back=is_back), color.reshape(-1), bent.reshape(-1))
    if weight is not None:
        bent *= weight
    if colors == values.shape[2]:
        return bent
    return np.concatenate([bent, values[..., colors:]], axis=2)


@cache
def _table(*, is_back: bool) -> Floats:
    """Light of equal steps of levels (`is_back`), or levels of equal steps of light."""
    steps = np.arange(STEPS + 1) / STEPS
    return np.asarray(from_srgb(steps) if is_back else to_srgb(steps), np.float32)
