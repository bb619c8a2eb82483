"""Open a point cloud once, render it often; cameras that suit it."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import Camera, Orthographic
from resample.cameras.pixels import Equirectangular
from resample.cameras.viewpoints import Orbit, Spelled, Viewpoint, viewpoint_of
from resample.messages import shape_of
from resample.profiles.filters import PixelFilter
from resample.progress import Cancel
from resample.scene import PER, AnyScene, Quality, enlarged_frame, pixel_at, preview_size
from resample.types import Doubles, Frame
from resample_points.data.cloud import Cloud, check_cloud
from resample_points.files.readers import read_cloud
from resample_points.geometry.framing import FIELD, ball_around, framed, framed_together
from resample_points.geometry.spacing import Surfels, prepare_cloud
from resample_points.painting.bending import CloudView, ProjectedCamera, places_at, shrunken
from resample_points.painting.rendering import CloudStyle, index_cloud, render_cloud

FEW = 200_000  # most points of previews
Shape = tuple[int, int]  # height and width, px


class PickedPoint(NamedTuple):
    """A point of a surface that a picture shows."""

    position: Doubles  # (3,) scene units
    depth: float  # scene units


class CloudScene(AnyScene):
    """A point cloud for many cameras and styles, with quick previews.

    Parameters
    ----------
    given
        A cloud, the file of one, or the result of `prepare_cloud`.
    threads
        Most threads to use for the preparation.

    Raises
    ------
    ValueError, OSError
        As `read_cloud` and `prepare_cloud` do.

    Examples
    --------
    >>> import resample
    >>> from resample_points import CloudScene
    >>> scene = CloudScene(resample.sample_path("sample:knot-points"))
    >>> scene.render((30, 20), size=(64, 48)).rgba.shape
    (48, 64, 4)
    >>> scene.pick(0.5, 0.5, (30, 20), size=(64, 48)) is None
    True
    """

    def __init__(
        self, given: Cloud | Surfels | str | PathLike[str], *, threads: int | None = None
    ) -> None:
        check_cloud(given, Cloud | Surfels | str | PathLike)
        cloud = given if isinstance(given, Cloud | Surfels) else read_cloud(str(given))
        self.surfels: Surfels = (
            cloud if isinstance(cloud, Surfels) else prepare_cloud(cloud, threads=threads)
        )

    @cached_property
    def fewer(self) -> "CloudScene":
        """The scene of at most 200,000 points, each for several; for previews."""
        surfels = self.surfels
        per = -(-len(surfels.position) // FEW)
        if per < 2:
            return self
        return CloudScene(
            surfels._replace(
                position=np.ascontiguousarray(surfels.position[::per]),
                axes=np.ascontiguousarray(surfels.axes[::per] * np.float32(np.sqrt(per))),
                color=np.ascontiguousarray(surfels.color[::per]),
                source=np.ascontiguousarray(surfels.source[::per]),
            )
        )

    def camera(self, given: Spelled | CloudView, size: tuple[int, int]) -> CloudView:
        """Return the camera for a picture; angles alone fit the cloud to it."""
        if isinstance(given, Equirectangular | ProjectedCamera):
            return given
        start = viewpoint_of(given)
        if isinstance(start, Orbit) and start is not given:
            start = replace(start, fov=FIELD)
        camera: CloudView = camera_of(self.surfels, shape_of(size), start)
        return camera

    def render(
        self,
        camera: Spelled | CloudView = None,
        *,
        size: tuple[int, int] = (640, 480),
        style: CloudStyle | None = None,
        filter: str | PixelFilter | None = None,  # noqa: A002
        quality: Quality = "final",
        threads: int | None = None,
        cancel: Cancel | None = None,
    ) -> Frame:
        """Render the cloud.

        Parameters
        ----------
        camera
            Any that `render_cloud` takes; or a viewpoint around the cloud, which is fitted to the
            picture: an `Orbit`, (azimuth, elevation) with or without a zoom and a pan, a
            name such as `front`, `top` or `corner`; None: `Orbit()`.
        size, style, filter, threads
            See `render_cloud`.
        quality
            `preview` shows at most 200,000 points at every other pixel. Its statistics have
            `is_preview` set.
        cancel
            Cancels the picture from another thread.

        Raises
        ------
        ValueError
            As `render_cloud` does.
        resample.CancelledError
            It was cancelled.
        """
        eye = self.camera(camera, size)
        options: dict[str, Any] = {"style": style, "filter": filter, "threads": threads}
        with self._rendering(quality, cancel) as is_preview:
            if not is_preview:
                return render_cloud(self.surfels, eye, size=size, **options)
            few, eye = preview_size(size), shrunken(eye, PER)
            frame = render_cloud(self.fewer.surfels, eye, size=few, **options)
        frame = frame._replace(statistics=frame.statistics._replace(is_preview=True))
        return enlarged_frame(frame, PER, shape_of(size))

    def pick(
        self,
        x: float,
        y: float,
        camera: Spelled | CloudView = None,
        *,
        size: tuple[int, int] = (640, 480),
        **choices: Any,
    ) -> PickedPoint | None:
        """Return the visible point at a position of the picture; None if empty.

        Parameters
        ----------
        x, y
            Right and down, px; the pixel there is taken.
        camera, size, choices
            See `render`.
        """
        row, column = pixel_at(size, x, y)
        depth = self.render(camera, size=size, **choices).depth[row, column].astype(np.float64)
        if not np.isfinite(depth):
            return None
        pixel, eye = np.array([[column + 0.5, row + 0.5]]), self.camera(camera, size)
        return PickedPoint(places_at(eye, shape_of(size), pixel, depth[None])[0], float(depth))

    def indices(
        self,
        camera: Spelled | CloudView = None,
        *,
        size: tuple[int, int] = (640, 480),
        style: CloudStyle | None = None,
        threads: int | None = None,
    ) -> NDArray[np.int64]:
        """Return each pixel's point index, as `index_cloud` does; `camera` as in `render`."""
        eye = self.camera(camera, size)
        return index_cloud(self.surfels, eye, size=size, style=style, threads=threads)


def camera_of(surfels: Surfels | Cloud, shape: Shape, viewpoint: Viewpoint) -> Any:
    """Return the camera of a viewpoint; angles alone fit the cloud to the frame."""
    if not isinstance(viewpoint, Orbit):
        return sized(viewpoint, shape)
    camera = framed(
        surfels,
        size=shape[::-1],
        azimuth=viewpoint.azimuth,
        elevation=viewpoint.elevation,
        up=viewpoint.up,
        fov=viewpoint.fov,
    )
    zoom, (right, up) = viewpoint.zoom, viewpoint.pan  # in shares of the picture's shorter side
    if isinstance(camera, Orthographic):
        cx, cy = camera.cx + min(shape) * right, camera.cy - min(shape) * up
        return replace(camera, sx=zoom * camera.sx, sy=zoom * camera.sy, cx=cx, cy=cy)
    camera = _zoomed(camera, zoom)
    if (right, up) == (0.0, 0.0):
        return camera
    pose = camera.world_to_camera.copy()
    depth = float(pose[2, :3] @ ball_around(surfels)[0] + pose[2, 3])
    side = depth * min(shape) / camera.fx
    pose[:2, 3] += side * right, -side * up
    return camera.moved(pose)


def cameras_of(
    surfels: Surfels | Cloud, viewpoints: Sequence[Viewpoint], shape: Shape, *, steady: bool = False
) -> list[Any]:
    """Return the cameras of all frames; orbits keep one distance to the cloud's center.

    With `steady` it is the distance of steady pictures, which does not depend on the angles.
    """
    around = [viewpoint for viewpoint in viewpoints if isinstance(viewpoint, Orbit)]
    if len(around) < len(viewpoints):
        return [sized(viewpoint, shape) for viewpoint in viewpoints]
    if steady or around[0].fov == 0:
        ball = ball_around(surfels)
        return [each.around(ball, *shape) for each in around]
    first = around[0]
    cameras = framed_together(
        surfels,
        size=shape[::-1],
        angles=[(each.azimuth, each.elevation) for each in around],
        up=first.up,
        fov=first.fov,
    )
    wide = math.tan(math.radians(first.fov) / 2.0)
    return [
        _zoomed(camera, each.zoom * wide / math.tan(math.radians(each.fov) / 2.0))
        for camera, each in zip(cameras, around, strict=True)
    ]


def sized(viewpoint: Any, shape: Shape) -> Any:
    """Return the camera of a viewpoint without angles."""
    return viewpoint.sized(*shape) if hasattr(viewpoint, "sized") else viewpoint


def _zoomed(camera: Camera, zoom: float) -> Camera:
    matrix = camera.matrix.copy()
    matrix[:2, :2] *= zoom
    return replace(camera, matrix=matrix)


def film_job(cameras: Sequence[Any], shape: Shape, background: Any) -> dict[str, Any]:
    """Return the data that frames of every film depend on."""
    from resample.files.animations import fingerprint
    from resample.lazy import installed_version

    numbers = [  # intrinsics, in perspective or parallel
        each.matrix if hasattr(each, "matrix") else (each.sx, each.sy, each.cx, each.cy)
        for each in cameras
    ]
    poses = np.stack([camera.world_to_camera for camera in cameras])
    return {
        "cameras": fingerprint(np.array(numbers, np.float64), poses),
        "size": list(shape),
        "background": list(background),
        "version": installed_version(),
    }
