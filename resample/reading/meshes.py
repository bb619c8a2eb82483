"""Check the files that a mesh refers to: textures, materials, buffers."""

import errno
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from resample.messages import naming, one_line, visible
from resample.reading.gltf import PARTS, SIZES, check_gltf, header_of
from resample.reading.limits import (
    check_items,
    check_members,
    check_size,
    check_unpacked,
    neighbour,
)
from resample.reading.texts import check_xml_file, check_xml_member

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
                        check_xml_member(f"{source.name}: {info.filename}", member)
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
        _check_parts(source, told)


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
        yield from _named_in_gltf(source)


def _check_parts(source: Path, told: dict[str, Any]) -> None:
    """Reject a glTF whose nodes expand to implausibly many numbers for its files.

    Numbers need not be in a file, and many nodes may instance one mesh.
    """
    unpacked = 0
    with suppress(ValueError, LookupError, AttributeError, TypeError):  # reported by the reader
        sizes = [
            int(each["count"]) * SIZES[each["componentType"]] * PARTS[each["type"]]
            for each in told.get("accessors", [])
        ]
        meshes = [
            sum(sizes[n] for part in mesh["primitives"] for n in _numbers_of(part))
            for mesh in told.get("meshes", [])
        ]
        shown = [meshes[node["mesh"]] for node in told.get("nodes", []) if "mesh" in node]
        unpacked = max(sum(shown), sum(meshes))
    files = [source, *(file for file, _ in _named(source) if file.is_file())]
    check_unpacked(source.name, sum(file.stat().st_size for file in files), unpacked)


def _numbers_of(part: dict[str, Any]) -> list[int]:
    """Accessors of a primitive."""
    return [*part["attributes"].values(), *([part["indices"]] if "indices" in part else [])]


def _named_in_gltf(source: Path) -> Iterator[tuple[Path, bool]]:
    """Buffers and pictures of a glTF file in JSON."""
    from urllib.parse import unquote

    try:
        content = header_of(source)
        told = [
            (one.get("uri", "data:"), key == "images")
            for key in ("buffers", "images")
            for one in content.get(key, [])
        ]
    except (ValueError, AttributeError, TypeError):
        return  # the reader reports what is wrong
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
    resolver = _resolver(source)
    resolver.file_name = visible(resolver.file_name)  # used in the names of the mesh's parts
    return resolver


def _resolver(source: Path) -> Any:
    import trimesh

    from resample.reading.limits import allows_outside

    if allows_outside():
        try:
            return trimesh.resolvers.FilePathResolver(str(source), allow_anywhere=True)
        except TypeError:  # always in trimesh before 5
            pass
    return trimesh.resolvers.FilePathResolver(str(source))
