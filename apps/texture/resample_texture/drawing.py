"""Draw a picture by a method: decode, warp or copy texels, handle missing values."""

import dataclasses
import math
from collections.abc import Callable, Iterator
from copy import copy
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Floats
from resample_texture.arguments import PREMULTIPLIED, REFLECT_101, adds, check_out, within
from resample_texture.geometry.mappings import BackwardMap, ForwardMap, Geometry, Homography, Size
from resample_texture.geometry.regions import (
    Picks,
    PictureWindow,
    VisibleTiles,
    between,
    picks_of_move,
    texels_at,
    unfolded,
    whole_move,
    whole_shift,
    windows_of,
)
from resample_texture.texels.encoding import (
    LEAST,
    LEVELS,
    WIDE,
    Encoding,
    Mended,
    check_picture,
    complex_of_parts,
    decoded,
    encoded,
    has_straight_alpha,
    in_levels,
    kept,
    light_for,
    masked,
    mended,
    missing_in,
    mixed_light,
    parts_of_complex,
    share_of_levels,
    spared,
    texels_in_levels,
    unmasked,
)
from resample_texture.types import Alpha, AnyAlpha, AnyLight, Edge, Method, Warped, WarpedMeans

if TYPE_CHECKING:
    from resample_texture.texels.gather import MixedTiles

Integers = NDArray[np.int64]
MOST_AT_ONCE = 1 << 24  # values of source and target drawn without windows
MOST_IN_WINDOW = 1 << 22  # values of a window, in the source and in the target
FEW = 8192  # texels and px that one thread works on alone


class Drawing(NamedTuple):
    """Method, geometry, target size and edge mode of a warp."""

    method: Method
    geometry: Geometry
    shape: Size  # of the target: height, width
    edge: str  # an `Edge`, or `REFLECT_101`
    threads: int | None = None
    as_light: bool = False  # the result is float light, whatever the source's type
    has_gaps: bool | None = None  # whether some values are not finite; None: unknown
    behind: NDArray[Any] | None = None  # (h, w, C) or (1, 1, C) background, of the source's type
    fill: Any = None  # value where nothing covers a pixel, others are means; None: premultiplied
    linear_light: AnyLight | None = None  # as `warp` takes it; likewise `alpha`
    alpha: AnyAlpha | None = None

    def stored(self, warped: Warped, encoding: Encoding, part: Any = np.s_[:, :]) -> Warped:
        """Return a part of the target as a picture of the source's type, over the background."""
        if self.behind is None:
            return finished(warped, encoding, self.fill)
        plain = kept(warped, encoding.gaps)
        behind = np.broadcast_to(self.behind, (*self.shape, self.behind.shape[2]))[part]
        image = encoded(plain.image, plain.coverage, encoding, missing=plain.missing, behind=behind)
        return Warped(image, warped.coverage)


def drawn(image: NDArray[Any], drawing: Drawing) -> Warped:
    """Warp a picture (H, W) or (H, W, C), masked or not; coverage is 0 without values."""
    if image.dtype.kind == "c":
        return _drawn_complex(image, drawing, drawn)
    image, drawing = continued(image, drawing)
    picks = copied(image, drawing)
    if picks is not None:
        if drawing.behind is not None:
            # Copy texels, value for value, over the background.
            planes = image.reshape(*image.shape[:2], -1)
            form = (*picks.coverage.shape, *image.shape[2:])
            is_there = (picks.coverage >= LEAST)[..., None]
            row, column = np.broadcast_arrays(picks.row, picks.column)
            shown = np.where(is_there, np.ma.getdata(planes)[row, column], drawing.behind)
            shown = shown.astype(image.dtype, copy=False).reshape(form)
            if isinstance(image, np.ma.MaskedArray):
                hidden = (np.ma.getmaskarray(planes)[row, column] & is_there).reshape(form)
                shown = masked(shown, hidden, image.fill_value)
            return Warped(shown, picks.coverage)
        moved = picked(image, picks, drawing.alpha)
        if drawing.fill is not None:
            return filled(moved, drawing.fill)
        if drawing.as_light:
            if moved.image.dtype.kind == "f":
                return Warped(moved.image.astype(np.float32), moved.coverage)
            choices: dict[str, Any] = {"linear_light": drawing.linear_light, "alpha": drawing.alpha}
            return Warped(decoded(moved.image, **choices)[0], moved.coverage)
        return moved
    # Whether a picture is large enough to be drawn in parts, to save memory.
    channels = math.prod(image.shape[2:])
    if (math.prod(image.shape[:2]) + math.prod(drawing.shape)) * channels > MOST_AT_ONCE:
        parts = parts_of(image, drawing)
        if parts is not None:
            return drawn_in_parts(image, drawing, parts)
    if math.prod(image.shape[:2]) + math.prod(drawing.shape) <= FEW:
        drawing = drawing._replace(threads=1)  # to wake another takes longer
    from resample.engine import jit

    with jit.threads(drawing.threads):
        return _drawn_whole(image, drawing)


def prepared(drawing: Drawing, size: Size) -> Drawing:
    """Prepare the method for many pictures (height, width), if it can and handles the edge."""
    method: Any = drawing.method
    if not hasattr(method, "planned") or drawing.edge == REFLECT_101 or 0 in size:
        return drawing
    quick = method.planned(size, drawing.geometry, drawing.shape, Edge(drawing.edge))
    return drawing._replace(method=quick)


def _drawn_whole(image: NDArray[Any], drawing: Drawing) -> Warped:
    """Warp a picture without windows."""
    if image.dtype.kind == "c":
        return _drawn_complex(image, drawing, _drawn_whole)
    is_sum, linear_light, alpha = adds(drawing.method), drawing.linear_light, drawing.alpha
    if not is_sum and light_for(linear_light, image.dtype) == "pixels":
        drawing = drawing._replace(method=in_levels(drawing.method))
        share = share_of_levels(drawing.method, drawing.geometry, drawing.shape, image.shape[:2])
        if share.any():
            return _drawn_in_levels(image, drawing, share)
    texels, encoding = decoded(image, linear_light=linear_light, alpha=alpha, is_sum=is_sum)
    encoding = encoding.as_light() if drawing.as_light else encoding
    warped = _run_with_gaps(drawing, texels, encoding.gaps)
    if encoding.gaps and is_sum:
        mean = dataclasses.replace(drawing.method, total=False)  # type: ignore[type-var]
        there = np.ascontiguousarray(texels[..., -encoding.gaps :])
        there = run(drawing._replace(method=mean), there).image
        coverage = np.clip(there, 0.0, warped.coverage[..., None]).max(axis=2)
        sums = warped.image[..., : -encoding.gaps]
        return _as_stored(Mended(sums, coverage, None), encoding)
    return drawing.stored(warped, encoding)


def _drawn_in_levels(image: NDArray[Any], drawing: Drawing, share: Floats) -> Warped:
    """Warp levels, and light where pixels average it; see `resample_texture.texels.encoding`."""
    texels, encoding = texels_in_levels(image, drawing.alpha)
    if image.dtype == np.uint8 and not encoding.is_straight and not drawing.as_light:
        share = spared(share, texels, drawing.geometry, drawing.shape)
    is_stored, is_alone = image.dtype.name in LEVELS, bool((share == 1.0).all())
    interpolating: Any = drawing.method
    averaging = interpolating
    if share.size > 1 and hasattr(averaging, "partly"):  # tiles that need one of them alone
        interpolating = interpolating.partly(share[..., 0] > 0.0)
        averaging = averaging.partly(share[..., 0] < 1.0)
    warped = _run_with_gaps(drawing._replace(method=interpolating), texels, encoding.gaps)
    averaged = None
    if not is_alone:
        light, _ = decoded(image, linear_light=True, alpha=drawing.alpha)
        averaged = _run_with_gaps(drawing._replace(method=averaging), light, encoding.gaps)
    if not is_stored or encoding.gaps or drawing.as_light or drawing.behind is not None:
        warped = mixed_light(warped, averaged, share, encoding)
        return drawing.stored(warped, encoding.as_light() if drawing.as_light else encoding)
    # Store levels as they are where they alone fill a pixel.
    made = drawing.stored(warped, encoding._replace(is_encoded=False))
    is_partly = (warped.coverage > 0.0) & (warped.coverage < 1.0)
    some = np.flatnonzero((share[..., 0] < 1.0) | is_partly)
    if some.size:
        share = np.broadcast_to(share, (*drawing.shape, 1)).reshape(-1, 1)[some]
        levels, rest = _at(warped, some), averaged and _at(averaged, some)
        mixed = drawing.stored(mixed_light(levels, rest, share, encoding), encoding)
        made.image.reshape(-1, *made.image.shape[2:])[some] = mixed.image[0]
        made.coverage.reshape(-1)[some] = mixed.coverage[0]
    return made


def _at(warped: Warped, some: Integers) -> Warped:
    """Some pixels (N,), by their number, as a row."""
    image = warped.image.reshape(-1, warped.image.shape[2])
    return Warped(image.take(some, axis=0)[None], warped.coverage.reshape(-1)[some][None])


def _drawn_complex(image: NDArray[Any], drawing: Drawing, draw: Callable[..., Warped]) -> Warped:
    """Draw real and imaginary parts as two channels."""
    behind, fill = drawing.behind, drawing.fill
    parts = drawing._replace(
        behind=None if behind is None else parts_of_complex(behind),
        fill=None if fill is None else math.nan,
        linear_light=False,
        alpha=Alpha.NONE,
    )
    warped = draw(parts_of_complex(image), parts)
    made = complex_of_parts(warped.image, image)
    if fill is not None and not (np.isnan(fill) or isinstance(made, np.ma.MaskedArray)):
        made[warped.coverage == 0.0] = fill
    return type(warped)(made, warped.coverage)


def finished(warped: Warped, encoding: Encoding, fill: Any = None) -> Warped:
    """Return warped texels as a picture of the source's type; see `Drawing.fill`."""
    plain = mended(warped, encoding.gaps)
    if fill is None:
        return _as_stored(plain, encoding)
    coverage = plain.coverage.reshape(*plain.image.shape[:2], -1)
    image = np.divide(plain.image, coverage, out=np.zeros_like(plain.image), where=coverage > 0.0)
    made = _as_stored(plain._replace(image=image, coverage=np.ones_like(coverage)), encoding)
    return filled(Warped(made.image, plain.coverage), fill)


def filled(warped: Warped, fill: Any) -> WarpedMeans:
    """Put a value, or a mask, in uncovered pixels."""
    image, is_empty = warped.image, warped.coverage == 0.0
    if isinstance(image, np.ma.MaskedArray):
        is_all = is_empty.reshape(is_empty.shape + (1,) * (image.ndim - is_empty.ndim))
        image = masked(image.data, np.ma.getmaskarray(image) | is_all, image.fill_value)
    else:
        image[is_empty] = fill
    return WarpedMeans(image, warped.coverage)


def _as_stored(plain: Mended, encoding: Encoding) -> Warped:
    result = encoded(plain.image, plain.coverage, encoding, missing=plain.missing)
    return Warped(result, plain.coverage)


def put(
    warped: Warped, nodata: complex | None, fill: complex | str | None, out: NDArray[Any] | None
) -> Warped:
    """Return a picture with `nodata`, or `fill` if given, for its mask, in an array if given."""
    image = warped.image
    if nodata is not None:
        image = np.ma.filled(image, nodata if fill is None or fill == PREMULTIPLIED else fill)
    if out is None:
        return type(warped)(image, warped.coverage)
    check_out(out, image.shape, image)
    out[...] = image
    return type(warped)(out, warped.coverage)


class DrawnParts(NamedTuple):
    """Parts in which a picture is drawn with little memory."""

    windows: VisibleTiles
    mixed: "MixedTiles | None" = None  # near and far tiles; far texels are projected


def parts_of(image: Any, drawing: Drawing) -> DrawnParts | None:
    """Return the parts of a sliceable picture; None if it is drawn whole."""
    from resample.engine import jit

    method, geometry, shape, edge, threads, *_ = drawing
    if isinstance(image, np.ma.MaskedArray) or not hasattr(method, "visible_tiles"):
        return None
    size = image.shape[0], image.shape[1]
    with jit.threads(threads):
        seen = method.visible_tiles(size, geometry, shape, Edge(edge))
        if seen is not None:
            return DrawnParts(seen)
        is_wide = image.dtype.name in WIDE or image.dtype.kind == "c"
        if is_wide or not hasattr(method, "mixed_tiles"):
            return None
        form = (*size, math.prod(image.shape[2:]))
        mixed = method.mixed_tiles(form, geometry, shape, Edge(edge))
    return None if mixed is None else DrawnParts(mixed.near, mixed)


def drawn_in_parts(image: Any, drawing: Drawing, parts: DrawnParts) -> Warped:
    """Warp a picture window by window; it need only support slices."""
    form = np.dtype(np.float32) if drawing.as_light else image.dtype
    result = Warped(
        np.empty((*drawing.shape, *image.shape[2:]), form), np.empty(drawing.shape, np.float32)
    )
    result = result if drawing.fill is None else WarpedMeans(*result)
    size, channels = (image.shape[0], image.shape[1]), math.prod(image.shape[2:])
    is_near: NDArray[np.bool_] | None = None
    if parts.mixed is not None:
        source = _Read(image, drawing)
        there = parts.mixed.far.part
        result.image[there], result.coverage[there] = source.projected(parts.mixed)
        is_near = np.zeros(drawing.shape, np.bool_)
        for left, top, right, bottom in parts.mixed.near.tiles[parts.mixed.is_near].tolist():
            is_near[top:bottom, left:right] = True
        drawing = drawing._replace(method=drawing.method.near)  # type: ignore[attr-defined]
    for window in windows_of(parts.windows, size, max(1, MOST_IN_WINDOW // channels)):
        there = window.target.part
        wanted: Any = np.s_[...] if is_near is None else is_near[there]
        if is_near is not None and not wanted.any():
            continue
        seen, part, inner = _part_of(image, drawing, window)
        drawn = _drawn_whole(seen, part)
        result.image[there][wanted] = drawn.image[inner][wanted]
        result.coverage[there][wanted] = drawn.coverage[inner][wanted]
    return result


class _Read:
    """Texels of a sliceable picture, decoded on demand."""

    def __init__(self, image: Any, drawing: Drawing) -> None:
        self.image, self.drawing = image, drawing
        self.channels = math.prod(image.shape[2:])
        has_gaps = drawing.has_gaps
        if has_gaps is None:  # look at all of it, some rows at a time
            height, width = image.shape[:2]
            ends = [*range(0, height, max(1, MOST_IN_WINDOW // math.prod(image.shape[1:]))), height]
            has_gaps = image.dtype.kind == "f" and not all(
                np.isfinite(image[slice(*rows), 0:width]).all() for rows in pairwise(ends)
            )
        self.gaps = self.channels if has_gaps else 0
        self.is_in_levels = False  # whether texels are levels

    @property
    def shape(self) -> tuple[int, int, int]:
        """Height, width and channels, including those that mark missing values."""
        return self.image.shape[0], self.image.shape[1], self.channels + self.gaps

    def read(self, rows: Integers, columns: Integers) -> Floats:
        """Return texels (R, K, C), see `resample_texture.texels.forward.TexelReader`."""
        found = np.empty((rows.size, columns.size, self.shape[2]), np.float32)
        for down, here in _stretches(rows):
            for across, there in _stretches(columns):
                found[here, there], _ = self._decoded(self.image[down, across])
        return found

    def projected(self, mixed: "MixedTiles") -> Warped:
        """Project the texels of the far tiles."""
        from resample.engine import jit

        drawing, there, share = self.drawing, mixed.far.part, np.zeros((1, 1, 1), np.float32)
        if light_for(drawing.linear_light, self.image.dtype) == "pixels":
            place = drawing.geometry, drawing.shape, self.shape[:2]
            share = share_of_levels(drawing.method, *place, there)
        with jit.threads(drawing.threads):
            warped = mixed.projected(self)
            _, encoding = self._decoded(self.image[0:1, 0:1])
            if share.any():
                levels = copy(self)
                levels.is_in_levels = True
                warped = mixed_light(mixed.projected(levels), warped, share, encoding)
            encoding = encoding.as_light() if drawing.as_light else encoding
            return drawing.stored(warped, encoding, there)

    def _decoded(self, part: NDArray[Any]) -> tuple[Floats, Encoding]:
        linear_light, alpha = self.drawing.linear_light, self.drawing.alpha
        if self.is_in_levels:
            return texels_in_levels(np.asarray(part), alpha, self.gaps)
        return decoded(np.asarray(part), linear_light=linear_light, alpha=alpha, gaps=self.gaps)


def _stretches(places: Integers) -> Iterator[tuple[slice, slice]]:
    """Yield runs of consecutive numbers, and their positions."""
    ends = [0, *(np.flatnonzero(np.diff(places) != 1) + 1).tolist(), places.size]
    for first, last in pairwise(ends):
        start = int(places[first])
        yield slice(start, start + last - first), slice(first, last)


def _part_of(
    image: Any, drawing: Drawing, window: PictureWindow
) -> tuple[NDArray[Any], Drawing, tuple[slice, slice]]:
    """Return a window's part of a picture, its drawing, and its part of the drawing."""
    size, (left, top, right, bottom) = (image.shape[0], image.shape[1]), window.target
    geometry, shape, inner = drawing.geometry, (bottom - top, right - left), np.s_[:, :]
    if isinstance(geometry, BackwardMap):
        roi = (left, top, right - left, bottom - top)
        geometry, shape, inner = within(geometry, drawing.shape, roi, drawing.method)
    assert not isinstance(geometry, ForwardMap)  # forward maps are not drawn in windows
    behind = drawing.behind
    if behind is not None and behind.shape[:2] != (1, 1):
        y, x = top - (inner[0].start or 0), left - (inner[1].start or 0)
        behind = behind[y : y + shape[0], x : x + shape[1]]
    part = drawing._replace(
        geometry=between(geometry, window, size, drawing.shape), shape=shape, behind=behind
    )
    if window.source.is_within(size):
        return image[window.source.part], part, inner
    # Continue the picture beyond its edges.
    left, top, right, bottom = window.source
    rows, _ = texels_at(np.arange(top, bottom), size[0], Edge(drawing.edge))
    columns, _ = texels_at(np.arange(left, right), size[1], Edge(drawing.edge))
    return image[rows[:, None], columns], part._replace(edge=Edge.CLAMP), inner


def continued(image: NDArray[Any], drawing: Drawing) -> tuple[NDArray[Any], Drawing]:
    """Turn `REFLECT_101` into an `Edge`: unfold the picture and wrap around."""
    if drawing.edge != REFLECT_101:
        return image, drawing
    geometry = drawing.geometry
    if isinstance(geometry, ForwardMap):  # only the source's own texels are placed
        return image, drawing._replace(edge=Edge.TRANSPARENT)
    if isinstance(geometry, Homography):
        size, region = (image.shape[0], image.shape[1]), geometry.region
        if region is not None:
            whole = Homography(region.whole.oriented(size), is_signed=True)
            region = region._replace(whole=whole)
        geometry = Homography(geometry.oriented(size), is_signed=True, region=region)
    return unfolded(image), drawing._replace(geometry=geometry, edge=Edge.WRAP)


def copied(image: NDArray[Any], drawing: Drawing) -> Picks | None:
    """Return the texel that each pixel copies; None if texels are mixed."""
    method, geometry, shape, edge, *_ = drawing
    check_picture(np.ma.getdata(image))
    if hasattr(method, "picks"):
        picks: Picks = method.picks(image, geometry, shape, Edge(edge))
        return picks
    if not getattr(method, "keeps_texels", False):
        return None
    move = None
    if isinstance(geometry, Homography):
        move = whole_move(geometry.matrix)
    elif isinstance(geometry, BackwardMap) and geometry.x.shape == shape:
        move = whole_shift(geometry.x, geometry.y)
    if move is None:
        return None
    return picks_of_move(move, (image.shape[0], image.shape[1]), shape, Edge(edge))


def picked(image: NDArray[Any], picks: Picks, alpha: AnyAlpha | None = None) -> Warped:
    """Copy texels value for value; missing ones are not covered."""
    values, mask = unmasked(image)
    planes = values.reshape(*values.shape[:2], -1)
    missing = missing_in(planes, mask, together=has_straight_alpha(planes, alpha))
    if missing is None and mask is None:
        return Warped(picks.of(values), picks.coverage)
    lost = picks.of(np.zeros(planes.shape, np.bool_) if missing is None else missing)
    nothing = lost.all(axis=2) | (picks.coverage == 0.0)
    result = picks.of(planes)
    result[lost] = np.nan if result.dtype.kind == "f" else 0
    result[nothing] = 0
    form = (*picks.coverage.shape, *values.shape[2:])
    result = result.reshape(form)
    if mask is not None:
        hidden = (lost | nothing[..., None]).reshape(form)
        result = masked(result, hidden, mask.fill_value)
    return Warped(result, np.where(nothing, np.float32(0), picks.coverage))


def _run_with_gaps(drawing: Drawing, texels: Floats, gaps: int) -> Warped:
    """Warp texels with last channels that mark existing values."""
    channels = texels.shape[2] - gaps
    # Up to four channels are warped alone, with the bits that they have without missing values.
    if gaps == 0 or channels > 4:
        return run(drawing, texels)
    values = run(drawing, np.ascontiguousarray(texels[..., :channels]))
    marks = texels[..., channels:]
    if channels > gaps == 1:  # one mark for all is summed as marks of each would be
        marks = np.repeat(marks, 2, axis=2)
    there = run(drawing, np.ascontiguousarray(marks)).image[..., :gaps]
    return Warped(np.concatenate([values.image, there], axis=2), values.coverage)


def run(drawing: Drawing, texels: Floats) -> Warped:
    """Warp texels on the given number of threads."""
    from resample.engine import jit

    method, geometry, shape, edge, threads, *_ = drawing
    with jit.threads(threads):
        return method(texels, geometry, shape, Edge(edge))
