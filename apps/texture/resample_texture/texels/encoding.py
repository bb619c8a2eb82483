"""Convert pictures of any type to texels, and back.

Texels are float32, linear light or plain values, multiplied by alpha and by whether a value exists,
so that transparent or missing texels do not affect the color of neighbours. Only uint8 and uint16
may be sRGB-encoded pictures, uint16 only where that is said; all other types are plain values.

Channels that mark where values exist are warped like any other; a pixel's mean is then over the
existing values. Where less than half of a pixel's part of the source has a value, the value is
missing in the result, so that gaps keep their size.

Vision and cameras' curves work in levels, so levels are interpolated. A
pixel averages light. So a pixel hardly longer than a texel is interpolated in levels, one of
`LONG` texels or more is a mean of light, and between these both are mixed.
"""

import dataclasses
import math
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.colors import from_srgb, to_srgb
from resample.memory.mapped import contiguous
from resample.types import Doubles, Floats
from resample_texture.geometry.mappings import ForwardMap, Geometry, Homography, Size
from resample_texture.types import Alpha, AnyAlpha, AnyLight, Edge, Method, Warped

LEVELS = ("uint8", "uint16")  # of light, encoded or not: 0 is black, the largest level white
VALUES = (
    "bool", "int8", "int16", "int32", "int64", "uint32", "uint64", "float16", "float32", "float64",
)  # fmt: skip
DTYPES = (*LEVELS, *VALUES)
COMPLEX = ("complex64", "complex128")  # parts are warped as two channels
STEPS = 65535  # of linear light, in the table for encoding 8 bits
WIDE = ("int32", "int64", "uint32", "uint64", "float64")
COMFORTABLE = 60  # exponents of two up to which sums and squares of values fit into float32
SHORT, LONG = 1.15, 1.75  # texels along a pixel's longer axis
HARDLY = 0.5 / 255  # of the levels, a bound that is several times what light does differ by
CURVE_STEPS = 65536  # of a curve's table, between which it is linear

Booleans = NDArray[np.bool_]
MaskedArray = np.ma.MaskedArray[Any, Any]
LEAST = 0.5  # share of a pixel's coverage that must have a value
ROUNDED = 1e-5  # share of the coverage by which sums of weights may differ without missing values


class Mended(NamedTuple):
    """Picture without the channels that mark missing values."""

    image: Floats  # (H, W, C) multiplied by the coverage
    coverage: Floats  # (H, W), or (H, W, C) if channels differ
    missing: Booleans | None  # (H, W, C) where a channel has no value though a pixel is covered


def unmasked(image: Any) -> tuple[NDArray[Any], MaskedArray | None]:
    """Return an array without its mask; and itself if it is a masked array."""
    if isinstance(image, np.ma.MaskedArray):
        return np.asarray(image.data), image
    return np.asarray(image), None


def masked(values: NDArray[Any], hidden: Booleans, fill: Any) -> NDArray[Any]:
    """Return a masked array with a fill value."""
    with np.errstate(over="ignore"):  # float16 does not hold 1e20, NumPy's fill value
        return np.ma.MaskedArray(values, hidden, fill_value=fill)


def missing_in(
    planes: NDArray[Any], mask: MaskedArray | None, *, together: bool = False
) -> Booleans | None:
    """Find values (H, W, C) that are masked or not finite; None if there are none."""
    missing = None if mask is None else np.ma.getmaskarray(mask).reshape(planes.shape)
    if planes.dtype.kind == "f":
        with np.errstate(over="ignore", invalid="ignore"):  # the sum is the fastest test
            total = planes.sum(dtype=np.float64 if planes.dtype.itemsize == 8 else np.float32)
        if not (np.isfinite(total) or np.isfinite(planes).all()):
            not_finite = ~np.isfinite(planes)
            missing = not_finite if missing is None else missing | not_finite
    if missing is None or not missing.any():
        return None
    if together:
        missing = np.broadcast_to(missing.any(axis=2, keepdims=True), planes.shape)
    return np.asarray(missing)


def weighed(texels: Floats, missing: Booleans | None, least: int = 1) -> tuple[Floats, int]:
    """Append channels that mark where texels (H, W, C) have values; one if all are equal."""
    if missing is None:
        return texels, 0
    is_one = least <= 1 and bool((missing == missing[..., :1]).all())
    count = 1 if is_one else missing.shape[2]
    there = ~missing[..., :count]
    values = np.where(missing, np.float32(0), texels)
    return np.concatenate([values, there], axis=2, dtype=np.float32), count


def mended(warped: Warped, gaps: int) -> Mended:
    """Return a picture with a coverage of existing values, not all of the source."""
    if gaps == 0:
        return Mended(warped.image, warped.coverage, None)
    values, there = _bounded(warped, gaps)
    coverage = there.max(axis=2)
    if gaps == 1:
        return Mended(values, coverage, None)
    missing = (there < LEAST * coverage[..., None]) & (coverage > 0.0)[..., None]
    return Mended(_shared(values, there, coverage), coverage, missing)


def kept(warped: Warped, gaps: int) -> Mended:
    """Return a picture with the source's coverage, missing where too few values exist."""
    if gaps == 0:
        return Mended(warped.image, warped.coverage, None)
    values, there = _bounded(warped, gaps)
    cover = np.broadcast_to(warped.coverage[..., None], values.shape)
    few = there < LEAST * cover
    values = np.where(few, np.float32(0), _shared(values, there, warped.coverage))
    return Mended(values, np.where(few, np.float32(0), cover), few & (cover >= LEAST))


def _bounded(warped: Warped, gaps: int) -> tuple[Floats, Floats]:
    """Return values and their weights, clamped to 0..coverage against negative lobes."""
    values, there = warped.image[..., :-gaps], warped.image[..., -gaps:]
    coverage = warped.coverage[..., None]
    is_all = np.abs(there - coverage) <= ROUNDED * coverage
    bounded = np.where(is_all, coverage, np.clip(there, 0.0, coverage))
    share = is_all.astype(there.dtype)
    np.divide(bounded, there, out=share, where=(there > 0.0) & ~is_all)
    return values * share, bounded


def _shared(values: Floats, there: Floats, coverage: Floats) -> Floats:
    """Return means of existing values, multiplied by the coverage that all channels share."""
    share = np.zeros_like(there)
    np.divide(coverage[..., None], there, out=share, where=there > 0.0)
    return values * share


class ValueSpan(NamedTuple):
    """Offset and unit of each channel's values, so that float32 errs by 10⁻⁷ of their range."""

    start: NDArray[Any]  # (C,) of the values' type
    unit: Doubles  # (C,) powers of two

    def reduced(self, planes: NDArray[Any]) -> Doubles:
        """Subtract the offset and divide by the unit, (H, W, C); only finite values count."""
        with np.errstate(over="ignore", invalid="ignore"):
            return np.asarray((planes - self.start) / self.unit, np.float64)

    def restored(
        self, image: Floats, coverage: Floats, behind: ArrayLike, dtype: np.dtype[Any]
    ) -> NDArray[Any]:
        """Restore values of a type from an image (H, W, C) times its coverage."""
        missing = np.broadcast_to(1.0 - coverage.astype(np.float64), image.shape)
        through = np.zeros(image.shape)
        with np.errstate(over="ignore", invalid="ignore"):
            beyond = np.asarray(behind, np.float64) - self.start.astype(np.float64)
            np.multiply(missing, beyond, out=through, where=missing > 0.0)
            distance = image * self.unit + through
            if dtype.kind == "f":
                return np.asarray(self.start + distance, dtype)
        return rounded(distance, dtype, self.start)


def span_of(
    planes: NDArray[Any], missing: NDArray[np.bool_] | None, *, from_zero: bool = False
) -> ValueSpan | None:
    """Return offset and unit for values (H, W, C); None if float32 resolves them."""
    if planes.dtype.name not in WIDE:
        return None
    start = np.zeros(planes.shape[2], planes.dtype)
    unit = np.ones(planes.shape[2])
    for c in range(planes.shape[2]):
        plane = planes[..., c]
        known = plane if missing is None else plane[~missing[..., c]]
        if known.size:
            low, high = known.min().item(), known.max().item()
            # Begin at the smallest value if 0 is far from the range.
            is_far = low > high / 2 if low > 0 else high < low / 2
            first = low if is_far and not from_zero else 0
            # A power of two makes the largest distance neither huge nor tiny.
            largest = max(high - first, first - low)
            exponent = math.frexp(largest)[1] - 1 if largest else 0
            start[c] = first
            unit[c] = math.ldexp(1.0, exponent) if abs(exponent) > COMFORTABLE else 1.0
    if not start.any() and (unit == 1.0).all():
        return None
    return ValueSpan(start, unit)


def rounded(
    distance: Doubles, dtype: np.dtype[Any], start: NDArray[Any] | None = None
) -> NDArray[Any]:
    """Round `start` + `distance` (H, W, C) to integers or booleans, within their range."""
    whole = np.rint(distance)
    if dtype.kind == "b":
        return np.asarray(whole > 0.0)
    native = dtype.newbyteorder("=")
    limits = np.iinfo(native)
    if start is None or not start.any():
        return _saturated(whole, limits.min, limits.max, native).astype(dtype, copy=False)
    result = np.empty(whole.shape, native)
    for c, first in enumerate(start.tolist()):
        low, high = max(limits.min - first, -(2**63)), min(limits.max - first, 2**63 - 1)
        steps = _saturated(whole[..., c], low, high, np.dtype(np.int64))
        result[..., c] = steps.astype(native) + np.array(first, native)  # overflow wraps back
    return result.astype(dtype, copy=False)


def _saturated(whole: Doubles, low: int, high: int, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Convert whole numbers to integers, limited to `low`..`high` beyond float64's precision."""
    is_low, is_high = whole <= low, whole >= high
    result = np.where(is_low | is_high, 0.0, whole).astype(dtype)
    result[is_low], result[is_high] = low, high
    return result


class Encoding(NamedTuple):
    """How to convert texels back to a picture."""

    dtype: np.dtype[Any]
    is_flat: bool  # the picture is (H, W)
    is_encoded: bool  # by the sRGB curve
    is_straight: bool  # the fourth channel is opacity that does not multiply the color
    gaps: int = 0  # number of last channels, which mark where values exist: 0, 1 or C
    span: ValueSpan | None = None  # offset and unit, where float32 would not resolve the values
    fill: Any = None  # fill value of a masked array; None: it is not masked

    def as_light(self) -> "Encoding":
        """Return the encoding of float pictures: light, premultiplied."""
        return Encoding(np.dtype(np.float32), False, False, False, self.gaps)


def decoded(
    image: NDArray[Any],
    *,
    linear_light: AnyLight | None = None,  # whether `LEVELS` are sRGB; None: uint8 alone is
    alpha: AnyAlpha | None = None,  # None: straight for `LEVELS`, else premultiplied
    is_sum: bool = False,
    gaps: int = 0,  # least channels that mark missing values, of a part of a picture
) -> tuple[Floats, Encoding]:
    """Convert a picture (H, W) or (H, W, C) to texels (H, W, C)."""
    image, mask = unmasked(image)
    check_picture(image)
    planes = image.reshape(*image.shape[:2], -1)
    is_straight = has_straight_alpha(planes, alpha)
    has_alpha = planes.shape[2] == 4 and alpha != Alpha.NONE
    missing = missing_in(planes, mask, together=is_straight)
    if gaps and missing is None:
        missing = np.zeros(planes.shape, np.bool_)
    span = None if is_straight else span_of(planes, missing, from_zero=is_sum)
    if linear_light is None:
        linear_light = image.dtype == np.uint8
    is_encoded = image.dtype.name in LEVELS and bool(linear_light)
    given = planes if span is None else span.reduced(planes)
    texels = light(given, is_encoded=is_encoded, has_alpha=has_alpha)
    if is_straight:
        with np.errstate(invalid="ignore"):
            color = texels[..., :3] * texels[..., 3:]
        texels = np.concatenate([color, texels[..., 3:]], axis=2)
    texels, gaps = weighed(texels, missing, least=gaps)
    fill = None if mask is None else mask.fill_value
    encoding = Encoding(image.dtype, image.ndim == 2, is_encoded, is_straight, gaps, span, fill)
    return contiguous(texels, np.float32), encoding


def has_straight_alpha(planes: NDArray[Any], alpha: AnyAlpha | None) -> bool:
    """Whether the fourth channel of planes (H, W, C) is straight opacity."""
    if alpha is None:
        alpha = Alpha.STRAIGHT if planes.dtype.name in LEVELS else Alpha.PREMULTIPLIED
    if alpha not in list(Alpha):
        raise ValueError(f"alpha {alpha!r}; known: {', '.join(Alpha)}")
    return planes.shape[2] == 4 and alpha == Alpha.STRAIGHT


def check_picture(image: NDArray[Any]) -> None:
    """Reject arrays that are not pictures of a known type."""
    if image.dtype.name not in DTYPES:
        raise ValueError(f"a picture's type is one of {', '.join(DTYPES)}, not {image.dtype}")
    if image.ndim not in (2, 3) or 0 in image.shape:
        raise ValueError(
            f"a picture is (height, width) or (height, width, channels), not {image.shape}"
        )


def encoded(
    picture: Floats,  # (H, W, C) times the coverage, without marks of missing values
    coverage: Floats,  # (H, W) or (H, W, C) share of each pixel that `picture` fills
    encoding: Encoding,
    *,
    missing: Booleans | None = None,  # (H, W, C) where a covered pixel has no value
    behind: NDArray[Any] | None = None,  # (H, W, C) background, of the picture's type
) -> NDArray[Any]:
    """Return a picture of the type and shape that `decoded` was given."""
    coverage = coverage.reshape(*coverage.shape[:2], -1)
    if encoding.span is not None:
        through = 0.0 if behind is None else behind
        image = encoding.span.restored(picture, coverage, through, encoding.dtype)
    else:
        if behind is not None:
            # Composite over the background; its nans show only through gaps.
            is_partly = coverage < 1.0
            gaps = np.nonzero(is_partly[..., 0] if coverage.shape[2] == 1 else is_partly.any(2))
            if gaps[0].size:
                below = light(behind, is_encoded=encoding.is_encoded)
                share = 1.0 - np.broadcast_to(coverage, picture.shape)[gaps]
                color = np.broadcast_to(below, picture.shape)[gaps]
                picture = picture.copy()
                picture[gaps] += np.multiply(share, color, out=0.0 * share, where=share > 0.0)
        image = _of_texels(picture, encoding)
    if missing is not None:
        image[missing] = np.nan if encoding.dtype.kind == "f" else 0
    shaped = image[..., 0] if encoding.is_flat else image
    if encoding.fill is None:
        return shaped
    none = np.zeros(image.shape, np.bool_) if missing is None else missing
    none = none | (coverage == 0.0) if behind is None else none
    mask = none[..., 0] if encoding.is_flat else none
    return masked(shaped, np.broadcast_to(mask, shaped.shape), encoding.fill)


def _of_texels(picture: Floats, encoding: Encoding) -> NDArray[Any]:
    """Convert texels to values (H, W, C) of the picture's own type."""
    with np.errstate(over="ignore"):
        if encoding.is_straight:
            picture = picture.copy()
            alpha = picture[..., 3:]
            np.divide(picture[..., :3], alpha, out=picture[..., :3], where=alpha > 0.0)
        if encoding.dtype.name not in LEVELS:
            if encoding.dtype.kind != "f":
                return rounded(picture.astype(np.float64), encoding.dtype)
            return picture.astype(encoding.dtype)
    largest = np.iinfo(encoding.dtype).max
    if largest == 255:
        from resample.engine.levels import put_levels

        picture = np.ascontiguousarray(picture, np.float32)
        levels = np.empty(picture.shape, np.uint8)
        put_levels(_levels(encoding.is_encoded), picture.reshape(-1), levels.reshape(-1))
        if encoding.is_encoded and encoding.is_straight:
            levels[..., 3] = np.rint(np.clip(picture[..., 3], 0.0, 1.0) * 255)
        return levels
    picture = np.clip(picture, 0.0, 1.0)
    if not encoding.is_encoded:
        return np.rint(picture * largest).astype(encoding.dtype)
    count = 3 if encoding.is_straight else picture.shape[2]
    wide = np.empty(picture.shape, encoding.dtype)
    wide[..., count:] = np.rint(picture[..., count:] * largest)
    wide[..., :count] = np.rint(to_srgb(picture[..., :count]) * largest)
    return wide


def light(planes: NDArray[Any], *, is_encoded: bool, has_alpha: bool = False) -> Floats:
    """Convert planes (H, W, C) to float32: `LEVELS`, encoded or not, to 0..1, others unchanged."""
    from resample.engine.levels import decode, levels_of

    if planes.dtype.name not in LEVELS:
        with np.errstate(over="ignore", invalid="ignore"):
            return np.ascontiguousarray(planes, np.float32)
    table = _lights(planes.dtype.name, is_encoded)
    levels = np.require(planes, planes.dtype.newbyteorder("="), ["C", "W"])
    values = np.empty(levels.shape, np.float32)
    decode(table, levels_of(levels.reshape(-1)), values.reshape(-1))
    if is_encoded and has_alpha:
        values[..., 3] = _lights(planes.dtype.name, False)[planes[..., 3]]
    return values


@cache
def _lights(dtype: str, is_encoded: bool) -> Floats:
    """Return the light 0..1 of each level of a type."""
    largest = np.iinfo(dtype).max
    plain = (np.arange(largest + 1) / largest).astype(np.float32)
    return np.asarray(from_srgb(plain), np.float32) if is_encoded else plain


@cache
def _levels(is_encoded: bool) -> NDArray[np.uint8]:
    """Return the levels of 8 bits, sRGB-encoded or not, of equal steps of light."""
    light = np.arange(STEPS + 1) / STEPS
    return np.asarray(np.rint((to_srgb(light) if is_encoded else light) * 255), np.uint8)


def parts_of_complex(image: NDArray[Any]) -> NDArray[Any]:
    """Return real and imaginary parts (H, W, 2 C) of a picture; where one is missing, both are."""
    values, mask = unmasked(image)
    if values.dtype.name not in COMPLEX:
        raise ValueError(f"complex pictures are of {' or '.join(COMPLEX)}, not {values.dtype}")
    native = np.ascontiguousarray(values, values.dtype.newbyteorder("="))
    parts = native.view(native.real.dtype).reshape(*native.shape[:2], -1)
    missing = ~np.isfinite(native).reshape(*native.shape[:2], -1)
    if missing.any():
        parts = np.where(np.repeat(missing, 2, axis=2), parts.dtype.type(np.nan), parts)
    if mask is None:
        return parts
    hidden = np.repeat(np.ma.getmaskarray(mask).reshape(missing.shape), 2, axis=2)
    return masked(parts, hidden, np.real(mask.fill_value))


def complex_of_parts(parts: NDArray[Any], image: NDArray[Any]) -> NDArray[Any]:
    """Return warped parts (h, w, 2 C) as a picture of the type and channels of the given one."""
    plain, mask = unmasked(parts)
    dtype = image.dtype.newbyteorder("=")
    form = (*plain.shape[:2], *image.shape[2:])
    values = np.ascontiguousarray(plain).view(dtype).reshape(form)
    values[np.isnan(values)] = complex(np.nan, np.nan)
    if mask is None:
        return values
    is_set = np.ma.getmaskarray(mask)
    hidden = is_set[..., ::2] | is_set[..., 1::2]
    return masked(values, hidden.reshape(form), getattr(image, "fill_value", None))


def light_for(
    linear_light: AnyLight | None, dtype: np.dtype[Any], is_encoded: bool | None = None
) -> AnyLight:
    """Stages filtered in linear light: by default pixels of encoded levels, as uint8 are."""
    if linear_light is not None:
        return linear_light
    return "pixels" if (dtype == np.uint8 if is_encoded is None else is_encoded) else False


def in_levels(method: Method) -> Method:
    """The method for levels: a `limit=usual` of its interpolation becomes `levels`."""
    given: Any = method
    has_own = hasattr(given, "in_levels")
    try:
        levels: Method = given.in_levels if has_own else _with_limits_of_levels(given)
    except TypeError:  # a plugin's options that cannot be hashed
        levels = _with_limits_of_levels.__wrapped__(given)
    return levels


@lru_cache(maxsize=16)
def _with_limits_of_levels(method: Any) -> Any:
    interpolation: Any = getattr(method, "interpolation", None)
    if getattr(interpolation, "limit", None) != "usual" or not dataclasses.is_dataclass(method):
        return method
    levels = dataclasses.replace(interpolation, limit="levels")
    kept: Any = method
    return dataclasses.replace(kept, interpolation=levels)


def share_of_levels(
    method: Method,
    geometry: Geometry,
    shape: Size,
    size: Size,
    part: tuple[slice, slice] = np.s_[:, :],
) -> Floats:
    """Share of levels (h, w, 1), or (1, 1, 1), in a target's pixels, or in a part of them."""
    is_mixing = getattr(method, "interpolation", None) is not None or hasattr(method, "in_levels")
    if not is_mixing:
        return np.zeros((1, 1, 1), np.float32)
    if isinstance(geometry, ForwardMap):
        return _projected_shares(method, geometry, shape)
    from resample_texture.texels.gather import places_of
    from resample_texture.texels.kernels.gather import Plane, put_shares

    places, rows, columns = places_of(size, geometry, shape), range(shape[0]), range(shape[1])
    rows, columns = rows[part[0]], columns[part[1]]
    form = len(rows), len(columns)
    if isinstance(places, Plane):
        left, top = places.left + columns.start, places.top + rows.start
        places = places._replace(left=left, top=top)
        if not places.inverse[2, :2].any():
            form = 1, 1
        else:
            # A pixel's sides are affine in its place, over its depth's square: bounded at corners.
            x, y = left + np.array([0, form[1]] * 2), top + np.repeat([0, form[0]], 2)
            u, v, depth = places.inverse @ np.stack([x, y, np.ones(4)])
            sides = places.inverse[None, :2, :2] * depth[:, None, None]
            sides = sides - np.stack([u, v], axis=1)[:, :, None] * places.inverse[2, :2]
            longest = np.linalg.norm(sides, 2, axis=(1, 2)).max()
            if depth.min() > 0.0 and longest / depth.min() ** 2 <= SHORT:
                return np.ones((1, 1, 1), np.float32)
    shares = np.empty((*form, 1), np.float32)
    put_shares(places, (SHORT, LONG), form, shares.reshape(-1))
    return shares


def _projected_shares(method: Method, geometry: ForwardMap, shape: Size) -> Floats:
    """Share of levels in pixels (height, width) along a forward map, from the texels' shares."""
    along_x, along_y = (
        np.gradient(part) if min(part.shape) > 1 else np.zeros((2, *part.shape))
        for part in (geometry.x, geometry.y)
    )
    # A pixel's longer axis in texels is the inverse of a texel's shorter one in pixels.
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


def spared(share: Floats, levels: Floats, geometry: Geometry, shape: Size) -> Floats:
    """`share_of_levels`, raised to 1 where light hardly differs from levels (H, W, C)."""
    from resample_texture.texels.gather import places_of
    from resample_texture.texels.kernels.gather import (
        Differences,
        Plane,
        put_differences,
        spare_light,
    )

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
    """Light of warped levels by `share`, and of warped light, both times their coverage."""
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
    """Levels of light, or light of levels (`is_back`); `weight` or opacity multiplies colors."""
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
    steps = np.arange(CURVE_STEPS + 1) / CURVE_STEPS
    return np.asarray(from_srgb(steps) if is_back else to_srgb(steps), np.float32)
