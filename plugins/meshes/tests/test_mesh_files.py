"""Meshes from files, and what is said of those that cannot be used."""

import numpy as np
import pytest

from conftest import real
from resample_meshes.files import load_mesh

CORNERS = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
PLACES = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
FACES = "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n"


def write_texture(path, value=128, shape=(4, 6)):
    import cv2

    picture = np.full((*shape, 3), value, np.uint8)
    picture[0, 0] = (0, 0, 255)  # blue, green, red
    assert cv2.imwrite(str(path), picture)


@pytest.fixture
def square(tmp_path):
    """An OBJ whose texture lies beside it."""
    (tmp_path / "square.obj").write_text(f"mtllib square.mtl\n{CORNERS}{PLACES}usemtl a\n{FACES}")
    (tmp_path / "square.mtl").write_text("newmtl a\nKd 0.5 0.5 0.5\nmap_Kd picture.png\n")
    write_texture(tmp_path / "picture.png")
    return tmp_path / "square.obj"


def test_an_obj_comes_with_its_texture_in_linear_light(square):
    mesh = load_mesh(square)
    assert len(mesh.triangle) == 2
    (texture,) = mesh.textures
    assert texture.shape == (4, 6, 3)
    np.testing.assert_allclose(texture[1, 1], 0.2158605, rtol=1e-5)  # sRGB 128
    np.testing.assert_allclose(texture[0, 0], [1, 0, 0])


def test_v_points_upward(square):
    mesh = load_mesh(square)
    np.testing.assert_allclose(mesh.uv, mesh.position[:, :2])


def test_another_texture_takes_the_place_of_the_file_s(square, tmp_path):
    write_texture(tmp_path / "other.png", 255, (2, 2))
    (tmp_path / "picture.png").unlink()
    mesh = load_mesh(square, texture=tmp_path / "other.png")
    np.testing.assert_allclose(mesh.textures[0][1, 1], 1)


def test_a_texture_may_be_an_array(square):
    given = np.zeros((3, 5, 3), np.float32)
    assert load_mesh(square, texture=given).textures[0].shape == (3, 5, 3)


def test_a_missing_texture_is_named(square, tmp_path):
    (tmp_path / "picture.png").unlink()
    with pytest.raises(FileNotFoundError, match=r"is missing; square\.obj names it.*picture\.png"):
        load_mesh(square)


def test_a_missing_material_file_is_named(square, tmp_path):
    (tmp_path / "square.mtl").unlink()
    with pytest.raises(FileNotFoundError, match=r"is missing.*square\.mtl"):
        load_mesh(square)


@pytest.mark.parametrize("keep", [0, 20, 60])
def test_a_damaged_texture_is_refused(square, tmp_path, keep):
    content = (tmp_path / "picture.png").read_bytes()
    (tmp_path / "picture.png").write_bytes(content[:keep])
    with pytest.raises(OSError, match=r"damaged|cannot be read|can be read"):
        load_mesh(square)


def test_a_mesh_without_texture_coordinates_is_refused(square):
    square.write_text(CORNERS + "f 1 2 3\n")
    with pytest.raises(ValueError, match=r"square\.obj: has no texture coordinates"):
        load_mesh(square)


def test_a_texture_needs_texture_coordinates(square):
    square.write_text(CORNERS + "f 1 2 3\n")
    with pytest.raises(ValueError, match="no texture coordinates"):
        load_mesh(square, texture=np.zeros((2, 2, 3), np.float32))


def test_texture_coordinates_without_a_texture_are_refused(square):
    square.write_text(CORNERS + PLACES + FACES)
    with pytest.raises(ValueError, match="names no texture"):
        load_mesh(square)


@pytest.mark.parametrize("name", ["a.obj", "a.ply", "a.glb", "a.stl", "a.nothing", "a.gltf"])
def test_what_is_no_mesh_is_refused(tmp_path, name):
    (tmp_path / name).write_bytes(b"this is no mesh at all\n\x00\xff")
    with pytest.raises(ValueError, match=r"cannot be read as a mesh|holds no triangles") as caught:
        load_mesh(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"absent\.obj"):
        load_mesh(tmp_path / "absent.obj")


def test_not_a_number_is_refused(square):
    square.write_text(
        f"mtllib square.mtl\n{CORNERS}v nan 0 0\n{PLACES}usemtl a\n{FACES}f 1/1 2/2 5/3\n"
    )
    with pytest.raises(ValueError, match="not finite"):
        load_mesh(square)


def test_a_glb_scene_is_one_mesh_with_all_its_textures(tmp_path):
    import trimesh
    from PIL import Image

    scene = trimesh.Scene()
    place = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], float)
    for n, shade in enumerate((0, 255)):
        image = Image.new("RGB", (4, 4), (shade, shade, shade))
        material = trimesh.visual.material.PBRMaterial(
            baseColorTexture=image, baseColorFactor=[255, 0, 0, 255]
        )
        visual = trimesh.visual.TextureVisuals(uv=place[:, :2], material=material)
        one = trimesh.Trimesh(place, [[0, 1, 2]], visual=visual, process=False)
        move = np.eye(4)
        move[2, 3] = n
        scene.add_geometry(one, transform=move)
    scene.export(tmp_path / "two.glb")
    mesh = load_mesh(tmp_path / "two.glb")
    height = mesh.position[mesh.triangle[:, 0], 2]
    shade = [mesh.textures[n][0, 0].tolist() for n in mesh.texture]
    assert dict(zip(height, shade, strict=True)) == {0: [0, 0, 0], 1: [1, 0, 0]}


PLY = """ply
format ascii 1.0
{comment}element vertex 3
property float x
property float y
property float z
{properties}element face 1
property list uchar int vertex_indices
end_header
0 0 0 {first}
1 0 0 {second}
0 1 0 {third}
3 0 1 2
"""


def test_a_ply_is_laid_with_the_texture_that_it_names(tmp_path):
    write_texture(tmp_path / "skin.png", 255)
    text = PLY.format(
        comment="comment TextureFile skin.png\n",
        properties="property float s\nproperty float t\n",
        first="0 0",
        second="1 0",
        third="0 1",
    )
    (tmp_path / "a.ply").write_text(text)
    mesh = load_mesh(tmp_path / "a.ply")
    assert mesh.textures[0].shape == (4, 6, 3)
    np.testing.assert_allclose(mesh.uv, mesh.position[:, :2])


def test_vertex_colors_are_read_in_linear_light(tmp_path):
    channels = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    text = PLY.format(
        comment="", properties=channels, first="255 0 0", second="0 128 0", third="0 0 0"
    )
    (tmp_path / "a.ply").write_text(text)
    mesh = load_mesh(tmp_path / "a.ply")
    assert mesh.textures == ()
    np.testing.assert_allclose(mesh.color, [[1, 0, 0], [0, 0.2158605, 0], [0, 0, 0]], rtol=1e-5)


@pytest.fixture
def meshes():
    return real("meshes")


@pytest.mark.sweep
def test_the_cow_comes_whole(meshes):
    mesh = load_mesh(meshes / "spot_cow" / "cow.obj")
    assert len(mesh.triangle) == 5856
    assert mesh.textures[0].shape == (1024, 1024, 3)


@pytest.mark.sweep
def test_the_bunny_has_nothing_to_show(meshes):
    with pytest.raises(ValueError, match=r"bunny\.ply: has no texture coordinates"):
        load_mesh(meshes / "bunny" / "bunny.ply")
