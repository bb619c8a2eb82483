"""Projection of points to pixels, and back, for cameras of all models.

Points are homogeneous: (..., 3) in a camera's axes and a weight (...); the point is their quotient,
and a weight of 0 is infinitely far.
"""

from typing import TypeAlias

import numpy as np

from resample.cameras.models import Camera, Orthographic
from resample.cameras.panoramic import Equirectangular, places_of, rays_at
from resample.cameras.pixels import directions, distorted_places, undistorted_places
from resample.types import Doubles
from resample_warp3d.depth.equation import lens_places
from resample_warp3d.types import DepthImage

CameraModel: TypeAlias = Camera | Orthographic | Equirectangular
Shape = tuple[int, int]  # height and width, px

NEAREST = 1e-6  # share of a point's distance: points less far ahead are beside the camera


def is_bent(target: CameraModel) -> bool:
    """Whether a target bends straight lines or has no center of projection."""
    return not isinstance(target, Camera) or target.distortion is not None


def project(
    camera: CameraModel, shape: Shape, point: Doubles, weight: Doubles
) -> tuple[Doubles, Doubles]:
    """Project homogeneous points to px (..., 2), with nearness; nan if not visible.

    The nearness is 1 / z, for a panorama 1 / ray length.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        if isinstance(camera, Equirectangular):
            return places_of(point, shape), weight / np.linalg.norm(point, axis=-1)
        ahead = point[..., 2]
        far = np.where(ahead > NEAREST * np.abs(point).max(axis=-1), ahead, np.nan)
        nearness = weight / far
        if isinstance(camera, Orthographic):
            flat = point[..., :2] / np.where(weight > 0.0, weight, np.nan)[..., None]
            return flat * (camera.sx, camera.sy) + (camera.cx, camera.cy), nearness
        flat = point[..., :2] / far[..., None]
    return _through_lens(camera, flat), nearness


def unproject(
    camera: CameraModel, shape: Shape, place: Doubles, nearness: Doubles
) -> tuple[Doubles, Doubles]:
    """Unproject places (..., 2) px with a nearness (...) to homogeneous points.

    Not a number where no light comes through the lens.
    """
    if isinstance(camera, Equirectangular):
        return rays_at(place, shape), nearness
    if isinstance(camera, Orthographic):
        flat = (place - (camera.cx, camera.cy)) / (camera.sx, camera.sy)
        flat = flat * nearness[..., None]
    else:
        unbent = place if camera.distortion is None else undistorted_places(camera, place)
        flat = directions(camera, unbent)
    return np.concatenate([flat, np.ones((*flat.shape[:-1], 1))], axis=-1), nearness


def without_lens(camera: Camera) -> Camera:
    """Return the same camera without its lens."""
    return Camera(camera.matrix, camera.world_to_camera, near=camera.near)


def taken_by(camera: CameraModel, image: DepthImage) -> tuple[DepthImage, Camera | Orthographic]:
    """Undistort the positions of a depth image's samples; also return the camera.

    A parallel camera, whose nearness is also 1 / z, is moved along its axis to one picture width
    before the nearest point, where nearness resolves depths well.
    """
    shape = image.color.shape[0], image.color.shape[1]
    if isinstance(camera, Camera):
        return image._replace(place=lens_places(camera, shape)), camera
    if not isinstance(camera, Orthographic):
        raise ValueError(
            "depth images are taken by a Camera or an Orthographic one; sources of a panorama are"
            " made by resample_warp3d.panorama"
        )
    known = image.nearness > 0
    if not known.any():
        return image, camera
    depth = 1.0 / image.nearness[known].astype(np.float64)
    back = float(max(shape[1] / camera.sx, shape[0] / camera.sy) - depth.min())
    nearness = np.zeros(image.nearness.shape, np.float32)
    nearness[known] = 1.0 / (depth + back)
    pose = camera.world_to_camera.copy()
    pose[2, 3] += back
    return image._replace(nearness=nearness), camera.moved(pose)


def _through_lens(camera: Camera, flat: Doubles) -> Doubles:
    """Project points of the plane at distance 1 to px."""
    place = flat @ camera.matrix[:2, :2].T + camera.matrix[:2, 2]
    return place if camera.distortion is None else distorted_places(camera, place)
