"""Warping methods: points, splats, the hybrid, and nearest texels (group `methods`)."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeGuard

import numpy as np
from numpy.typing import NDArray

from resample.messages import number
from resample.registry import plugin_of
from resample.types import Floats
from resample_texture.geometry.mappings import (
    BackwardMap,
    ForwardMap,
    Geometry,
    Homography,
    Size,
    source_coordinates,
)
from resample_texture.geometry.regions import Picks, VisibleTiles, nearest_texels
from resample_texture.texels.encoding import in_levels
from resample_texture.types import Edge, Method, Warped

if TYPE_CHECKING:
    from resample_texture.texels.forward import CellGrid
    from resample_texture.texels.gather import GatherPlan, MixedTiles

MOST_AROUND = 1 << 30  # px of a target with all blocks searched, for a region of it
LARGEST_QUALITY = 16.0
# Rms errors of white noise from 0 to 1 under the area filter, in the worst of 60 views, and from
# which quality on they hold.
ERRORS = {1.0: 0.018, 2.0: 0.0067, 4.0: 0.0034, 6.0: 0.0022, 8.0: 0.0014, 16.0: 0.0007}


@dataclass(frozen=True)
class Hybrid:
    """Points where texels shrink; where they grow, parts of texels as points, or splats.

    Under the area filter a pixel that covers few texels collects what they leave in it; where it
    covers many, and under other filters, for sums and along forward maps, texels are projected.
    They are cut along each axis until their parts are no longer than 1 / `quality` px, and joined
    with their neighbours where they are far smaller than that: cost follows the screen. A texel
    that is not cut is the paper's point (section 3).

    Parameters
    ----------
    filter
        Pixel filter, by name or as an object; `area` knows each part's extent.
    interpolation
        Interpolation between texels, by name or as an object.
    quality
        Parts per px, 1 to 16; under the area filter twice as many.
    magnified
        `cells` or `splats`: what magnified texels become. Splats are interpolating elliptical
        Gaussians, which take no other interpolation and no other filter than a Gaussian.
    total
        A texel's value is a total, such as a flux: sums are kept, not means.
    clamp
        Keep values within the source's range, which sharp interpolations overshoot at hard edges.
    error
        Instead of a quality: the rms error, as a share of the source's range, that white noise may
        have, 0.0007 or more. Pictures have far less.
    average
        `always`: a pixel is the mean over its footprint. `shrinking`: only where it covers
        more than a texel is it a mean, over the excess; elsewhere it is the
        interpolation's value at its center, as OpenCV, SciPy and scikit-image have it. Forward maps
        average always.

    Raises
    ------
    ValueError, LookupError
        A choice is unknown or out of its range.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_texture import Hybrid, warp
    >>> checks = np.tile(np.uint8([[0, 255], [255, 0]]), (16, 16))
    >>> sharp = Hybrid(filter="lanczos:a=3", quality=2)
    >>> warped = warp(checks, np.diag([0.25, 0.25, 1]), (8, 8), method=sharp)
    >>> np.unique(warped.image[2:-2, 2:-2]).tolist()  # levels of half the light
    [187, 188]
    """

    filter: Any = "area"
    interpolation: Any = "area-spline"
    quality: float = 1.5
    magnified: Literal["cells", "splats"] = "cells"
    total: bool = False
    clamp: bool = False
    error: float | None = None
    average: Literal["always", "shrinking"] = "always"

    def __post_init__(self) -> None:
        _build(self, "filter", "filters")
        _build(self, "interpolation", "interpolations")
        _check_quality(self.quality)
        given, least = self.error, min(ERRORS.values())
        if given is not None and not (isinstance(given, int | float) and least <= given < math.inf):
            raise ValueError(f"error is a share of the range, {least:g} or more, not {given!r}")
        if self.magnified not in ("cells", "splats"):
            raise ValueError(f"magnified texels become cells or splats, not {self.magnified!r}")
        _check_clamp(self.clamp, self.total)
        if self.average not in ("always", "shrinking"):
            raise ValueError(f"average is always or shrinking, not {self.average!r}")
        if self.average == "shrinking":
            if not self._takes_areas or self.magnified != "cells" or self.total:
                raise ValueError(
                    "average=shrinking interpolates under the area filter; leave filter, magnified"
                    " and total out"
                )
            if getattr(self.interpolation, "is_mean", False):
                raise ValueError(
                    f"{self.interpolation} takes texels for means, so it averages always; with"
                    " average=shrinking give bilinear, cubic, lanczos or spline"
                )

    @property
    def keeps_texels(self) -> bool:
        """Whether a shift by whole pixels leaves texels as they are."""
        from resample.profiles.filters import Area

        return isinstance(self.filter, Area) and self.magnified == "cells"

    @property
    def tile(self) -> int:
        """Side of a tile that gathers, px; regions consist of whole tiles."""
        from resample_texture.texels.gather import TILE

        return TILE if self._takes_areas and self.magnified == "cells" and not self.total else 1

    def visible_tiles(
        self, source_shape: Size, geometry: Geometry, shape: Size, edge: Edge
    ) -> VisibleTiles | None:
        """Return the visible part of a source for each tile of a target, (height, width) both.

        None if it is not known beforehand: tiles are not drawn alone.
        """
        if self.clamp or self.magnified != "cells" or not self.gathers(geometry):
            return None
        from resample_texture.texels.gather import visible_tiles

        return visible_tiles(source_shape, geometry, shape, edge, self.cells)

    def mixed_tiles(
        self, form: tuple[int, int, int], geometry: Geometry, shape: Size, edge: Edge
    ) -> "MixedTiles | None":
        """Split a target (height, width) into tiles that gather, and tiles of projected texels.

        `form`: height, width and channels of the source. None if there are none of the latter, or
        tiles are not drawn alone.
        """
        if self.clamp or self.magnified != "cells" or not self.gathers(geometry):
            return None
        if not isinstance(geometry, Homography):
            return None
        from resample_texture.texels.gather import mixed_tiles

        return mixed_tiles(form, geometry, shape, edge, self.cells)

    @property
    def near(self) -> Method:
        """Method for the tiles that gather alone."""
        return _Partly(self)

    def partly(self, wanted: NDArray[np.bool_]) -> Method:
        """Method for some of the pixels (height, width); others may stay empty."""
        return self if self.clamp else _Partly(self, wanted)

    def __call__(self, source: Floats, geometry: Geometry, shape: Size, edge: Edge) -> Warped:
        if self.magnified == "splats":
            from resample.profiles.filters import Area, Gaussian
            from resample_texture.texels.splatting import Splatting, splat

            if isinstance(self.filter, Area):  # the Gaussian that comes closest to a box
                sigma, filter_sigma = 0.55, 0.29
            elif isinstance(self.filter, Gaussian):
                sigma, filter_sigma = 0.577, self.filter.sigma
            else:
                raise ValueError(f"splats come under a Gaussian pixel filter, not {self.filter}")
            splatting = Splatting(
                sigma, filter_sigma, threshold=0.5, interpolating=True, is_sum=self.total
            )
            warped = splat(source, geometry, shape, edge, splatting)
        elif self.gathers(geometry):
            from resample_texture.texels.gather import gather, planned

            size = source.shape[0], source.shape[1]
            warped = gather(planned(size, geometry, shape, edge, self.cells), source)
        else:
            cells = self.cells.finer() if self._takes_areas else self.cells
            warped = _project(source, geometry, shape, edge, cells)
        return _clamped(warped, source) if self.clamp else warped

    def planned(self, source_shape: Size, geometry: Geometry, shape: Size, edge: Edge) -> Method:
        """Return a method for sources (height, width) and one target, with its plan.

        Raises
        ------
        ValueError
            A map has another shape than the picture.
        """
        if self.magnified != "cells" or not self.gathers(geometry):
            return self
        from resample_texture.texels.gather import planned

        return _Planned(self, planned(source_shape, geometry, shape, edge, self.cells))

    def gathers(self, geometry: Geometry) -> TypeGuard[Homography | BackwardMap]:
        """Whether pixels gather, and texels are projected only where they shrink."""
        return self._takes_areas and not (self.total or isinstance(geometry, ForwardMap))

    @property
    def _takes_areas(self) -> bool:
        from resample.profiles.filters import Area

        return isinstance(self.filter, Area)

    @property
    def cells(self) -> "CellGrid":
        """Splitting of texels into cells, and spreading of cells over pixels."""
        from resample_texture.texels.forward import CellGrid

        quality = self.quality
        if self.error is not None:
            quality = next(least for least, largest in ERRORS.items() if largest <= self.error)
        return CellGrid(
            self.filter,
            self.interpolation,
            quality,
            is_sum=self.total,
            shrinking=self.average == "shrinking",
        )


@dataclass(frozen=True)
class _Partly:
    """A hybrid that draws only some pixels, and others of their tiles."""

    method: Hybrid
    wanted: NDArray[np.bool_] | None = None  # (height, width); None: those that gather

    @property
    def in_levels(self) -> Method:
        """The same for levels, see `resample_texture.texels.encoding.in_levels`."""
        method: Any = in_levels(self.method)
        return _Partly(method, self.wanted)

    def __call__(self, source: Floats, geometry: Geometry, shape: Size, edge: Edge) -> Warped:
        from resample_texture.texels.gather import gather, planned

        if not self.method.gathers(geometry):
            return self.method(source, geometry, shape, edge)
        size = source.shape[0], source.shape[1]
        plan = planned(size, geometry, shape, edge, self.method.cells)
        return gather(plan, source, near_only=self.wanted is None, wanted=self.wanted)


@dataclass(frozen=True)
class _Planned:
    """A hybrid with a precomputed plan."""

    method: Hybrid
    plan: "GatherPlan"
    wanted: NDArray[np.bool_] | None = None  # (height, width) of the pixels that are drawn

    @property
    def keeps_texels(self) -> bool:
        """Whether a shift by whole pixels leaves texels as they are."""
        return self.method.keeps_texels

    @property
    def in_levels(self) -> Method:
        """The same for levels, see `resample_texture.texels.encoding.in_levels`."""
        method: Any = in_levels(self.method)
        return _Planned(method, self.plan._replace(cells=method.cells))

    def partly(self, wanted: NDArray[np.bool_]) -> Method:
        """Method for some of the pixels (height, width); others may stay empty."""
        return self if self.method.clamp else _Planned(self.method, self.plan, wanted)

    def __call__(self, source: Floats, geometry: Geometry, shape: Size, edge: Edge) -> Warped:
        from resample_texture.texels.gather import gather

        plan, size = self.plan, (source.shape[0], source.shape[1])
        is_other = geometry is not plan.geometry or edge != plan.edge
        if is_other or (size, shape) != (plan.size, plan.shape):
            raise ValueError(f"the plan is for pictures of {plan.size} that go another way")
        warped = gather(self.plan, source, wanted=self.wanted)
        return _clamped(warped, source) if self.method.clamp else warped


@dataclass(frozen=True)
class Points:
    """Every texel a point under a filter at each pixel; holes where texels grow.

    Ghazanfarpour and Peroche, A High-Quality Filtering Using Forward Texture Mapping, 1991 (paper,
    Figure 5a).

    Examples
    --------
    >>> import numpy as np
    >>> from resample_texture import Points, warp
    >>> larger = warp(np.ones((8, 8)), np.diag([8, 8, 1]), (64, 64), method=Points())
    >>> round(float((larger.coverage == 0).mean()), 2)  # holes
    0.75
    """

    filter: Any = "gaussian"
    total: bool = False

    def __post_init__(self) -> None:
        _build(self, "filter", "filters")

    def __call__(self, source: Floats, geometry: Geometry, shape: Size, edge: Edge) -> Warped:
        from resample_texture.texels.forward import CellGrid

        cells = CellGrid(self.filter, joined=0.0, cut=False, is_sum=self.total)
        return _project(source, geometry, shape, edge, cells)


@dataclass(frozen=True)
class Supersample:
    """Points, and where texels grow, sub-texels along the axis that does.

    What the paper's section 3 mentions, and leaves aside as expensive.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_texture import Supersample, warp
    >>> larger = warp(np.ones((8, 8)), np.diag([8, 8, 1]), (64, 64), method=Supersample())
    >>> int((larger.coverage == 0).sum())  # holes
    0
    """

    filter: Any = "gaussian"
    interpolation: Any = "bilinear"
    quality: float = 1.0
    total: bool = False

    def __post_init__(self) -> None:
        _build(self, "filter", "filters")
        _build(self, "interpolation", "interpolations")
        _check_quality(self.quality)

    def __call__(self, source: Floats, geometry: Geometry, shape: Size, edge: Edge) -> Warped:
        from resample_texture.texels.forward import CellGrid

        cells = CellGrid(
            self.filter, self.interpolation, self.quality, joined=0.0, is_sum=self.total
        )
        return _project(source, geometry, shape, edge, cells)


@dataclass(frozen=True)
class Splats:
    """Every texel an elliptical Gaussian: its own, projected, and the pixel's.

    Heckbert, Fundamentals of Texture Mapping and Image Warping, 1989; Chen, Dachille and Kaufman,
    Forward Image Mapping, 1999.

    Parameters
    ----------
    sigma
        Of a texel's Gaussian, texels.
    filter_sigma
        Of the pixel's Gaussian, px.
    interpolating
        Heights of the Gaussians such that their sum passes through the texels.
    clamp
        Keep values within the source's range, which interpolating splats overshoot at hard edges.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_texture import Splats, warp
    >>> dot = np.zeros((9, 9))
    >>> dot[4, 4] = 1.0
    >>> for method in (Splats(), Splats(interpolating=True)):
    ...     print(warp(dot, np.eye(3), (9, 9), method=method).mean[4, 3:6].round(2).tolist())
    [0.12, 0.32, 0.12]
    [0.12, 0.45, 0.12]
    """

    sigma: float = 0.5
    filter_sigma: float = 0.5
    interpolating: bool = False
    total: bool = False
    clamp: bool = False

    def __post_init__(self) -> None:
        for name in ("sigma", "filter_sigma"):
            if not 0.0 < number(name, getattr(self, name)) < math.inf:
                raise ValueError(f"{name} is a positive number, not {getattr(self, name)}")
        _check_clamp(self.clamp, self.total)

    def __call__(self, source: Floats, geometry: Geometry, shape: Size, edge: Edge) -> Warped:
        from resample_texture.texels.splatting import Splatting, splat

        splatting = Splatting(
            self.sigma, self.filter_sigma, interpolating=self.interpolating, is_sum=self.total
        )
        warped = splat(source, geometry, shape, edge, splatting)
        return _clamped(warped, source) if self.clamp else warped


@dataclass(frozen=True)
class NearestTexel:
    """The texel at each pixel's center; aliases where texels shrink."""

    def picks(self, image: NDArray[Any], geometry: Geometry, shape: Size, edge: Edge) -> Picks:
        if isinstance(geometry, ForwardMap):
            raise ValueError(
                "nearest takes a matrix or a backward map; for forward maps use hybrid"
            )
        source_shape = image.shape[0], image.shape[1]
        x, y = source_coordinates(geometry, shape, source_shape)
        return nearest_texels(x, y, source_shape, edge)

    def __call__(self, source: Floats, geometry: Geometry, shape: Size, edge: Edge) -> Warped:
        picks = self.picks(source, geometry, shape, edge)
        return Warped(picks.of(source) * picks.coverage[..., None], picks.coverage)


def _project(
    source: Floats, geometry: Geometry, shape: Size, edge: Edge, cells: "CellGrid"
) -> Warped:
    """Project cells to a picture or, along a backward map, collect them from it."""
    if isinstance(geometry, BackwardMap):
        from resample_texture.texels.gather import collect_from

        return collect_from(source, geometry, shape, edge, cells)
    from resample_texture.texels.forward import project

    region = geometry.region if isinstance(geometry, Homography) else None
    if region is None or math.prod(region.shape) > MOST_AROUND:
        return project(source, geometry, shape, edge, cells)
    sides = region.left, region.top, region.left + shape[1], region.top + shape[0]
    return project(source, region.whole, region.shape, edge, cells, wanted=sides)


def _clamped(warped: Warped, source: Floats) -> Warped:
    """Limit a picture to the source's range, times the coverage."""
    coverage = warped.coverage[..., None]
    low, high = source.min(axis=(0, 1)), source.max(axis=(0, 1))
    return Warped(np.clip(warped.image, low * coverage, high * coverage), warped.coverage)


def _check_clamp(clamp: bool, total: bool) -> None:
    if clamp and total:
        raise ValueError(
            "totals are conserved, so they cannot be clamped; leave one of the two out"
        )


def _build(method: Any, name: str, group: str) -> None:
    """Turn a method's plugin name into the plugin's object."""
    object.__setattr__(method, name, plugin_of(group, getattr(method, name), name))


def _check_quality(quality: float) -> None:
    if not isinstance(quality, int | float) or not 1.0 <= quality <= LARGEST_QUALITY:
        raise ValueError(f"quality lies between 1 and {LARGEST_QUALITY:g}, not at {quality!r}")
