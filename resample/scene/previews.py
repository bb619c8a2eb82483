"""Previews: pictures of fewer pixels, enlarged to full size."""

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import AnyCamera
from resample.types import Frame, View

PER = 2  # pixels per side of a picture that its preview merges
RESIZED = ("uint8", "uint16", "int16", "float32", "float64")  # types that OpenCV resizes


def preview_size(size: tuple[int, int]) -> tuple[int, int]:
    """Size of a preview: half as many pixels along each axis, see `PER`."""
    return -(-size[0] // PER), -(-size[1] // PER)


@dataclass(frozen=True, eq=False)
class Shrunk:
    """A camera for a picture of fewer pixels."""

    camera: AnyCamera
    per: int  # px per side that become one

    def view(self) -> View:
        view = self.camera.view()
        return view._replace(focal=view.focal / self.per, principal=view.principal / self.per)


def enlarged(part: NDArray[Any], per: int, shape: tuple[int, int], *, smooth: bool) -> NDArray[Any]:
    """Enlarge each pixel of a picture (h, w) or (h, w, C) to `per` × `per` pixels.

    `shape`: height and width of the result, px; the excess is cropped.
    """
    import cv2

    height, width = part.shape[:2]
    if part.dtype.name in RESIZED and part[0, 0].size <= 4:
        kind = cv2.INTER_LINEAR if smooth else cv2.INTER_NEAREST
        large = cv2.resize(part, (width * per, height * per), interpolation=kind)
    else:
        large = part.repeat(per, axis=0).repeat(per, axis=1)
    whole = large.reshape(height * per, width * per, *part.shape[2:])
    return np.ascontiguousarray(whole[: shape[0], : shape[1]])


def enlarged_frame(frame: Frame, per: int, shape: tuple[int, int]) -> Frame:
    """Upsample a picture: light is interpolated, depths and values are not.

    `per`: pixels per side that one becomes. `shape`: height and width of the result, px; anything
    beyond is cropped.
    """
    smooth = partial(enlarged, per=per, shape=shape, smooth=True)
    alike = partial(enlarged, per=per, shape=shape, smooth=False)
    return frame._replace(
        rgba=smooth(frame.rgba),
        coverage=smooth(frame.coverage),
        depth=alike(frame.depth),
        first_depth=alike(frame.first_depth),
        value=None if frame.value is None else alike(frame.value),
    )
