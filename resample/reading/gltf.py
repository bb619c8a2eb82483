"""Validate glTF files before trimesh reads them: indices, numbers and sizes."""

import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from resample.reading.limits import check_size, limits, refused
from resample.reading.texts import json_of

JSON = 0x4E4F534A  # type of a binary file's first chunk
SIZES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}  # bytes of component types
PARTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
MOST = 1 << 53  # largest integer that all JSON readers represent exactly
# Keys under which objects refer to others by index
NAMED = {
    "scenes": {"nodes": "nodes"},
    "nodes": {"mesh": "meshes", "children": "nodes"},
    "textures": {"source": "images", "sampler": "samplers"},
    "images": {"bufferView": "bufferViews"},
    "bufferViews": {"buffer": "buffers"},
    "accessors": {"bufferView": "bufferViews"},
}
LISTS = ("children", "nodes")  # keys in NAMED that hold several indices
LENGTHS = {"matrix": 16, "translation": 3, "rotation": 4, "scale": 3, "baseColorFactor": 4}
TEXTURES = ("baseColorTexture", "metallicRoughnessTexture", "normalTexture", "emissiveTexture")
MOST_LENGTH = 1e30  # of coordinates

Tree = dict[str, Any]


def header_of(path: Path) -> Tree:
    """JSON of a glTF file, in text or binary form."""
    size = path.stat().st_size
    with path.open("rb") as file:
        if path.suffix.lower() == ".glb":
            first = file.read(20)
            if first[:4] != b"glTF" or len(first) < 20:
                raise ValueError("it is not a binary glTF")
            length, kind = struct.unpack_from("<II", first, 12)
            if kind != JSON or length > size - 20:
                raise ValueError("its first chunk is not JSON, or cut off")
            size = length
        check_size(path.name, size, "tree")
        content = file.read(size)
    tree = json_of(content.decode("utf-8"))
    if not isinstance(tree, dict):
        raise ValueError("its JSON is not an object")
    return tree


def check_gltf(tree: Tree) -> None:
    """Reject indices out of range, sizes beyond buffers, and other invalid values."""
    version = _object(tree, "asset", "asset").get("version")
    if not isinstance(version, str) or not version.startswith("2."):
        raise ValueError(f"its asset.version is {version!r:.40}, not '2.0'")
    if "scene" in tree:
        _index(tree, "scenes", tree["scene"], "scene")
    for key, names in NAMED.items():
        for place, thing in _things(tree, key):
            for name, others in names.items():
                for one in _several(thing, name, f"{place}.{name}"):
                    _index(tree, others, one, f"{place}.{name}")
    for key, check in CHECKS.items():
        for place, thing in _things(tree, key):
            check(tree, place, thing)
    # Nodes are trees, of no more levels than allowed, without a cycle.
    nodes = tree.get("nodes", [])
    below = {child for node in nodes for child in node.get("children", [])}
    level, depth = [n for n in range(len(nodes)) if n not in below], 0
    reached = len(level)
    while level:
        level = [child for n in level for child in nodes[n].get("children", [])]
        reached, depth = reached + len(level), depth + 1
        if depth > limits().depth:
            raise refused("too deep", "nodes below each other", "depth")
        if reached > len(nodes):
            raise ValueError("its nodes are below several others; each is below one at most")
    if reached < len(nodes):
        raise ValueError("its nodes are below each other in a ring")


def _things(tree: Tree, key: str, place: str = "") -> Iterator[tuple[str, Tree]]:
    """Objects of a list with their names in messages."""
    every = tree.get(key, [])
    if not isinstance(every, list):
        raise ValueError(f"its {place or key} is not a list")
    for n, one in enumerate(every):
        if not isinstance(one, dict):
            raise ValueError(f"its {place or key}[{n}] is not an object")
        yield f"{place or key}[{n}]", one


def _several(thing: Tree, name: str, place: str) -> list[Any]:
    """Indices under a key, whether it holds one or a list."""
    if name not in thing:
        return []
    found = thing[name] if name in LISTS else [thing[name]]
    if not isinstance(found, list):
        raise ValueError(f"its {place} is {found!r:.40}, not a list")
    return found


def _object(thing: Tree, name: str, place: str) -> Tree:
    """Object under a key; empty if there is none."""
    found = thing.get(name, {})
    if not isinstance(found, dict):
        raise ValueError(f"its {place} is {found!r:.40}, not an object")
    return found


def _whole(value: Any, place: str, least: int = 0, most: int = MOST) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= most:
        wanted = f"{least} to {most}" if most < MOST else f"{least} or more"
        raise ValueError(f"its {place} is {value!r:.40}; whole numbers of {wanted} are allowed")
    return value


def _index(tree: Tree, key: str, value: Any, place: str) -> Tree:
    """Element of a list that a field refers to by index."""
    every = tree.get(key, [])
    count = len(every) if isinstance(every, list) else 0
    if not count:
        raise ValueError(f"its {place} is {value!r:.40}, but there are no {key}")
    found = every[_whole(value, place, most=count - 1)]
    if not isinstance(found, dict):
        raise ValueError(f"its {key}[{value}] is not an object")
    return found


def _check_uri(_: Tree, place: str, thing: Tree) -> None:
    """Reject a file without a name, and a buffer without a length."""
    if not isinstance(thing.get("uri", ""), str):
        raise ValueError(f"its {place}.uri is {thing['uri']!r:.40}, not a text")
    if place.startswith("buffers"):
        _whole(thing.get("byteLength"), f"{place}.byteLength")


def _check_view(tree: Tree, place: str, view: Tree) -> None:
    """Reject a view that extends beyond its buffer."""
    buffer = _index(tree, "buffers", view.get("buffer"), f"{place}.buffer")
    most = _whole(buffer.get("byteLength"), "buffers[].byteLength")
    start = _whole(view.get("byteOffset", 0), f"{place}.byteOffset", most=most)
    _whole(view.get("byteLength"), f"{place}.byteLength", most=most - start)
    if "byteStride" in view:
        _whole(view["byteStride"], f"{place}.byteStride", most=252)


def _check_accessor(tree: Tree, place: str, accessor: Tree) -> None:
    """Reject an accessor that extends beyond its view."""
    kind, parts = accessor.get("componentType"), accessor.get("type")
    for given, key, known in ((kind, "componentType", SIZES), (parts, "type", PARTS)):
        if not isinstance(given, int | str) or isinstance(given, bool) or given not in known:
            raise ValueError(
                f"its {place}.{key} is {given!r:.40}; known are {', '.join(map(str, known))}"
            )
    count = _whole(accessor.get("count"), f"{place}.count", least=1)
    if "bufferView" not in accessor:
        return
    view = _index(tree, "bufferViews", accessor["bufferView"], f"{place}.bufferView")
    size = SIZES[kind] * PARTS[str(parts)]  # type: ignore[index]
    start = _whole(accessor.get("byteOffset", 0), f"{place}.byteOffset")
    needed = start + (view.get("byteStride") or size) * (count - 1) + size
    if needed > view["byteLength"]:
        raise ValueError(
            f"its {place} needs {needed} bytes, of which {view['byteLength']} are in its bufferView"
        )


def _check_numbers(_: Tree, place: str, node: Tree) -> None:
    """Reject a node whose transformation is invalid."""
    for key, count in LENGTHS.items():
        given = node.get(key)
        if key in node and not (
            isinstance(given, list)
            and len(given) == count
            and all(_is_number(one) for one in given)
        ):
            raise ValueError(f"its {place}.{key} is {given!r:.40}; it has {count} finite numbers")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and abs(value) <= MOST_LENGTH


def _check_material(tree: Tree, place: str, material: Tree) -> None:
    """Reject a material with an invalid texture or number."""
    look = _object(material, "pbrMetallicRoughness", f"{place}.pbrMetallicRoughness")
    _check_numbers(tree, f"{place}.pbrMetallicRoughness", look)
    cutoff = material.get("alphaCutoff", 0.5)
    if not _is_number(cutoff):
        raise ValueError(f"its {place}.alphaCutoff is {cutoff!r:.40}, not a number")
    for holder in (look, material):
        for key in TEXTURES:
            if key in holder:
                named = _object(holder, key, f"{place}.{key}")
                _index(tree, "textures", named.get("index"), f"{place}.{key}.index")


def _check_mesh(tree: Tree, place: str, mesh: Tree) -> None:
    """Reject an empty mesh."""
    if not mesh.get("primitives"):
        raise ValueError(f"its {place} has no primitives")
    for at, primitive in _things(mesh, "primitives", f"{place}.primitives"):
        _check_primitive(tree, at, primitive)


def _check_primitive(tree: Tree, place: str, primitive: Tree) -> None:
    """Reject a primitive whose data are missing."""
    attributes = primitive.get("attributes")
    if not isinstance(attributes, dict):
        raise ValueError(f"its {place}.attributes is not an object")
    _object(primitive, "extensions", f"{place}.extensions")
    for name, wanted in (("POSITION", "VEC3"), ("TEXCOORD_0", "VEC2"), ("NORMAL", "VEC3")):
        if name in attributes or name == "POSITION":
            at = f"{place}.attributes.{name}"
            kind = _index(tree, "accessors", attributes.get(name), at).get("type")
            if kind != wanted:
                raise ValueError(f"its {at} is of type {kind}, not {wanted}")
    for name, value in attributes.items():
        _index(tree, "accessors", value, f"{place}.attributes.{name:.20}")
    for name, others in (("indices", "accessors"), ("material", "materials")):
        if name in primitive:
            _index(tree, others, primitive[name], f"{place}.{name}")


CHECKS: dict[str, Callable[[Tree, str, Tree], None]] = {
    "buffers": _check_uri,
    "images": _check_uri,
    "bufferViews": _check_view,
    "accessors": _check_accessor,
    "nodes": _check_numbers,
    "materials": _check_material,
    "meshes": _check_mesh,
}
