"""Warp with OpenImageIO."""

from dataclasses import dataclass

import numpy as np

from resample.types import Floats
from resample_comparisons.texture.common import check_name, finished
from resample_texture.geometry.mappings import Geometry, Homography, source_coordinates
from resample_texture.types import Edge, Warped

OIIO_WRAPS = {
    Edge.TRANSPARENT: "black",
    Edge.CLAMP: "clamp",
    Edge.WRAP: "periodic",
    Edge.MIRROR: "mirror",
}
OIIO_FILTERS = (
    *("box", "triangle", "gaussian", "sharp-gaussian", "catmull-rom", "blackman-harris", "sinc"),
    *("lanczos3", "radial-lanczos3", "nuke-lanczos6", "mitchell", "bspline", "disk", "cubic"),
    *("keys", "simon", "rifman"),
)


@dataclass(frozen=True)
class Warp:
    """OpenImageIO's `ImageBufAlgo.warp`; takes minutes if the horizon is in the frame."""

    compiles = False

    filter: str = "lanczos3"

    def __post_init__(self) -> None:
        check_name("filter", self.filter, OIIO_FILTERS)

    def __call__(
        self, source: Floats, geometry: Geometry, shape: tuple[int, int], edge: Edge
    ) -> Warped:
        if not isinstance(geometry, Homography):
            raise ValueError("oiio takes a matrix; for maps use bilinear or hybrid")
        is_hidden = np.isnan(source_coordinates(geometry, shape, source.shape[:2])[0])
        ones = np.ones((*source.shape[:2], 1), np.float32)
        texels = np.concatenate([source, ones], axis=2) if edge is Edge.TRANSPARENT else source
        import OpenImageIO

        result = OpenImageIO.ImageBufAlgo.warp(
            OpenImageIO.ImageBuf(texels),
            tuple(geometry.matrix.T.ravel()),
            filtername=self.filter,
            wrap=OIIO_WRAPS[edge],
            roi=OpenImageIO.ROI(0, shape[1], 0, shape[0], 0, 1, 0, texels.shape[2]),
        )
        if result.has_error:
            raise ValueError(f"OpenImageIO cannot warp this: {result.geterror()}")
        picture = np.asarray(result.get_pixels(OpenImageIO.FLOAT)).reshape(*shape, -1)
        picture[is_hidden] = 0.0
        if edge is Edge.TRANSPARENT:
            return finished(picture[..., :-1], picture[..., -1])
        return Warped(picture, (~is_hidden).astype(np.float32))
