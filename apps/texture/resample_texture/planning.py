"""Prepare a warp once, apply it to many pictures."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.cameras.models import AnyConvention
from resample.words import check_threads
from resample_texture.arguments import (
    Places,
    check_shape,
    edge_named,
    fill_for,
    geometry_of,
    method_named,
    whole_pair,
    without_nodata,
)
from resample_texture.drawing import MOST_AT_ONCE, Drawing, drawn, prepared, put, with_nodata
from resample_texture.geometry.mappings import Geometry
from resample_texture.stacks import axis_of, stacked
from resample_texture.types import (
    FRAMES,
    AnyAlpha,
    AnyAxis,
    AnyEdge,
    AnyLight,
    Fill,
    Method,
    Warped,
)


class Plan:
    """A prepared warp of pictures of one size, e.g. to undistort the frames of a film.

    Parameters
    ----------
    matrix, shape, method, edge, convention, inverse
        As `warp` takes them. A function is called once.
    source_shape
        Height and width of the pictures, px.

    Raises
    ------
    ValueError, LookupError
        As `warp` does.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_texture import Plan
    >>> plan = Plan(np.diag([2.0, 2.0, 1.0]), (40, 60), (20, 30))
    >>> plan(np.ones((20, 30), np.float32)).image.shape
    (40, 60)
    """

    def __init__(
        self,
        matrix: ArrayLike | Geometry | Places,
        shape: tuple[int, int],
        source_shape: tuple[int, int],
        method: str | Method = "hybrid",
        *,
        edge: AnyEdge = "transparent",
        convention: AnyConvention = "corner",
        inverse: bool = False,
    ) -> None:
        self.shape = whole_pair(shape, "height", "width")
        self.source_shape = whole_pair(source_shape, "height", "width")
        check_shape(self.shape)
        check_shape(self.source_shape)
        border = edge_named(edge)
        geometry = geometry_of(matrix, self.shape, convention, inverse)
        self._drawing = Drawing(method_named(method), geometry, self.shape, border)
        self._quick = prepared(self._drawing, self.source_shape)

    def __call__(
        self,
        image: NDArray[Any],
        *,
        axis: AnyAxis | None = None,
        linear_light: AnyLight | None = None,
        alpha: AnyAlpha | None = None,
        nodata: complex | None = None,
        fill: Fill | None = None,
        threads: int | None = None,
        out: NDArray[Any] | None = None,
    ) -> Warped:
        """Warp a picture.

        Parameters
        ----------
        image
            A picture of `source_shape`, or a stack of them. It and all options are as `warp` takes
            them.

        Returns
        -------
        What `warp` returns.

        Raises
        ------
        ValueError
            The picture has another size or is invalid.
        """
        check_threads(threads)
        image = image if isinstance(image, np.ma.MaskedArray) else np.asarray(image)
        is_stack = axis_of(image, axis) == FRAMES
        image = without_nodata(image, nodata)
        pictures = image if is_stack else image[np.newaxis]
        if pictures.shape[1:3] != self.source_shape:
            raise ValueError(f"the plan is for pictures of {self.source_shape}, not {image.shape}")
        channels = pictures[0, 0, 0].size
        values = pictures[0].size + channels * self.shape[0] * self.shape[1]
        drawing = self._quick if values <= MOST_AT_ONCE else self._drawing
        filling = fill_for(fill, pictures[0], alpha, self._drawing.method)
        drawing = drawing._replace(threads=threads, fill=filling)
        light: dict[str, Any] = {"linear_light": linear_light, "alpha": alpha}
        each = [drawn(picture, drawing, **light) for picture in pictures]
        warped = stacked(each, image) if is_stack else each[0]
        if nodata is not None:
            warped = with_nodata(warped, nodata, fill)
        return warped if out is None else put(warped, out)
