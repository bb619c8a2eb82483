"""Scenes: prepared once, rendered often; previews, and picking."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import AnyCamera, Camera
from resample.progress import Cancel, cancellable, watched_cancel
from resample.types import Doubles, Frame, View

Quality = Literal["final", "preview"]
LITTLE = 16  # px per side of pictures that only prepare


def is_quick(quality: str) -> bool:
    """Return whether a quality is the previews'; reject unknown ones."""
    if quality not in get_args(Quality):
        raise ValueError(f"quality {quality!r}; it can be {' or '.join(get_args(Quality))}")
    return quality == "preview"


class AnyScene:
    """Base of scenes: `resample_volume.Scene`, `resample_points.CloudScene` and so on.

    A scene defines `render` with its own view and choices, and `sample_ids` or `pick`; the view is
    what `render` takes without a name: a look and a camera, a matrix, a target.
    """

    def render(self, *view: Any, **choices: Any) -> Any:
        """Render a picture; `size` is in px, `quality` may be `preview`, `cancel` stops it."""
        raise NotImplementedError

    def sample_ids(self, *view: Any, **choices: Any) -> Any:
        """Return the indices (H, W, N) of the samples that pixels show; -1 where there is none."""
        raise NotImplementedError

    def prepare(self, *view: Any, **choices: Any) -> None:
        """Prepare the first picture of a view; parameters as in `render`, without `size`."""
        self.render(*view, size=(LITTLE, LITTLE), **choices)

    def preview(self, *view: Any, **choices: Any) -> Any:
        """Render quickly, from fewer samples and pixels; parameters as in `render`."""
        return self.render(*view, quality="preview", **choices)

    def finer(self, *view: Any, **choices: Any) -> Iterator[Any]:
        """Yield a preview, then the picture; parameters as in `render`."""
        yield self.preview(*view, **choices)
        yield self.render(*view, **choices)

    def pick(self, x: float, y: float, *view: Any, **choices: Any) -> Any:
        """Return the index of the sample shown at a point of the picture; None if there is none.

        `x`, `y`: right and down, px; centers of pixels are at halves. `view`, `choices`: as in
        `sample_ids`.
        """
        ids = self.sample_ids(*view, **choices)
        index = tuple(ids[pixel_at(ids.shape[1::-1], x, y)].tolist())
        return None if min(index) < 0 else index

    def cancel(self) -> None:
        """Stop all pictures of this scene that other threads render: they raise CancelledError."""
        for one in tuple(self._running):
            one.cancel()

    @cached_property
    def _running(self) -> set[Cancel]:
        """Signal that stops pictures being rendered."""
        return set()

    @contextmanager
    def _rendering(self, quality: str, cancel: Cancel | None) -> Iterator[bool]:
        """Let `cancel` stop the picture of a block; yield whether it is a preview."""
        is_preview = is_quick(quality)
        own = Cancel(cancel or watched_cancel())
        self._running.add(own)
        try:
            with cancellable(own):
                yield is_preview
        finally:
            self._running.discard(own)


def pixel_at(size: tuple[int, int], x: float, y: float) -> tuple[int, int]:
    """Row and column of the pixel at a position, px; positions beyond the edge get the last."""
    return min(int(y), size[1] - 1), min(int(x), size[0] - 1)


def lines_of(view: View, pixels: Doubles) -> tuple[Doubles, Doubles]:
    """Points (N, 3) at depth 0 of lines through pixels (N, 2), and their steps per depth."""
    on_plane = np.column_stack([(pixels - view.principal) / view.focal, np.zeros(len(pixels))])
    ahead = np.array([0.0, 0.0, 1.0])
    start = np.zeros_like(on_plane) if view.perspective else on_plane
    along = on_plane + ahead if view.perspective else np.broadcast_to(ahead, on_plane.shape)
    return (start - view.translation) @ view.rotation, along @ view.rotation


def position_at(view: View, pixel: tuple[int, int], depth: float) -> Doubles:
    """Scene position (3,) at a depth behind the center of a pixel, by its row and column.

    The camera's picture has no distortion.
    """
    row, column = pixel
    (start,), (ahead,) = lines_of(view, np.array([[column + 0.5, row + 0.5]]))
    return np.asarray(start + depth * ahead)


def place_at(camera: Camera, x: float, y: float, depth: float) -> Doubles | None:
    """Scene position (3,) at a depth behind a point of the picture; None if it is infinite."""
    if not np.isfinite(depth):
        return None
    ray = np.linalg.solve(camera.matrix, [x, y, 1.0])
    pose = camera.world_to_camera
    place: Doubles = pose[:3, :3].T @ (depth * ray / ray[2] - pose[:3, 3])
    return place


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
