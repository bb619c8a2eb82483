"""Cameras of a cloud, as options spell them."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from resample.cameras.calibrations.lens_files import Calibration
    from resample.cameras.models import Camera
    from resample.cameras.viewpoints import Viewpoint
    from resample_points.geometry.spacing import Surfels

Shape = tuple[int, int]  # height and width, px


def start_of(camera: str, up: str) -> "Viewpoint":
    """Read a cloud's viewpoint; angles get the default field of view of clouds."""
    from resample.command.flags import viewpoint
    from resample_points.geometry.framing import FIELD

    start = viewpoint(camera, FIELD, up)
    if getattr(start, "fov", FIELD) == 0:
        raise ValueError("a field of view of 0 degrees; clouds are seen in perspective")
    return start


def calibrated_of(pose: str | None, intrinsics: str | None) -> "Calibration | None":
    """Read the camera of --pose and --intrinsics, if given."""
    from resample.cameras.files import read_pose
    from resample.command.intrinsics import with_intrinsics

    if pose is None and intrinsics is None:
        return None
    if pose is None or intrinsics is None:
        raise ValueError("--pose and --intrinsics belong together; give both, or --camera")
    calibration = with_intrinsics("intrinsics", intrinsics, "corner")
    return calibration._replace(camera=calibration.camera.moved(read_pose(pose)))


def camera_of(surfels: "Surfels", shape: Shape, viewpoint: "Viewpoint") -> Any:
    """Return the camera of a viewpoint; angles alone fit the cloud to the frame."""
    from resample.cameras.viewpoints import Orbit
    from resample_points.geometry.framing import framed

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
    return _panned(_zoomed(camera, viewpoint.zoom), viewpoint.pan, surfels, shape)


def cameras_of(
    surfels: "Surfels", viewpoints: "Sequence[Viewpoint]", shape: Shape, *, steady: bool = False
) -> list[Any]:
    """Return the cameras of all frames; orbits keep one distance to the cloud's center.

    With `steady` it is the distance of steady pictures, which does not depend on the angles.
    """
    from resample.cameras.viewpoints import Orbit
    from resample_points.geometry.framing import ball_around, framed_together

    around = [viewpoint for viewpoint in viewpoints if isinstance(viewpoint, Orbit)]
    if len(around) < len(viewpoints):
        return [sized(viewpoint, shape) for viewpoint in viewpoints]
    if steady:
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


def _panned(
    camera: "Camera", pan: tuple[float, float], surfels: "Surfels", shape: Shape
) -> "Camera":
    """Shift the cloud's center right and up, in shares of the picture's shorter side."""
    from resample_points.geometry.framing import ball_around

    if pan == (0.0, 0.0):
        return camera
    pose = camera.world_to_camera.copy()
    depth = float(pose[2, :3] @ ball_around(surfels)[0] + pose[2, 3])
    side = depth * min(shape) / camera.fx
    pose[:2, 3] += side * pan[0], -side * pan[1]
    return camera.moved(pose)


def _zoomed(camera: "Camera", zoom: float) -> "Camera":
    matrix = camera.matrix.copy()
    matrix[:2, :2] *= zoom
    return replace(camera, matrix=matrix)
