"""Do poses lead where the depth says?"""

import itertools

import numpy as np
import pytest

from conftest import real
from resample.cameras.files import read_poses
from resample.cameras.models import Camera
from resample.cameras.pixels import directions, pixel_centers
from resample.cameras.poses import camera_to_world, from_quaternion
from resample_warp3d.depth.encodings import PlanarDepth
from resample_warp3d.depth.equation import between, places, pose_warning, warp_places
from resample_warp3d.depth.files import read_depth
from resample_warp3d.types import DepthImage

SHAPE = (60, 80)


def pose(quaternion, shift):
    full = np.eye(4)
    full[:3, :3], full[:3, 3] = from_quaternion(quaternion), shift
    return full


def seen_sphere(camera):
    """Depth image of the plane z = 4 + 0.3 x with a sphere of radius 0.6 before it."""
    back = camera_to_world(camera.world_to_camera)
    ray = np.dstack([directions(camera, pixel_centers(SHAPE)), np.ones(SHAPE)]) @ back[:3, :3].T
    eye = back[:3, 3]
    normal = np.array([-0.3, 0.0, 1.0])
    z = (4.0 - eye @ normal) / (ray @ normal)
    toward = np.array([0.2, 0.1, 2.5]) - eye
    a, b = (ray * ray).sum(axis=2), ray @ toward
    inside = b * b - a * (toward @ toward - 0.36)
    z = np.where(inside > 0, (b - np.sqrt(np.maximum(inside, 0))) / a, z)
    nearness = np.where(z > 0, 1 / z, 0).astype(np.float32)
    return DepthImage(np.zeros((*SHAPE, 1), np.float32), nearness)


@pytest.fixture
def cameras():
    first = Camera.from_fov(60, *SHAPE, pose([0, 0.1, 0, np.sqrt(0.99)], [0.3, 0.1, 0.2]))
    second = Camera.from_intrinsics(
        70, -65, 38, 31, world_to_camera=pose([0.05, -0.1, 0, np.sqrt(0.9875)], [-0.5, 0, 0.4])
    )
    return first, second


def verdict(cameras, poses):
    images = [seen_sphere(camera) for camera in cameras]
    given = [camera.moved(matrix) for camera, matrix in zip(cameras, poses, strict=True)]
    return pose_warning(*images, *given)


def test_right_poses_are_not_doubted(cameras):
    assert verdict(cameras, [camera.world_to_camera for camera in cameras]) is None


def test_inverted_poses_are_noticed(cameras):
    found = verdict(cameras, [camera_to_world(camera.world_to_camera) for camera in cameras])
    assert found.startswith("the poses look inverted")
    assert "\n" not in found


def test_exchanged_poses_are_noticed(cameras):
    found = verdict(cameras, [camera.world_to_camera for camera in cameras[::-1]])
    assert found.startswith("the poses look exchanged")


def test_poses_that_nothing_fits_are_not_called_inverted(cameras):
    strange = pose([0, 0.6, 0, 0.8], [2.0, 0, 1])
    assert verdict(cameras, [cameras[0].world_to_camera, strange]) is None


def test_a_missing_depth_speaks_against_nothing(cameras):
    image = seen_sphere(cameras[0])._replace(nearness=np.zeros(SHAPE, np.float32))
    assert pose_warning(image, image, *cameras) is None


# Real pairs.


def real_views(name, files, scale, intrinsics, poses):
    folder = real(f"depth/{name}")
    views = []
    for file, matrix in zip(files, read_poses(folder / poses), strict=True):
        nearness = PlanarDepth(scale=scale).nearness(read_depth(folder / "depth" / file))
        image = DepthImage(
            np.zeros((*nearness.shape, 1), np.float32), nearness, np.empty((0, 0, 2))
        )
        camera = Camera.from_intrinsics(*intrinsics, world_to_camera=matrix, convention="opencv")
        views.append((image, camera))
    return views


@pytest.fixture(scope="module")
def icl():
    files = [f"{n}.png" for n in range(1, 6)]
    return real_views("iclnuim_livingroom", files, 5000, (481.2, -480, 319.5, 239.5), "pose.txt")


@pytest.fixture(scope="module")
def open3d():
    files = [f"{n:05d}.png" for n in range(5)]
    return real_views("open3d_rgbd", files, 1000, (525, 525, 319.5, 239.5), "trajectory.log")


def depth_difference(first, second):
    """Median difference of depth, m, where points of one view meet the depth of another."""
    (image, camera), (other, target) = first, second
    known = image.nearness > 0
    place, nearness = warp_places(
        between(camera, target), places(image)[known], image.nearness[known].astype(float)
    )
    height, width = other.nearness.shape
    inside = ((place >= 0) & (place < (width, height))).all(axis=1)
    column, row = place[inside].astype(int).T
    seen, expected = other.nearness[row, column], nearness[inside]
    meets = seen > 0
    assert meets.sum() > 50_000
    return np.median(np.abs(1 / seen[meets] - 1 / expected[meets]))


@pytest.mark.sweep
@pytest.mark.parametrize(("first", "second"), [(3, 0), (4, 0), (3, 4), (4, 3)])
def test_points_of_icl_nuim_meet_the_depth_of_other_views(icl, first, second):
    # its y axis points up, so fy < 0; the poses are off by as much: measured 0.9 to 2.0 cm
    assert depth_difference(icl[first], icl[second]) < 0.03


@pytest.mark.sweep
@pytest.mark.parametrize("first", range(4))
def test_points_of_open3d_s_frames_meet_the_depth_of_the_next(open3d, first):
    assert depth_difference(open3d[first], open3d[first + 1]) < 0.006  # m; measured 5 mm


@pytest.mark.some(1)
@pytest.mark.parametrize(("first", "second"), list(itertools.permutations((0, 3, 4), 2)))
def test_inverted_poses_of_icl_nuim_are_noticed(icl, first, second):
    (image, camera), (other, target) = icl[first], icl[second]
    assert pose_warning(image, other, camera, target) is None
    turned = [view.moved(camera_to_world(view.world_to_camera)) for view in (camera, target)]
    assert "inverted" in pose_warning(image, other, *turned)


@pytest.mark.some(2)
@pytest.mark.parametrize(("first", "second"), [(0, 1), (1, 0), (0, 4)])
def test_inverted_poses_of_open3d_s_frames_are_noticed(open3d, first, second):
    (image, camera), (other, target) = open3d[first], open3d[second]
    assert pose_warning(image, other, camera, target) is None
    turned = [view.moved(camera_to_world(view.world_to_camera)) for view in (camera, target)]
    assert "inverted" in pose_warning(image, other, *turned)
