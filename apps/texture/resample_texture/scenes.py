"""Open a picture once, warp it often: previews, and the texels that pixels show."""

import dataclasses
import math
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.calling import takes
from resample.cameras.models import AnyConvention
from resample.messages import shape_of
from resample.progress import Cancel
from resample.scene import PER, AnyScene, Quality, enlarged
from resample.types import Floats
from resample_texture.arguments import (
    PREMULTIPLIED,
    Places,
    check_shape,
    edge_named,
    geometry_of,
    given_pictures,
    method_named,
)
from resample_texture.drawing import Drawing, finished, run
from resample_texture.geometry.mappings import (
    BackwardMap,
    ForwardMap,
    Geometry,
    Homography,
    Size,
    source_coordinates,
)
from resample_texture.texels.encoding import (
    Encoding,
    curved,
    decoded,
    light_for,
    mixed_light,
    texels_in_levels,
)
from resample_texture.types import (
    AnyAlpha,
    AnyAxis,
    AnyEdge,
    AnyLight,
    Edge,
    Method,
    PictureSceneOptions,
    Previewed,
    Warped,
)
from resample_texture.warping import warp

# Options of methods that previews check but ignore, and their names in `warp`.
UNUSED = {name: name for name in ("filter", "interpolation", "total")} | {"detail": "quality"}
MOST_CHANNELS = 4  # that OpenCV shrinks in one call
GRID = 16  # samples per axis at which the scale of a warp is estimated


class PictureScene(AnyScene):
    """A picture for many warps, by other geometries and methods, with quick previews.

    Parameters
    ----------
    given
        What `resample.files.conversion.as_picture` takes.
    linear_light, alpha, axis
        As `warp` takes them, but no stack.

    Raises
    ------
    TypeError, ValueError, OSError
        As `as_picture` does, or the array is not a picture.

    Examples
    --------
    >>> import numpy as np
    >>> scene = PictureScene(np.zeros((30, 40, 3), np.uint8))
    >>> scene.render(np.diag([0.5, 0.5, 1]), size=(20, 15))
    Warped(15 × 20 × 3 uint8, 100 % covered)
    """

    def __init__(
        self,
        given: Any,
        *,
        linear_light: AnyLight | None = None,
        alpha: AnyAlpha | None = None,
        axis: AnyAxis | None = None,
    ) -> None:
        picture = given_pictures(given, axis, kinds="biuf")
        picture.check_alone("a scene")
        self.image, self._axis = picture.values, picture.axis
        light = light_for(linear_light, self.image.dtype, picture.is_encoded)
        self._light: dict[str, Any] = {"linear_light": light, "alpha": alpha}
        self._levels: list[Floats] = []  # the texels, and the levels of their 2 × 2 pyramid
        self._encoding: Encoding | None = None

    @takes(PictureSceneOptions)
    def render(
        self,
        matrix: ArrayLike | Geometry | Places,
        *,
        size: Size | None = None,
        method: str | Method = "hybrid",
        edge: AnyEdge = "transparent",
        quality: Quality = "final",
        cancel: Cancel | None = None,
        **choices: Unpack[PictureSceneOptions],
    ) -> Warped:
        """Warp the picture.

        Parameters
        ----------
        matrix, method, edge
            As `warp` takes them.
        size
            Width and height of the target, px. Default: the picture's.
        quality
            `preview` samples a reduced level of the picture at every other pixel, whatever the
            method; the result's `is_preview` is true.
        cancel
            Cancels the warp from another thread.
        choices
            `convention`, `inverse`, `filter`, `interpolation`, `quality` as `detail`, `total`,
            `fill` (by default `premultiplied`), `nodata`, `roi` and `threads` of `warp`.

        Raises
        ------
        ValueError, LookupError
            As `warp` does.
        resample.CancelledError
            The warp was cancelled.
        """
        shape = self._shape(size)
        with self._rendering(quality, cancel) as is_preview:
            if is_preview:
                convention, inverse = choices.get("convention", "corner"), choices.get("inverse")
                if "roi" in choices:
                    raise ValueError("a preview has no roi; leave it out")
                unused = {UNUSED[name]: of for name, of in choices.items() if name in UNUSED}
                method_named(method, **unused)
                check_shape(shape)
                geometry = geometry_of(matrix, shape, convention, bool(inverse))
                return self._preview(geometry, shape, edge)
            given: dict[str, Any] = {"fill": PREMULTIPLIED, "axis": self._axis, **choices}
            if "detail" in given:
                given["quality"] = given.pop("detail")
            return warp(self.image, matrix, shape, method, edge=edge, **self._light, **given)

    def sample_ids(
        self,
        matrix: ArrayLike | Geometry | Places,
        *,
        size: Size | None = None,
        edge: AnyEdge = "transparent",
        convention: AnyConvention = "corner",
        inverse: bool = False,
    ) -> NDArray[np.int32]:
        """Return the texel at each pixel's center.

        Parameters
        ----------
        matrix, size, edge, convention, inverse
            As `render` takes them.

        Returns
        -------
        (H, W, 2) row and column of the source; -1 outside the source.

        Raises
        ------
        ValueError
            The geometry is a forward map, or an option is invalid.
        """
        rows, columns = self.image.shape[:2]
        index = np.arange(rows * columns, dtype=np.int64).reshape(rows, columns)
        shape = self._shape(size)
        place: dict[str, Any] = {"edge": edge, "convention": convention, "inverse": inverse}
        found = warp(index, matrix, shape, "nearest", **place)
        row, column = np.divmod(found.image, columns)
        ids = np.stack([row, column], axis=-1).astype(np.int32)
        ids[found.coverage == 0] = -1
        return ids

    @property
    def _is_in_levels(self) -> bool:
        return bool(self._light["linear_light"] == "pixels")

    def _shape(self, size: Size | None) -> tuple[int, int]:
        return (self.image.shape[0], self.image.shape[1]) if size is None else shape_of(size)

    def _preview(self, geometry: Geometry, shape: Size, edge: str) -> Previewed:
        """Sample a reduced level at every other pixel, and enlarge that to the target."""
        border = Edge.MIRROR if edge_named(edge) not in list(Edge) else Edge(edge)
        size, small = self.image.shape[:2], (-(-shape[0] // PER), -(-shape[1] // PER))
        method, level = "hybrid", 0
        if not isinstance(geometry, ForwardMap):  # which needs the texels themselves
            # Take the level that has about one texel per pixel of the preview.
            per = PER * _texels_per_pixel(geometry, shape, (size[0], size[1]))
            most = int(math.log2(max(1, min(size))))
            method, level = "bilinear", min(most, max(0, math.floor(math.log2(max(per, 1.0)))))
        texels, encoding = self._texels(level)
        # Lead from that level to the preview's pixels.
        across, down = size[1] / texels.shape[1], size[0] / texels.shape[0]
        if isinstance(geometry, Homography):
            source, target = np.diag([across, down, 1.0]), np.diag([1 / PER, 1 / PER, 1.0])
            geometry = dataclasses.replace(geometry, matrix=target @ geometry.matrix @ source)
        elif isinstance(geometry, BackwardMap):
            # Average the map over the pixels that become one.
            more = [
                (0, PER * count - whole)
                for count, whole in zip(small, geometry.x.shape, strict=True)
            ]
            x, y = (
                np.pad(places, more, mode="edge").reshape(small[0], PER, small[1], PER)
                for places in (geometry.x, geometry.y)
            )
            geometry = BackwardMap(x.mean(axis=(1, 3)) / across, y.mean(axis=(1, 3)) / down)
        else:
            geometry = ForwardMap(geometry.x / PER, geometry.y / PER)
        warped = run(Drawing(method_named(method), geometry, small, border), texels)
        if self._is_in_levels:
            warped = mixed_light(warped, None, np.ones((1, 1, 1), np.float32), encoding)
        made = finished(warped, encoding)
        image, coverage = (enlarged(np.ma.getdata(part), PER, shape, smooth=True) for part in made)
        return Previewed(image, coverage)

    def _texels(self, level: int) -> tuple[Floats, Encoding]:
        """Return a level of the texels' pyramid, and their encoding."""
        if self._encoding is None:
            if self._is_in_levels:
                texels, self._encoding = texels_in_levels(self.image, self._light["alpha"])
            else:
                texels, self._encoding = decoded(self.image, **self._light)
            self._levels = [texels]
        while len(self._levels) <= level:
            # Light is averaged, and interpolated as levels.
            texels, encoding = self._levels[-1], self._encoding
            height, width = max(1, texels.shape[0] // 2), max(1, texels.shape[1] // 2)
            if self._is_in_levels:
                light = curved(texels, None, encoding, is_back=True)
                texels = curved(shrunk(light, height, width), None, encoding)
            else:
                texels = shrunk(texels, height, width)
            self._levels.append(texels)
        return self._levels[level], self._encoding


def _texels_per_pixel(geometry: Homography | BackwardMap, shape: Size, source_shape: Size) -> float:
    """Return the side of a pixel in texels, the median over the visible source."""
    if isinstance(geometry, BackwardMap):
        rows, columns = (max(1, count // GRID) for count in shape)
        x, y = geometry.x[::rows, ::columns], geometry.y[::rows, ::columns]
        step = (float(rows), float(columns))
    else:
        per = np.diag([shape[1] / GRID, shape[0] / GRID, 1.0])
        coarse = Homography(np.linalg.inv(per) @ geometry.matrix, geometry.is_signed)
        x, y = source_coordinates(coarse, (GRID, GRID), source_shape)
        step = (shape[0] / GRID, shape[1] / GRID)
    if min(x.shape) < 2:
        return 1.0
    (x_down, x_across), (y_down, y_across) = (np.gradient(part, *step) for part in (x, y))
    area = np.abs(x_across * y_down - y_across * x_down)
    inside = np.isfinite(area) & (x > 0) & (x < source_shape[1]) & (y > 0) & (y < source_shape[0])
    return float(np.sqrt(np.median(area[inside]))) if inside.any() else 1.0


def shrunk(picture: Floats, height: int, width: int) -> Floats:
    """Shrink a picture (H, W, C) to (height, width, C) by box means."""
    import cv2

    result = np.empty((height, width, picture.shape[2]), np.float32)
    for first in range(0, picture.shape[2], MOST_CHANNELS):
        part = np.ascontiguousarray(picture[..., first : first + MOST_CHANNELS])
        small = cv2.resize(part, (width, height), interpolation=cv2.INTER_AREA)
        result[..., first : first + MOST_CHANNELS] = small.reshape(height, width, -1)
    return result
