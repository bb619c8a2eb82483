"""Materials of glTF files, and of parts that have no texture."""

import base64
import io
import json
import struct
from dataclasses import replace

import numpy as np
import pytest

from resample_meshes.files import load_mesh
from resample_meshes.shapes import Cover
from tests.texture.mesh_shapes import from_above, picture

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
PLACES = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)  # downward, as glTF has them
TRIANGLES = np.array([0, 1, 2, 0, 2, 3], np.uint16)
PIXELS = np.zeros((2, 4, 4), np.uint8)
PIXELS[...] = 255, 128, 0, 102  # of alpha 0.4


def encoded(content, kind="application/octet-stream"):
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def header(material=None, *, uv=True, color=None, **more):
    """A square of one material; all that it holds stands in its text."""
    from PIL import Image

    png = io.BytesIO()
    Image.fromarray(PIXELS).save(png, "png")
    arrays = {"POSITION": CORNERS, "TEXCOORD_0": PLACES if uv else None, "COLOR_0": color}
    arrays = {name: array for name, array in arrays.items() if array is not None}
    content = b"".join(array.tobytes() for array in arrays.values()) + TRIANGLES.tobytes()
    views, accessors, start = [], [], 0
    for array in [*arrays.values(), TRIANGLES]:
        views.append({"buffer": 0, "byteOffset": start, "byteLength": array.nbytes})
        kind = "SCALAR" if array.ndim == 1 else f"VEC{array.shape[1]}"
        number = 5123 if array is TRIANGLES else 5126
        accessors.append(
            {
                "bufferView": len(accessors),
                "componentType": number,
                "count": len(array),
                "type": kind,
            }
        )
        start += array.nbytes
    part = {"attributes": {name: n for n, name in enumerate(arrays)}, "indices": len(arrays)}
    if material is not None:
        part["material"] = 0
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [part]}],
        "materials": [] if material is None else [material],
        "textures": [{"source": 0, "sampler": 0}],
        "samplers": [{}],
        "images": [{"uri": encoded(png.getvalue(), "image/png")}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(content), "uri": encoded(content)}],
    } | more


def written(folder, content, kind="gltf"):
    text = json.dumps(content).encode()
    if kind == "glb":
        text += b" " * (-len(text) % 4)
        head = struct.pack("<IIII", 2, 20 + len(text), len(text), 0x4E4F534A)
        text = b"glTF" + head + text
    (folder / f"a.{kind}").write_bytes(text)
    return folder / f"a.{kind}"


def textured(**more):
    return more | {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}


@pytest.mark.parametrize("kind", ["gltf", "glb"])
def test_a_part_without_texture_coordinates_has_its_material_s_color(tmp_path, kind):
    look = {"baseColorFactor": [0.5, 0.1, 0.02, 0.25]}
    file = written(tmp_path, header({"pbrMetallicRoughness": look}, uv=False), kind)
    found = picture(load_mesh(file), from_above(16.0, 16), 16).rgba[8, 8]
    np.testing.assert_allclose(found, [0.5, 0.1, 0.02, 1], rtol=1e-6)  # factors are linear


def test_a_part_without_texture_coordinates_leaves_its_material_s_texture_out(tmp_path):
    mesh = load_mesh(written(tmp_path, header(textured(), uv=False)))
    np.testing.assert_array_equal(mesh.textures[0], np.ones((1, 1, 3)))


def test_a_part_without_a_material_is_white(tmp_path):
    mesh = load_mesh(written(tmp_path, header(uv=False)))
    np.testing.assert_array_equal(mesh.textures[0], np.ones((1, 1, 3)))


def test_an_even_pane_lets_through(tmp_path):
    look = {"baseColorFactor": [0.5, 0.1, 0.02, 0.25]}
    material = {"pbrMetallicRoughness": look, "alphaMode": "BLEND"}
    mesh = load_mesh(written(tmp_path, header(material, uv=False)))
    found = picture(mesh, from_above(16.0, 16), 16).rgba[8, 8]
    np.testing.assert_allclose(found, [0.125, 0.025, 0.005, 0.25], rtol=1e-6)


def test_a_texture_is_multiplied_by_its_material_s_color(tmp_path):
    material = textured(alphaMode="BLEND")
    material["pbrMetallicRoughness"]["baseColorFactor"] = [0.5, 0.5, 1.0, 0.5]
    mesh = load_mesh(written(tmp_path, header(material)))
    assert mesh.textures[0].shape == (2, 4, 4)
    np.testing.assert_allclose(mesh.textures[0][0, 0], [0.5, 0.2158605 / 2, 0, 0.2], rtol=1e-5)


@pytest.mark.parametrize("kind", ["gltf", "glb"])
@pytest.mark.parametrize(
    ("sampler", "edges"),
    [
        ({}, ("wrap", "wrap")),
        ({"wrapS": 10497, "wrapT": 33071}, ("wrap", "clamp")),
        ({"wrapS": 33648}, ("mirror", "wrap")),
    ],
)
def test_samplers_say_what_lies_beyond_a_texture_s_edges(tmp_path, kind, sampler, edges):
    file = written(tmp_path, header(textured(), samplers=[sampler]), kind)
    assert load_mesh(file).covers == (Cover(*edges, is_encoded=True),)


def test_a_texture_without_a_sampler_repeats(tmp_path):
    mesh = load_mesh(written(tmp_path, header(textured(), textures=[{"source": 0}])))
    assert mesh.covers == (Cover(is_encoded=True),)


@pytest.mark.parametrize(
    ("said", "cover"),
    [
        ({}, Cover()),
        ({"alphaMode": "MASK"}, Cover(alpha="mask", cutoff=0.5)),
        ({"alphaMode": "MASK", "alphaCutoff": 0.25}, Cover(alpha="mask", cutoff=0.25)),
        ({"alphaMode": "BLEND"}, Cover(alpha="blend")),
    ],
)
def test_a_material_says_what_alpha_does(tmp_path, said, cover):
    mesh = load_mesh(written(tmp_path, header(textured(**said))))
    assert mesh.covers == (replace(cover, is_encoded=True),)
    seen = {"opaque": 1.0, "mask": float(cover.cutoff <= 0.4), "blend": 0.4}[cover.alpha]
    found = picture(mesh, from_above(16.0, 16), 16).rgba[8, 8]
    np.testing.assert_allclose(found, seen * np.array([1, 0.2158605, 0, 1]), rtol=1e-5)


def test_vertex_colors_are_linear_and_multiplied_by_the_material_s(tmp_path):
    color = np.tile(np.float32([0.5, 0.25, 1.0]), (4, 1))
    look = {"baseColorFactor": [1.0, 0.5, 0.5, 1.0]}
    content = header({"pbrMetallicRoughness": look}, uv=False, color=color)
    mesh = load_mesh(written(tmp_path, content))
    np.testing.assert_allclose(mesh.color[0], [0.5, 0.125, 0.5], rtol=1e-6)
    bare = load_mesh(written(tmp_path, header(uv=False, color=color)))
    np.testing.assert_allclose(bare.color[0], [0.5, 0.25, 1.0], atol=0.003)  # of 255 levels


def test_parts_without_texture_coordinates_keep_their_color_under_another_texture(tmp_path):
    content = header(textured())
    content["meshes"].append({"primitives": [{"attributes": {"POSITION": 0}, "indices": 2}]})
    content["nodes"].append({"mesh": 1, "translation": [0, 0, 1]})
    content["scenes"] = [{"nodes": [0, 1]}]
    given = np.zeros((2, 2, 3), np.float32)
    mesh = load_mesh(written(tmp_path, content), texture=given)
    assert sorted(texture.mean() for texture in mesh.textures) == [0, 1]
    with pytest.raises(ValueError, match="a texture cannot be laid on it"):
        load_mesh(written(tmp_path, header(uv=False)), texture=given)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"materials": [{"alphaMode": "GLASS"}]}, "alphaMode 'GLASS'; known: OPAQUE, MASK, BLEND"),
        ({"samplers": [{"wrapS": 1}]}, "a sampler wraps by 1; known: 33071"),
        ({"samplers": []}, "cannot be read as a mesh"),
        ({"materials": [{"pbrMetallicRoughness": {"baseColorFactor": [1]}}]}, "it has 4"),
    ],
)
def test_a_material_that_gltf_does_not_know_is_refused_in_one_line(tmp_path, change, message):
    file = written(tmp_path, header(textured(), **change))
    with pytest.raises(ValueError, match=message) as caught:
        load_mesh(file)
    assert "\n" not in str(caught.value)


def test_a_part_of_an_obj_without_texture_coordinates_has_its_material_s_color(tmp_path):
    corners = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
    (tmp_path / "a.obj").write_text(f"mtllib a.mtl\n{corners}usemtl a\nf 1 2 3\nf 1 3 4\n")
    (tmp_path / "a.mtl").write_text("newmtl a\nKd 1.0 0.502 0.0\n")
    mesh = load_mesh(tmp_path / "a.obj")
    np.testing.assert_allclose(mesh.textures[0][0, 0], [1, 0.2158605, 0], rtol=1e-5)
