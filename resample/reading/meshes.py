"""Check the files that a mesh refers to: textures, materials, buffers."""

import errno
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from resample.messages import naming, one_line, visible
from resample.reading.limits import (
    allows_outside,
    check_items,
    check_members,
    check_size,
    check_unpacked,
    limits,
    neighbour,
    refused,
)
from resample.reading.texts import BLOCK, check_xml, check_xml_file, json_of

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
                every = thing.get(name, []) if name in LISTS or name not in thing else [thing[name]]
                if not isinstance(every, list):
                    raise ValueError(f"its {place}.{name} is {every!r:.40}, not a list")
                for one in every:
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


def _object(thing: Tree, name: str, place: str) -> Tree:
    """Object under a key; empty if missing."""
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
            f"its {place} needs {needed} bytes, but its bufferView has {view['byteLength']}"
        )


def _check_numbers(_: Tree, place: str, node: Tree) -> None:
    """Reject a node with an invalid transformation."""
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
    """Reject an empty mesh, and a primitive with missing data."""
    if not mesh.get("primitives"):
        raise ValueError(f"its {place} has no primitives")
    for at, primitive in _things(mesh, "primitives", f"{place}.primitives"):
        attributes = primitive.get("attributes")
        if not isinstance(attributes, dict):
            raise ValueError(f"its {at}.attributes is not an object")
        _object(primitive, "extensions", f"{at}.extensions")
        for name, wanted in (("POSITION", "VEC3"), ("TEXCOORD_0", "VEC2"), ("NORMAL", "VEC3")):
            if name in attributes or name == "POSITION":
                where = f"{at}.attributes.{name}"
                kind = _index(tree, "accessors", attributes.get(name), where).get("type")
                if kind != wanted:
                    raise ValueError(f"its {where} is of type {kind}, not {wanted}")
        for name, value in attributes.items():
            _index(tree, "accessors", value, f"{at}.attributes.{name:.20}")
        for name, others in (("indices", "accessors"), ("material", "materials")):
            if name in primitive:
                _index(tree, others, primitive[name], f"{at}.{name}")


CHECKS: dict[str, Callable[[Tree, str, Tree], None]] = {
    "buffers": _check_uri,
    "images": _check_uri,
    "bufferViews": _check_view,
    "accessors": _check_accessor,
    "nodes": _check_numbers,
    "materials": _check_material,
    "meshes": _check_mesh,
}


ARCHIVES = (".zip", ".3mf", ".zae")  # formats that contain files
MARKUP = (".dae", ".xaml", ".svg")  # XML formats
MARKUP_MEMBERS = (*MARKUP, ".model", ".rels", ".xml")  # XML files in archives
PACKED = (".gz", ".bz2", ".xz", ".tar", ".tgz", ".7z")  # compressed formats that are not supported


def check_mesh(source: Path) -> None:
    """Reject a mesh that refers to files outside its folder, or unpacks to too much.

    Raises ValueError: it is rejected. Raises OSError: it cannot be read.
    """
    kind = source.suffix.lower()
    if kind in PACKED:
        raise ValueError(f"{source.name} is packed; unpack it first")
    check_size(str(source), source.stat().st_size)
    if kind in ARCHIVES and zipfile.is_zipfile(source):
        with zipfile.ZipFile(source) as packed:
            infos = packed.infolist()
        check_members(source.name, infos, "members")
        unpacked = sum(info.file_size for info in infos)
        check_unpacked(source.name, source.stat().st_size, unpacked)
        members = [info for info in infos if info.filename.lower().endswith(MARKUP_MEMBERS)]
        try:
            with zipfile.ZipFile(source) as packed:
                for info in members:
                    with packed.open(info) as member:
                        blocks = iter(partial(member.read, BLOCK), b"")
                        check_xml(f"{source.name}: {info.filename}", blocks)
        except (zipfile.BadZipFile, RuntimeError, EOFError, zlib.error) as error:  # or encrypted
            raise ValueError(f"{source.name} is damaged: {error}") from None
    elif kind in MARKUP:
        check_xml_file(source)
    with suppress(FileNotFoundError):  # matters only if textures are needed
        for _ in _named(source):
            pass
    if kind in (".gltf", ".glb"):
        with naming(f"{source.name} cannot be read as a mesh"):
            told = header_of(source)
            check_gltf(told)
        # Numbers need not be in a file, and many nodes may show one mesh.
        unpacked = 0
        with suppress(ValueError, LookupError, AttributeError, TypeError):  # the reader says it
            sizes = [
                int(each["count"]) * SIZES[each["componentType"]] * PARTS[each["type"]]
                for each in told.get("accessors", [])
            ]
            meshes = []
            for mesh in told.get("meshes", []):
                meshes.append(0)
                for part in mesh["primitives"]:
                    meshes[-1] += sum(sizes[n] for n in part["attributes"].values())
                    meshes[-1] += sizes[part["indices"]] if "indices" in part else 0
            shown = [meshes[node["mesh"]] for node in told.get("nodes", []) if "mesh" in node]
            unpacked = max(sum(shown), sum(meshes))
        files = [source, *(file for file, _ in _named(source) if file.is_file())]
        check_unpacked(source.name, sum(file.stat().st_size for file in files), unpacked)


def named_textures(source: Path) -> Iterator[Path]:
    """Texture files of a mesh, whether they exist or not."""
    return (file for file, is_texture in _named(source) if is_texture)


def _named(source: Path) -> Iterator[tuple[Path, bool]]:
    """Referenced files, and whether each is a texture."""
    kind = source.suffix.lower()
    if kind == ".obj":
        for library in _values(source, "mtllib"):
            file = neighbour(source, library)
            yield file, False
            if not file.is_file():
                message = f"is missing; {source.name} names it for its textures"
                raise FileNotFoundError(errno.ENOENT, message, str(file))
            values = _values(file, "map_kd")
            names = [value.split()[-1] if value.startswith("-") else value for value in values]
            check_items(file.name, len(names), "textures")
            yield from ((neighbour(file, name), True) for name in names)
    elif kind == ".ply":
        with source.open("rb") as opened:
            header = opened.read(1 << 16).partition(b"end_header")[0].decode("latin-1")
        for line in header.splitlines():
            words = line.split(maxsplit=2)
            if words[:2] == ["comment", "TextureFile"] and len(words) == 3:
                yield neighbour(source, words[2].strip()), True
    elif kind == ".gltf":
        try:
            content = header_of(source)
            told = [
                (one.get("uri", "data:"), key == "images")
                for key in ("buffers", "images")
                for one in content.get(key, [])
            ]
        except (ValueError, AttributeError, TypeError):
            return  # the reader reports the error
        check_items(source.name, len(told), "buffers and pictures")
        for name, is_texture in told:
            if isinstance(name, str) and not name.startswith("data:"):
                yield neighbour(source, unquote(name)), is_texture


def _values(file: Path, key: str) -> list[str]:
    """Arguments of a keyword at the start of a file's lines."""
    with file.open(encoding="utf-8", errors="replace") as lines:
        split = (line.split(maxsplit=1) for line in lines)
        found = [words[1] for words in split if len(words) == 2 and words[0].lower() == key]
    return [value.strip().replace("\\", "/") for value in found]


def unreadable(what: str, error: Exception) -> ValueError:
    """Error for a mesh that trimesh or one of its parsers cannot read.

    They raise any type of error; if the message is not helpful, the type is named.
    """
    line = one_line(error)[:200]
    if not isinstance(error, ValueError | OSError):
        line = f"it is damaged, or trimesh does not support it ({type(error).__name__}: {line})"
    return ValueError(f"{what} cannot be read as a mesh: {line}")


def trimesh_resolver(source: Path) -> Any:
    """Resolver of referenced files for trimesh, after `check_mesh` has approved them."""
    import trimesh

    try:
        choices = {"allow_anywhere": True} if allows_outside() else {}
        resolver = trimesh.resolvers.FilePathResolver(str(source), **choices)
    except TypeError:  # always in trimesh before 5
        resolver = trimesh.resolvers.FilePathResolver(str(source))
    resolver.file_name = visible(resolver.file_name)  # used in the names of the mesh's parts
    return resolver
