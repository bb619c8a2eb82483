"""Open a depth image once, render it often: target-independent data are cached."""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample import registry
from resample.cameras.models import Camera, Orthographic
from resample.cameras.pixels import Equirectangular
from resample.messages import shape_of
from resample.profiles.filters import PixelFilter
from resample.progress import Cancel
from resample.scene import PER, AnyScene, Quality, enlarged
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.depth.refining.conditioning import Refine
from resample_warp3d.methods.hybrid import Hybrid, Preview
from resample_warp3d.projection_models import CameraModel, mapping_between, taken_by
from resample_warp3d.types import DepthImage, Equation, Method, Previewed, Source, Warped
from resample_warp3d.warping import Filling, as_light, filled, nearness_of, render

TO_SAMPLES = np.array([[PER, 0, 0.5 - PER / 2], [0, PER, 0.5 - PER / 2], [0, 0, 1]])
MOST_NAMED = 1 << 24  # largest number of samples that float32 can index


class DepthScene(AnyScene):
    """A depth image for many targets, cameras and methods, with quick previews.

    Properties of its surfaces (noise, links, refined depth, torn edges) are found once.

    Parameters
    ----------
    color, depth, source, noise, step, refine
        As `warp` takes them.

    Raises
    ------
    TypeError, ValueError, OSError
        As `warp` does.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import Camera, DepthScene
    >>> camera = Camera.from_fov(60, 24, 32)
    >>> scene = DepthScene(np.ones((24, 32, 3), np.uint8), np.full((24, 32), 2.0), camera)
    >>> scene.render(camera).image.shape
    (24, 32, 3)
    """

    def __init__(
        self,
        color: Any,
        depth: Any,
        source: Camera | Orthographic,
        *,
        noise: float | None = None,
        step: float | None = None,
        refine: Refine = "auto",
    ) -> None:
        light, nearness = as_light(color), nearness_of(depth)
        self.shape = light.shape[0], light.shape[1]
        image, self.camera = taken_by(source, DepthImage(light, nearness))
        self.source = prepare(image, noise=noise, step=step, refine=refine)
        self._methods: dict[str, Method] = {}  # by name; they cache what they found in the source
        self._few: Source | None = None  # for previews
        self._quick, self._coarse_cells = Preview(), Hybrid(quality=0.5)

    def render(
        self,
        target: CameraModel | ArrayLike,
        *,
        size: tuple[int, int] | None = None,
        method: str | Method = "hybrid",
        filter: str | PixelFilter | None = None,  # noqa: A002
        fill: bool | Filling = False,
        quality: Quality = "final",
        threads: int | None = None,
        cancel: Cancel | None = None,
    ) -> Warped:
        """Render the depth image for another camera.

        Parameters
        ----------
        target
            Camera; or a pose (3, 4) or (4, 4) from world to camera, for the source's camera.
        size, method, filter, fill, threads
            As `warp` takes them.
        quality
            `preview` shows the nearest sample at every other pixel, whatever the method; the
            result's `is_preview` is true.
        cancel
            Cancels the rendering from another thread.

        Raises
        ------
        ValueError, LookupError
            As `warp` does.
        resample.CancelledError
            The rendering was cancelled.
        """
        shape = self.shape if size is None else shape_of(size)
        sight = self._camera_model(target)
        with self._rendering(quality, cancel) as is_preview:
            chosen = method
            if isinstance(method, str):
                if method not in self._methods:
                    self._methods[method] = registry.build("warps", method)
                chosen = self._methods[method]
            if is_preview:
                return self._preview(sight, shape, threads)
            way = mapping_between(self.camera, sight, shape)
            seen = partial(render, equation=way, shape=shape, method=chosen, threads=threads)
            return filled(self.source, partial(seen, filter=filter), fill)

    def sample_ids(
        self, target: CameraModel | ArrayLike, *, size: tuple[int, int] | None = None
    ) -> NDArray[np.int32]:
        """Return the sample that covers most of each pixel.

        Parameters
        ----------
        target, size
            As `render` takes them.

        Returns
        -------
        (H, W, 2) row and column of the source; -1 where nothing is.

        Raises
        ------
        ValueError
            There are more than 16,777,216 samples.
        """
        rows, columns = self.shape
        if rows * columns > MOST_NAMED:
            raise ValueError(f"{rows} × {columns} samples; at most {MOST_NAMED} can be numbered")
        index = np.arange(rows * columns, dtype=np.float32).reshape(rows, columns, 1)
        shape = self.shape if size is None else shape_of(size)
        way = mapping_between(self.camera, self._camera_model(target), shape)
        named = render(self.source._replace(color=index), way, shape, Hybrid(labels=True))
        is_seen = named.coverage > 0
        share = np.where(is_seen, named.coverage, np.float32(1))
        row, column = np.divmod(np.rint(named.image[..., 0] / share).astype(np.int64), columns)
        ids = np.stack([row, column], axis=-1).astype(np.int32)
        ids[~is_seen] = -1
        return ids

    def _camera_model(self, target: Any) -> CameraModel:
        if isinstance(target, Camera | Orthographic | Equirectangular):
            return target
        try:
            pose = np.asarray(target, np.float64)
        except (TypeError, ValueError):
            pose = np.empty(0)
        if pose.shape not in ((3, 4), (4, 4)):
            raise TypeError(
                f"a target of {type(target).__name__}; give a camera, or a pose (3, 4) or (4, 4) "
                "from world to camera"
            )
        return self.camera.moved(pose)

    def _preview(
        self, sight: CameraModel, shape: tuple[int, int], threads: int | None
    ) -> Previewed:
        """Render nearest samples at every other pixel, and enlarge that to the target."""
        small = -(-shape[0] // PER), -(-shape[1] // PER)
        way = mapping_between(self.camera, sight, shape)
        per = np.diag([1 / PER, 1 / PER, 1.0])
        if isinstance(way, Equation):
            if self._few is None:  # every other sample, with the mean color of its block
                self._few = self.source
                color, nearness, place = self.source.color, self.source.nearness, self.source.place
                rows, columns = color.shape[0] // PER * PER, color.shape[1] // PER * PER
                if min(rows, columns) > 0:
                    parts = color[:rows, :columns]
                    parts = parts.reshape(rows // PER, PER, columns // PER, PER, -1)
                    image = DepthImage(
                        np.ascontiguousarray(parts.mean(axis=(1, 3)), np.float32),
                        np.ascontiguousarray(nearness[:rows:PER, :columns:PER]),
                        np.ascontiguousarray(place[:rows:PER, :columns:PER]),
                    )
                    noise, step = self.source.noise, self.source.step
                    self._few = prepare(image, noise=noise, step=step, refine="none")
            source, way = self._few, way.in_frame(per)
            if not source.place.size:
                way = Equation(way.matrix @ TO_SAMPLES, way.epipole)
            made = render(source, way, small, self._quick, threads)
        else:
            way = replace(way, frame=per @ way.frame)
            made = render(self.source, way, small, self._coarse_cells, threads)
        return Previewed(*(enlarged(part, PER, shape, smooth=False) for part in made))
