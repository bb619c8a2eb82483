"""One picture drawn by one method: decoded, warped or copied texel by texel, with its gaps."""

import dataclasses
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Floats
from resample_texture.asking import REFLECT_101
from resample_texture.geometry.mappings import ForwardMap, Geometry, Homography
from resample_texture.geometry.shifts import Picks, picks_of_move, unfolded, whole_move
from resample_texture.texels.encoding import check_picture, decoded, encoded, is_together
from resample_texture.texels.gaps import added, masked, mended, missing_in, unmasked
from resample_texture.types import Edge, Method, Warped


class Drawing(NamedTuple):
    """What is to be done with a picture's texels."""

    method: Method
    geometry: Geometry
    shape: tuple[int, int]  # of the target: height, width
    edge: str  # an `Edge`, or `REFLECT_101`
    threads: int | None = None


def drawn(
    image: NDArray[Any], drawing: Drawing, *, linear_light: bool, alpha: str | None
) -> Warped:
    """Picture (H, W) or (H, W, C), masked or not, warped; coverage tells where values are."""
    image, drawing = continued(image, drawing)
    picks = copied(image, drawing)
    if picks is not None:
        return picked(image, picks, alpha)
    is_sum = adds(drawing.method)
    texels, encoding = decoded(image, linear_light=linear_light, alpha=alpha, is_sum=is_sum)
    warped = run(drawing, texels)
    if encoding.gaps and is_sum:
        mean = dataclasses.replace(drawing.method, total=False)  # type: ignore[type-var]
        there = np.ascontiguousarray(texels[..., -encoding.gaps :])
        plain = added(warped, run(drawing._replace(method=mean), there).image, encoding.gaps)
    else:
        plain = mended(warped, encoding.gaps)
    result = encoded(plain.image, plain.coverage, encoding, missing=plain.missing)
    return Warped(result, plain.coverage)


def continued(image: NDArray[Any], drawing: Drawing) -> tuple[NDArray[Any], Drawing]:
    """Picture and what to do with it, where `Edge` has a name for what lies beyond its edges."""
    if drawing.edge != REFLECT_101:
        return image, drawing
    geometry = drawing.geometry
    if isinstance(geometry, ForwardMap):  # it places the source's own texels and no others
        return image, drawing._replace(edge=Edge.TRANSPARENT)
    if isinstance(geometry, Homography):
        matrix = geometry.oriented((image.shape[0], image.shape[1]))
        geometry = Homography(matrix, is_signed=True)
    return unfolded(image), drawing._replace(geometry=geometry, edge=Edge.WRAP)


def copied(image: NDArray[Any], drawing: Drawing) -> Picks | None:
    """Texels that pixels show, if that is all that happens to them."""
    method, geometry, shape, edge, _ = drawing
    check_picture(np.ma.getdata(image))
    if hasattr(method, "picks"):
        picks: Picks = method.picks(image, geometry, shape, Edge(edge))
        return picks
    if not (isinstance(geometry, Homography) and getattr(method, "keeps_texels", False)):
        return None
    move = whole_move(geometry.matrix)
    if move is None:
        return None
    return picks_of_move(move, (image.shape[0], image.shape[1]), shape, Edge(edge))


def picked(image: NDArray[Any], picks: Picks, alpha: str | None = None) -> Warped:
    """Picture of copied texels, value for value; what is missing is not covered."""
    values, mask = unmasked(image)
    planes = values.reshape(*values.shape[:2], -1)
    missing = missing_in(planes, mask, together=is_together(planes, alpha))
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
        result = masked(result, hidden, mask.fill)
    return Warped(result, np.where(nothing, np.float32(0), picks.coverage))


def run(drawing: Drawing, texels: Floats) -> Warped:
    """Warp texels on so many threads, whose tasks are handed out one by one."""
    from resample.engine import jit

    method, geometry, shape, edge, threads = drawing
    with jit.threads(threads):
        return method(texels, geometry, shape, Edge(edge))


def adds(method: Method) -> bool:
    """Whether a method keeps sums instead of means."""
    return dataclasses.is_dataclass(method) and bool(getattr(method, "total", False))
