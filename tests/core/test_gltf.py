"""Fields of glTF that are nonsense: refused by their names, before trimesh reads them."""

import copy
import json
import struct

import pytest

from resample_meshes.files import load_mesh
from resample_volume.meshes import read_mesh
from tests.fuzz.corpus import gltf

TREE, DATA = gltf()
BARE = {key: part for key, part in TREE.items() if key not in ("images", "textures", "samplers")}
BARE |= {"materials": [{}], "buffers": [{"byteLength": len(DATA), "uri": "a.buf"}]}


def changed(*place, value):
    tree = copy.deepcopy(TREE)
    *way, last = place
    holder = tree
    for key in way:
        holder = holder[key]
    holder[last] = value
    return tree


def put(folder, tree):
    (folder / "a.gltf").write_text(json.dumps(tree))
    (folder / "a.buf").write_bytes(DATA)
    return folder / "a.gltf"


NONSENSE = [
    (("accessors", 0, "byteOffset"), -4, "0 or more"),
    (("accessors", 0, "byteOffset"), 1 << 40, "but its bufferView has 36"),
    (("accessors", 0, "count"), 1 << 40, "but its bufferView has 36"),
    (("accessors", 0, "count"), 0, "1 or more"),
    (("accessors", 0, "count"), "3", "1 or more"),
    (("accessors", 0, "type"), "VEC9", "SCALAR, VEC2"),
    (("accessors", 0, "componentType"), 5124, "5120, 5121"),
    (("accessors", 0, "bufferView"), 3, "0 to 2"),
    (("bufferViews", 0, "byteOffset"), -1, "0 to 72"),
    (("bufferViews", 0, "byteLength"), 1 << 62, "0 to 72"),
    (("bufferViews", 0, "byteStride"), 1000, "0 to 252"),
    (("bufferViews", 0, "buffer"), 1, "0 to 0"),
    (("buffers", 0, "byteLength"), None, "0 or more"),
    (("buffers",), [0], "is not an object"),
    (("nodes", 0, "mesh"), -1, "0 to 0"),
    (("nodes", 0, "children"), [0], "in a ring"),
    (("nodes", 0, "matrix"), [1, 2, 3], "16 finite numbers"),
    (("nodes", 0, "translation"), [1e308, 0, 0], "3 finite numbers"),
    (("scene",), 7, "0 to 0"),
    (("scenes", 0, "nodes"), 0, "not a list"),
    (("meshes", 0, "primitives"), [], "no primitives"),
    (("meshes", 0, "primitives", 0, "attributes", "POSITION"), 2, "not VEC3"),
    (("meshes", 0, "primitives", 0, "indices"), 1.5, "0 to 2"),
    (("meshes", 0, "primitives", 0, "material"), 9, "0 to 0"),
    (("materials", 0, "pbrMetallicRoughness"), [], "not an object"),
    (("materials", 0, "pbrMetallicRoughness", "baseColorTexture", "index"), {}, "0 to 0"),
    (("asset", "version"), None, "not '2.0'"),
]


@pytest.mark.parametrize(("place", "value", "allowed"), NONSENSE)
def test_nonsense_is_named_with_what_is_allowed(place, value, allowed, tmp_path):
    path = put(tmp_path, changed(*place, value=value))
    with pytest.raises(ValueError, match=rf"a\.gltf cannot be read as a mesh: its .*{allowed}"):
        load_mesh(path)


def test_meshes_in_scenes_of_volumes_are_looked_at_alike(tmp_path):
    text = json.dumps(changed("accessors", 0, "byteOffset", value=-4)).encode()
    head = struct.pack("<4sIIII", b"glTF", 2, 20 + len(text), len(text), 0x4E4F534A)
    (tmp_path / "a.glb").write_bytes(head + text)
    with pytest.raises(ValueError, match=r"its accessors\[0\]\.byteOffset is -4"):
        read_mesh(str(tmp_path / "a.glb"))


def test_nodes_that_are_below_each_other_too_deep_are_refused(tmp_path):
    nodes = [{"children": [n + 1]} for n in range(70)] + [{"mesh": 0}]
    with pytest.raises(ValueError, match="over the limit of 64"):
        load_mesh(put(tmp_path, TREE | {"nodes": nodes}))


def test_interleaved_views_and_compressed_parts_are_no_nonsense(tmp_path):
    tree = copy.deepcopy(BARE)
    tree["bufferViews"][0]["byteStride"] = 12
    assert len(load_mesh(put(tmp_path, tree)).triangle) == 1


def test_a_binary_file_whose_first_chunk_is_cut_is_refused(tmp_path):
    content = struct.pack("<4sIIII", b"glTF", 2, 100, 4_000_000_000, 0x4E4F534A) + b"{}"
    (tmp_path / "a.glb").write_bytes(content)
    with pytest.raises(ValueError, match="cut off"):
        load_mesh(tmp_path / "a.glb")
