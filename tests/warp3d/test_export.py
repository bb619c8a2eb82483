import numpy as np
import pytest
import trimesh

from resample.cameras.models import Camera
from resample.colors import from_srgb
from resample_warp3d.command.writing import check_export, cloud, mesh, triangles, write_geometry
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.types import DOWN, LEFT, RIGHT, UP, DepthImage, Source

NOWHERE = np.empty((0, 0, 2))


def camera(pose: np.ndarray | None = None, fy: float = 20.0) -> Camera:
    return Camera(
        np.array([[20.0, 0, 4], [0, fy, 3], [0, 0, 1]]), np.eye(4) if pose is None else pose
    )


def plane(depth: float = 2.0, color: tuple[float, ...] = (0.2, 0.5, 0.8)) -> Source:
    """A wall 6 × 8 samples large, parallel to the frame."""
    colors = np.full((6, 8, len(color)), color, np.float32)
    return prepare(DepthImage(colors, np.full((6, 8), 1 / depth, np.float32), NOWHERE))


def step() -> Source:
    """The same wall, whose right half is twice as far."""
    nearness = np.full((6, 8), 0.5, np.float32)
    nearness[:, 4:] = 0.25
    return prepare(DepthImage(np.ones((6, 8, 3), np.float32), nearness, NOWHERE), step=0.0)


def linked(links: np.ndarray) -> Source:
    """Four samples with given links."""
    one = np.ones((2, 2), np.float32)
    return Source(one[..., None], one, np.zeros((2, 2, 2), np.float32), links, NOWHERE, 0.0)


def test_a_wall_is_where_the_camera_saw_it():
    made = mesh(plane(), camera())
    assert np.allclose(made.vertices[:, 2], 2)
    assert np.allclose(made.vertices[0], [2 * -3.5 / 20, 2 * -2.5 / 20, 2])
    assert made.area == pytest.approx(2 * 2 * 7 * 5 / 20**2)


def test_the_pose_puts_it_into_the_world():
    pose = np.array([[0.0, 0, -1, 3], [0, 1, 0, 0], [1, 0, 0, 1], [0, 0, 0, 1]])
    here, there = mesh(plane(), camera()), mesh(plane(), camera(pose))
    seen = there.vertices @ pose[:3, :3].T + pose[:3, 3]
    assert np.allclose(seen, here.vertices)


@pytest.mark.parametrize("fy", [20.0, -20.0])
def test_front_sides_face_the_camera(fy):
    assert np.allclose(mesh(plane(), camera(fy=fy)).face_normals, [0, 0, -1])


def test_a_step_in_depth_tears_the_mesh():
    made = mesh(step(), camera())
    assert len(made.faces) == 2 * (5 * 3 + 5 * 3)
    assert not np.ptp(made.vertices[made.faces][..., 2], axis=1).any()


@pytest.mark.parametrize(("corner", "cut"), [(0, {1, 2}), (1, {0, 3}), (2, {0, 3}), (3, {1, 2})])
def test_four_linked_samples_are_cut_where_the_nearness_changes_least(corner, cut):
    source = linked(np.array([[RIGHT | DOWN, LEFT | DOWN], [RIGHT | UP, LEFT | UP]], np.uint8))
    source.nearness.flat[corner] = 2  # the other diagonal is even
    first, second = triangles(source).tolist()
    assert set(first) & set(second) == cut


@pytest.mark.parametrize(
    ("links", "corners"),
    [
        ([[RIGHT | DOWN, LEFT], [UP, 0]], [0, 1, 2]),
        ([[DOWN, 0], [UP | RIGHT, LEFT]], [0, 2, 3]),
        ([[0, DOWN], [RIGHT, LEFT | UP]], [1, 2, 3]),
        ([[RIGHT, LEFT | DOWN], [0, UP]], [0, 1, 3]),
    ],
)
def test_a_corner_where_two_links_meet_makes_one(links, corners):
    assert sorted(triangles(linked(np.array(links, np.uint8))).ravel().tolist()) == corners


def test_three_links_make_one_triangle_and_no_two_that_overlap():
    links = np.array([[RIGHT | DOWN, LEFT | DOWN], [UP, UP]], np.uint8)
    assert len(triangles(linked(links))) == 1


def test_samples_without_links_make_none():
    assert not triangles(linked(np.array([[RIGHT, LEFT], [RIGHT, LEFT]], np.uint8))).size
    with pytest.raises(ValueError, match="no mesh to write"):
        mesh(linked(np.zeros((2, 2), np.uint8)), camera())


def test_a_cloud_has_all_samples_that_have_a_depth():
    source = plane()
    source.nearness[0, 0] = 0
    made = cloud(source, camera())
    assert made.vertices.shape == (47, 3)
    assert np.isfinite(made.vertices).all()


@pytest.mark.parametrize("shape", ["mesh", "points"])
def test_a_ply_keeps_the_worlds_axes_and_srgb_colors(shape, tmp_path):
    write_geometry(tmp_path / "a.PLY", plane(), camera(), shape)
    read = trimesh.load(tmp_path / "a.PLY")
    assert np.allclose(read.vertices[:, 2], 2)
    color = read.colors if shape == "points" else read.visual.vertex_colors
    light = from_srgb(np.asarray(color, np.float32)[:, :3] / 255)
    assert np.allclose(light, (0.2, 0.5, 0.8), atol=0.004)  # 8 bits


@pytest.mark.parametrize("shape", ["mesh", "points"])
def test_a_glb_has_y_upwards(shape, tmp_path):
    write_geometry(tmp_path / "a.glb", plane(), camera(), shape)
    (read,) = trimesh.load(tmp_path / "a.glb").geometry.values()
    assert np.allclose(read.vertices[:, 2], -2)
    assert read.vertices[0, 1] == pytest.approx(2 * 2.5 / 20)


def test_points_of_a_glb_are_linear_light_as_gltf_asks_for(tmp_path):
    write_geometry(tmp_path / "a.glb", plane(), camera(), "points")
    (read,) = trimesh.load(tmp_path / "a.glb").geometry.values()
    assert np.allclose(read.colors[:, :3] / 255, (0.2, 0.5, 0.8), atol=0.005)  # twice 8 bits


def test_a_mesh_of_a_glb_has_the_picture_as_its_texture(tmp_path, rng):
    color = rng.random((6, 8, 3)).astype(np.float32)
    source = plane()._replace(color=color)
    write_geometry(tmp_path / "a.glb", source, camera())
    (read,) = trimesh.load(tmp_path / "a.glb").geometry.values()
    picture = np.asarray(read.visual.material.baseColorTexture, np.float32) / 255
    assert np.allclose(from_srgb(picture), color, atol=0.006)  # 8 bits
    corner = np.argmin(read.vertices @ [1, -1, 0])  # left and up
    assert np.allclose(read.visual.uv[corner], [0.5 / 8, 1 - 0.5 / 6])


def test_gray_and_transparent_pictures_are_exported():
    assert np.allclose(mesh(plane(color=(1.0,)), camera()).visual.vertex_colors, 255)
    half = mesh(plane(color=(0.5, 0.0, 0.0, 0.5)), camera()).visual.vertex_colors
    assert np.array_equal(half[0], [255, 0, 0, 128])


def test_pictures_without_color_are_refused():
    with pytest.raises(ValueError, match="a picture of 5 channels"):
        cloud(plane(color=(0.0,) * 5), camera())


def test_other_suffixes_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"written as \.ply or \.glb"):
        check_export(tmp_path / "a.obj")
