"""Levels between texels, light under pixels.

What people see, and what a camera's curve has made, are levels: these are interpolated. What a
pixel averages is light. So a pixel that is hardly longer than a texel is interpolated in levels,
one that is `LONG` texels or longer is a mean of light, and between these both are mixed.
"""

import dataclasses
from functools import cache
from typing import Any

import numpy as np

from resample.colors import from_srgb, to_srgb
from resample.types import Floats
from resample_texture.geometry.mappings import ForwardMap, Geometry, Homography
from resample_texture.texels.encoding import Encoding
from resample_texture.types import AnyLight, Method, Warped

SHORT, LONG = 1.05, 1.75  # texels along a pixel's longer axis
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

    `limit=usual` is `range` here: no texel stands out farther than it is seen to.
    """
    if hasattr(method, "in_levels"):
        levels: Method = method.in_levels
        return levels
    interpolation = getattr(method, "interpolation", None)
    if getattr(interpolation, "limit", None) != "usual" or not dataclasses.is_dataclass(method):
        return method
    kept = dataclasses.replace(interpolation, limit="range")
    return dataclasses.replace(method, interpolation=kept)


def share_of_levels(
    method: Method, geometry: Geometry, shape: tuple[int, int], size: tuple[int, int]
) -> Floats:
    """Share (height, width, 1), or (1, 1, 1), of levels in pixels of a source (height, width)."""
    is_mixing = getattr(method, "interpolation", None) is not None or hasattr(method, "in_levels")
    if not is_mixing or isinstance(geometry, ForwardMap):
        return np.zeros((1, 1, 1), np.float32)
    from resample_texture.texels.gather import places_of
    from resample_texture.texels.kernels.gather import put_longest

    is_even = isinstance(geometry, Homography) and not geometry.matrix[2, :2].any()
    longest = np.empty((1, 1) if is_even else shape, np.float32)
    put_longest(places_of(size, geometry, shape), longest)
    share: Floats = np.nan_to_num((LONG - longest) / np.float32(LONG - SHORT))
    return share.clip(0, 1)[..., None]


def levels_of(light: Floats, encoding: Encoding) -> Floats:
    """Texels (H, W, C) of light as levels."""
    return _curved(light, None, encoding, _table(is_back=False))


def light_of(warped: Warped, encoding: Encoding) -> Floats:
    """Warped levels (h, w, C), multiplied by their coverage, as light."""
    return _curved(warped.image, warped.coverage[..., None], encoding, _table(is_back=True))


def _curved(values: Floats, weight: Floats | None, encoding: Encoding, table: Floats) -> Floats:
    """Colors along a curve; what has multiplied them is divided out and multiplied again."""
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
    bend(table, color.reshape(-1), bent.reshape(-1))
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
