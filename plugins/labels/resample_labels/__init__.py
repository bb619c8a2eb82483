"""Label pictures warped by the label that covers most of each pixel: the method `majority`."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.types import Floats
from resample_texture.geometry.mappings import ForwardMap, Geometry, Homography, places_of
from resample_texture.geometry.regions import Picks
from resample_texture.texels.encoding import missing_in, unmasked
from resample_texture.types import Edge, Warped

__all__ = ["Majority"]

MOST_CODES = 1 << 16  # range of labels that are numbered from the smallest, without sorting


@dataclass(frozen=True)
class Majority:
    """The label that covers most of each pixel; of equal ones the smallest.

    A label is a texel's value, or all its channels together. Areas are exact, from polygons; a
    backward map is taken to be linear within each pixel. Coverage is the share of a pixel that has
    a label.
    """

    def picks(
        self, image: NDArray[Any], geometry: Geometry, shape: tuple[int, int], edge: Edge
    ) -> Picks:
        from resample_labels.kernels.areas import (
            LabelPicture,
            LabelSource,
            PixelMapping,
            find_labels,
        )
        from resample_texture.texels.forward import EDGES

        height, width = image.shape[:2]
        code, count = codes_of(image)
        if isinstance(geometry, ForwardMap):
            raise ValueError(
                "majority takes a matrix or a backward map; for forward maps use hybrid"
            )
        if isinstance(geometry, Homography):
            inverse = np.linalg.inv(geometry.oriented((height, width)))
            mapping = PixelMapping(np.asarray(inverse, np.float64), np.zeros((6, 0, 0)))
        else:
            mapping = PixelMapping(np.eye(3), places_of(geometry, shape))
        # The first texel with the most common label; -1 if all are missing.
        numbers = np.bincount(code[code >= 0], minlength=count)
        common = int(np.argmax(code.ravel() == numbers.argmax())) if numbers.any() else -1
        labels = LabelSource(code, count, common, EDGES[edge])
        found = LabelPicture(np.zeros(shape, np.int64), np.zeros(shape, np.float32))
        find_labels(mapping, labels, found)
        return Picks(found.texel // width, found.texel % width, found.coverage)

    def __call__(
        self, source: Floats, geometry: Geometry, shape: tuple[int, int], edge: Edge
    ) -> Warped:
        picks = self.picks(source, geometry, shape, edge)
        return Warped(picks.of(source) * picks.coverage[..., None], picks.coverage)


def codes_of(image: NDArray[Any]) -> tuple[NDArray[np.int32], int]:
    """Number the labels (H, W) from 0 in their order, −1 if missing; also return the count.

    `image`: (H, W), or (H, W, C) with labels that are compared channel by channel; masked or not.
    """
    values, mask = unmasked(image)
    planes = values.reshape(*values.shape[:2], -1)
    missing = missing_in(planes, mask, together=True)
    gap = np.zeros(planes.shape[:2], np.bool_) if missing is None else missing[..., 0]
    known = planes[~gap]
    code = np.full(planes.shape[:2], -1, np.int32)
    if known.size == 0:
        return code, 1
    if planes.shape[2] == 1 and planes.dtype.kind in "bui":
        low, high = int(known.min()), int(known.max())
        if high - low < MOST_CODES:
            steps = known[:, 0].astype(np.int64 if low < 0 else np.uint64)
            code[~gap] = (steps - steps.dtype.type(low)).astype(np.int32)
            return code, high - low + 1
    axis = None if planes.shape[2] == 1 else 0
    labels, inverse = np.unique(known, axis=axis, return_inverse=True)
    code[~gap] = inverse.ravel()
    return code, len(labels)
