"""Files that nobody vouches for: refused in one line, and without reading what they name."""

import base64
import bz2
import gzip
import io
import json
import os
import struct
import zipfile
import zlib

import numpy as np
import pytest

from resample import registry
from resample.cameras.calibrations import read_lens
from resample.cameras.files import read_entries, viewpoint
from resample.cameras.keyframes import read_keyframes
from resample.command.settings import options_of
from resample.files.pictures import read_picture
from resample.files.sequences import frames_of
from resample.messages import LONGEST, one_line, visible
from resample.reading.arrays import read_npy, read_npz
from resample.reading.limits import (
    allows_outside,
    check_free,
    check_unpacked,
    limits,
    neighbour,
    raised,
)
from resample.reading.texts import json_of, toml_of
from resample_meshes.files import load_mesh
from resample_points.files.readers import read_cloud
from resample_texture.geometry.mappings import read_map
from resample_volume.classification.files import read_transfer
from resample_volume.files.metaimage import MetaImage
from resample_volume.files.nifti import Nifti
from resample_volume.files.nrrd import Nrrd
from resample_volume.files.readers import Npy, Raw
from resample_volume.files.vtk import Vti
from resample_volume.meshes import read_mesh
from resample_warp3d.depth.files import read_depth
from resample_zarr.volumes import Zarr

REFUSALS = (ValueError, OSError, LookupError)
HEADERS = (
    "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 2), ",  # a TokenError
    "{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999999999999, 2), }",
    "{'descr': '<f4', 'fortran_order': False, 'shape': (4611686018427387904, 4), }",
    "{'descr': '<f4', 'fortran_order': False, 'shape': (-2, 2), }",
    "{'descr': '|O', 'fortran_order': False, 'shape': (2, 2), }",
    "{'descr': '<U0', 'fortran_order': False, 'shape': (2, 2), }",
    "((((((((((",
    "'\\x1b[2J'",
)


def put(path, content):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def refused(read, *given, match=None):
    """Message of a refusal, which is one line without control characters."""
    with pytest.raises(REFUSALS, match=match) as caught:
        read(*given)
    line = one_line(caught.value)
    assert line.isprintable()
    return line


def npy(header):
    text = header.encode("latin-1") + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + bytes(16)


def npz(path, **arrays):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, content in arrays.items():
            packed.writestr(f"{name}.npy", content)
    return path


def array(values):
    file = io.BytesIO()
    np.save(file, values)
    return file.getvalue()


@pytest.fixture
def tight(monkeypatch):
    """Limits that small files are over."""
    monkeypatch.setenv("RESAMPLE_LIMIT", "unpacked=64KB,ratio=100,items=20,depth=10")


# Limits


def test_a_setting_raises_limits(monkeypatch):
    monkeypatch.setenv("RESAMPLE_LIMIT", "unpacked=2GiB, ratio=7")
    assert limits().unpacked == 2 << 30
    assert limits().ratio == 7


@pytest.mark.parametrize("text", ["speed=3", "ratio=-1", "ratio", "ratio=2GiB", "depth=x"])
def test_a_setting_that_names_no_limit_is_refused(text, monkeypatch):
    monkeypatch.setenv("RESAMPLE_LIMIT", text)
    refused(limits, match="RESAMPLE_LIMIT or --limit has")


def test_what_unpacks_to_too_much_is_refused_with_the_way_to_raise_it():
    check_unpacked("a", 10, 1 << 20)
    refused(
        check_unpacked, "a", 1000, 1 << 31, match="raise it by --limit ratio=..., or RESAMPLE_LIMIT"
    )


def test_what_is_more_than_free_memory_is_refused(monkeypatch):
    monkeypatch.setattr("resample.reading.limits.available_memory", lambda: 1000)
    refused(check_free, "a", 1001, match="are free")


# Bombs


@pytest.mark.usefixtures("tight")
def test_a_bomb_among_arrays_is_refused_before_it_is_unpacked(tmp_path):
    path = npz(tmp_path / "a.npz", position=array(np.zeros((90_000, 3))))
    refused(read_cloud, path, match="unpack to")
    refused(read_depth, path, match="unpack to")
    refused(read_map, path, match="unpack to")


@pytest.mark.usefixtures("tight")
def test_an_archive_of_very_many_arrays_is_refused(tmp_path):
    path = npz(tmp_path / "a.npz", **{f"a{n}": array(np.zeros(1)) for n in range(30)})
    refused(read_cloud, path, match="30 arrays, over the limit of 20")


@pytest.mark.usefixtures("tight")
@pytest.mark.parametrize("kind", ["nhdr", "bzip2", "mhd", "raw.gz"])
def test_a_bomb_of_raw_data_is_refused(kind, tmp_path):
    put(tmp_path / "a_64x64x64_uint8.raw.gz", gzip.compress(bytes(64**3)))
    put(tmp_path / "a.bz2", bz2.compress(bytes(64**3)))
    put(tmp_path / "a.zraw", zlib.compress(bytes(64**3)))
    headers = {
        "nhdr": "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 64 64 64\nencoding: gzip\n"
        "data file: a_64x64x64_uint8.raw.gz\n",
        "mhd": "ObjectType = Image\nNDims = 3\nDimSize = 64 64 64\nElementType = MET_UCHAR\n"
        "CompressedData = True\nElementDataFile = a.zraw\n",
        "bzip2": "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 64 64 64\nencoding: bzip2\n"
        "data file: a.bz2\n",
        "raw.gz": "",
    }
    reader = {"nhdr": Nrrd(), "bzip2": Nrrd(), "mhd": MetaImage(), "raw.gz": Raw()}[kind]
    path = tmp_path / "a_64x64x64_uint8.raw.gz"
    if headers[kind]:
        path = put(tmp_path / f"a.{kind.replace('bzip2', 'nhdr')}", headers[kind])
    refused(reader, path, match="unpack to")


def test_raw_data_that_never_end_are_not_unpacked_to_their_end(tmp_path, monkeypatch):
    monkeypatch.setattr("resample_volume.files.headers.SLACK", 1 << 16)
    put(tmp_path / "a.raw.gz", gzip.compress(bytes(1 << 22), 1))
    text = (
        "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nencoding: gzip\ndata file: a.raw.gz\n"
    )
    refused(Nrrd(), put(tmp_path / "a.nhdr", text), match="or more bytes, 64 are wanted")


@pytest.mark.parametrize("count", [65, 6 << 20])
def test_packed_data_of_the_wrong_size_say_so_however_much_more_they_are(count, tmp_path):
    path = put(tmp_path / "a_4x4x4_uint8.raw.gz", gzip.compress(bytes(count), 1))
    refused(Raw(), path, match=f"holds {count} bytes, 64 are wanted")


def test_a_nifti_that_goes_on_behind_its_values_is_not_unpacked_to_its_end(tmp_path, monkeypatch):
    monkeypatch.setattr("resample_volume.files.headers.SLACK", 1 << 16)
    start = bytearray(352)
    struct.pack_into("<i", start, 0, 348)
    struct.pack_into("<8h", start, 40, 3, 4, 4, 4, 1, 1, 1, 1)
    struct.pack_into("<2h", start, 70, 2, 8)
    struct.pack_into("<8f", start, 76, *[1.0] * 8)
    struct.pack_into("<f", start, 108, 352.0)
    start[344:348] = b"n+1\0"
    path = put(tmp_path / "a.nii.gz", gzip.compress(bytes(start) + bytes(1 << 20), 1))
    refused(Nifti(), path, match="or more bytes")
    monkeypatch.setenv("RESAMPLE_LIMIT", "unpacked=64KB,ratio=10")
    struct.pack_into("<8h", start, 40, 3, 64, 64, 64, 1, 1, 1, 1)
    path = put(tmp_path / "b.nii.gz", gzip.compress(bytes(start) + bytes(64**3), 1))
    refused(Nifti(), path, match="that unpack to")


@pytest.mark.usefixtures("tight")
def test_a_header_that_lists_very_many_files_is_refused(tmp_path):
    head = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nencoding: raw\ndata file: "
    names = "".join(f"a{n}.raw\n" for n in range(40))
    refused(Nrrd(), put(tmp_path / "a.nhdr", head + "LIST\n" + names), match="40 files named")
    every = put(tmp_path / "b.nhdr", head + "a%09d.raw 1 900000000 1\n")
    refused(Nrrd(), every, match="900000000 files named")


NRRD = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nencoding: raw\n{}data file: a.raw\n"
MHD = "ObjectType = Image\nNDims = {}\nDimSize = 4 4 4\n{}ElementType = MET_UCHAR\n"


@pytest.mark.parametrize(
    "line", ["spacings: 1 1 " + "a." * 3000, "a" * 5000, "sizes: 4 4 4 4 4", "spacings: x 1 1"]
)
def test_nrrd_headers_that_end_itk_s_process_are_refused(line, tmp_path):
    put(tmp_path / "a.raw", bytes(64))
    refused(Nrrd(), put(tmp_path / "a.nhdr", NRRD.format(line + "\n")), match="a.nhdr: ")


@pytest.mark.parametrize(
    ("axes", "line"),
    [("256", ""), ("1e38", ""), ("3", "Offset = 0 (((0 0"), ("3", "ElementSpacing = 1 1")],
)
def test_metaimage_headers_that_end_itk_s_process_are_refused(axes, line, tmp_path):
    text = MHD.format(axes, line + "\n" if line else "") + "ElementDataFile = a.raw\n"
    put(tmp_path / "a.raw", bytes(64))
    refused(MetaImage(), put(tmp_path / "a.mhd", text), match="a.mhd: ")


@pytest.mark.parametrize("name", ["%s%n", "%s%n 1 2 1", "a%d%d.raw 1 2 1", "a%99999d.raw 1 2 1"])
def test_patterns_of_names_that_printf_would_obey_are_refused(name, tmp_path):
    text = MHD.format("3", "") + f"ElementDataFile = {name}\n"
    refused(MetaImage(), put(tmp_path / "a.mhd", text), match="is not a pattern of names")
    nrrd = NRRD.format("").replace("a.raw", name)
    refused(Nrrd(), put(tmp_path / "a.nhdr", nrrd), match="is not a pattern of names")


def test_lenses_that_end_opencv_s_process_are_refused(tmp_path):
    text = "%YAML:1.0\n---\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   [[[[cols]]]]: 3\n"
    refused(read_lens, str(put(tmp_path / "a.yml", text)))
    for xml in ("<opencv_storage>" + "<a>" * 9000, "<!DOCTYPE a><opencv_storage/>", "<b/>"):
        refused(read_lens, str(put(tmp_path / "a.xml", xml)))


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian"])
@pytest.mark.parametrize("count", ["99999999999999999999", "2000000000"])
def test_clouds_of_more_points_than_their_file_has_room_for_are_cut_off(count, encoding, tmp_path):
    head = f"ply\nformat {encoding} 1.0\nelement vertex {count}\nproperty float x\n"
    rest = "property float y\nproperty float z\nend_header\n1 2 3\n"
    refused(read_cloud, put(tmp_path / "a.ply", head + rest), match="is cut off")


def test_a_cloud_whose_numbers_have_no_size_is_refused(tmp_path):
    head = "FIELDS x y z\nSIZE 4 4 ,\nTYPE F F F\nPOINTS 1\nDATA binary\n"
    refused(read_cloud, put(tmp_path / "a.pcd", head + 12 * "1"), match="no PCD header")


def test_a_cloud_of_very_many_points_of_nothing_is_refused(tmp_path):
    head = f"FIELDS\nSIZE\nTYPE\nPOINTS {10**30}\nDATA binary\n"
    refused(read_cloud, put(tmp_path / "a.pcd", head), match="cut off")


def test_grids_of_vtk_that_are_far_larger_than_their_file_are_refused(tmp_path):
    pytest.importorskip("vtkmodules")
    text = (
        '<VTKFile type="ImageData" version="0.1"><ImageData WholeExtent="0 7 0 999999999 0 5" '
        'Origin="0 0 0" Spacing="1 1 1"><Piece Extent="0 7 0 6 0 5"/></ImageData></VTKFile>'
    )
    refused(Vti(), put(tmp_path / "a.vti", text), match=r"unpack to|needs|damaged")
    refused(Vti(), put(tmp_path / "b.vti", text[:-10]), match="is damaged")
    packed = '<AppendedData encoding="base64">_AQAA((((AAA==</AppendedData></VTKFile>'
    damaged = text.replace("</VTKFile>", packed)
    refused(Vti(), put(tmp_path / "c.vti", damaged), match="is damaged")


@pytest.mark.parametrize("encoding", ["base64", "raw", "inline"])
@pytest.mark.parametrize("sizes", [(0x69A69A69, 1 << 15, 1), (2, 0xFFFFFFFF, 1)])
def test_blocks_of_vtk_that_the_file_cannot_hold_are_refused(sizes, encoding, tmp_path):
    pytest.importorskip("vtkmodules")
    packed = struct.pack("<3I", *sizes)
    letters = base64.b64encode(packed) + b"\n"
    inline = (
        b'format="binary">' + letters if encoding == "inline" else b'format="appended" offset="0">'
    )
    data = packed + bytes(40) if encoding == "raw" else letters
    appended = (
        b""
        if encoding == "inline"
        else (b'<AppendedData encoding="%s">_%s</AppendedData>' % (encoding.encode(), data))
    )
    content = (
        b'<VTKFile type="ImageData" version="0.1" byte_order="LittleEndian" header_type="UInt32" '
        b'compressor="vtkZLibDataCompressor"><ImageData WholeExtent="0 7 0 6 0 5" Origin="0 0 0" '
        b'Spacing="1 1 1"><Piece Extent="0 7 0 6 0 5"><PointData Scalars="a"><DataArray '
        b'type="UInt8" Name="a" '
        + inline
        + b"</DataArray></PointData></Piece></ImageData>"
        + appended
        + b"</VTKFile>"
    )
    match = r"blocks are not there|unpack to"
    refused(Vti(), put(tmp_path / "a.vti", content), match=match)
    if encoding == "base64":
        without = content.replace(b">_", b">\n ")
        refused(Vti(), put(tmp_path / "b.vti", without), match="begin with an underscore")


def test_zarr_arrays_with_chunks_of_nothing_are_refused(tmp_path):
    zarr = pytest.importorskip("zarr")
    zarr.create_array(tmp_path / "a.zarr", shape=(4, 4, 4), chunks=(2, 2, 2), dtype="u1")
    path = tmp_path / "a.zarr" / "zarr.json"
    told = json.loads(path.read_text())
    told["chunk_grid"]["configuration"]["chunk_shape"] = [0, 2, 2]
    put(path, json.dumps(told))
    refused(Zarr(), tmp_path / "a.zarr")


# Depth and numbers


@pytest.mark.parametrize("text", ["[" * 100_000, '{"a":' * 100_000, "[" * 80 + "]" * 80])
def test_deeply_nested_json_is_refused(text, tmp_path):
    refused(json_of, text)
    path = put(tmp_path / "a.json", text)
    for read in (read_transfer, read_entries, lambda path: read_lens(str(path))):
        refused(read, path)


@pytest.mark.some(1)
@pytest.mark.parametrize(
    "text", ["a = " + "[" * 50_000, "a" + ".a" * 500_000 + " = 1", "[" + "a." * 90 + "a]\n"]
)
def test_deeply_nested_toml_is_refused(text, tmp_path):
    refused(toml_of, text, match="nested levels")
    path = put(tmp_path / "a.toml", text)
    lens = str(path)
    for read in (read_transfer, read_keyframes, read_entries):
        refused(read, path)
    refused(read_lens, lens)
    refused(viewpoint, lens)


@pytest.mark.sweep
def test_a_very_long_word_is_looked_at_once():
    with pytest.raises(ValueError, match="Expected '='"):
        toml_of("a" * (4 << 20))  # when each letter could begin a name, its square took minutes


def test_dotted_names_that_are_not_deep_are_read():
    assert toml_of("a.b.c = 1.5\n'x.y'.z = 'a.b.c.d.e'\n")["x.y"] == {"z": "a.b.c.d.e"}


@pytest.mark.parametrize("number", ["1" + "0" * 400, "9223372036854775808", "1" * 5000])
def test_numbers_beyond_64_bits_are_refused(number, tmp_path):
    points = f'{{"points": [{{"value": {number}, "color": "red", "opacity": 1}}]}}'
    refused(read_transfer, put(tmp_path / "a.json", points))
    lens = f'{{"camera_matrix": [[{number}, 0, 1], [0, 1, 1], [0, 0, 1]], "dist": [0, 0, 0, 0]}}'
    refused(read_lens, str(put(tmp_path / "lens.json", lens)))
    refused(toml_of, f"a = {number}")
    ply = f"ply\nformat ascii 1.0\nelement vertex {number}\nproperty float x\nend_header\n1\n"
    refused(read_cloud, put(tmp_path / "a.ply", ply))


# Arrays


@pytest.mark.parametrize("header", HEADERS)
def test_headers_of_arrays_that_are_nonsense_are_refused(header, tmp_path):
    path = put(tmp_path / "a.npy", npy(header))
    for read in (Npy(), read_depth, read_map, read_entries):
        refused(read, path)
    packed = npz(tmp_path / "a.npz", position=npy(header))
    for read in (read_cloud, read_depth, read_map):
        refused(read, packed)


def test_a_wrong_checksum_is_damage(tmp_path):
    path = npz(tmp_path / "a.npz", position=array(np.arange(300.0).reshape(100, 3)))
    content = bytearray(path.read_bytes())
    place = content.index(b"PK\1\2") + 16  # of the sum in the list of members
    content[place] ^= 255
    put(path, bytes(content))
    assert "damaged" in refused(read_cloud, path)
    assert "damaged" in refused(read_depth, path)


# Files that are named


@pytest.mark.parametrize(
    "name",
    ["../a.raw", "/etc/passwd", "C:\\a.raw", "x/../../a", "https://example.org/a", "file:///a"],
)
def test_names_that_lead_outside_are_refused(name, tmp_path):
    line = refused(neighbour, tmp_path / "a.nhdr", name, match="an address|leads outside|absolute")
    assert line.startswith("a.nhdr names")


def test_a_link_that_leads_outside_is_refused(tmp_path):
    inner = tmp_path / "inner"
    inner.mkdir()
    put(tmp_path / "secret.raw", b"secret")
    (inner / "a.raw").symlink_to(tmp_path / "secret.raw")
    refused(neighbour, inner / "a.nhdr", "a.raw", match="a link that leads outside")


def test_neighbours_of_a_file_that_is_a_link_are_found(tmp_path):
    (tmp_path / "data").mkdir()
    (tmp_path / "work").mkdir()
    for name in ("a.nhdr", "a.raw"):
        put(tmp_path / "data" / name, b"")
        (tmp_path / "work" / name).symlink_to(tmp_path / "data" / name)
    assert neighbour(tmp_path / "work" / "a.nhdr", "a.raw").is_file()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes here")
def test_pipes_and_devices_are_refused(tmp_path, monkeypatch):
    os.mkfifo(tmp_path / "a.raw")
    refused(neighbour, tmp_path / "a.nhdr", "a.raw", match="a device or a pipe")
    monkeypatch.setenv("RESAMPLE_ALLOW_OUTSIDE", "1")
    refused(neighbour, tmp_path / "a.nhdr", "/dev/zero", match="a device or a pipe")


def test_the_setting_lets_files_outside_in(tmp_path, monkeypatch):
    monkeypatch.setenv("RESAMPLE_ALLOW_OUTSIDE", "1")
    assert neighbour(tmp_path / "a.nhdr", "../a.raw") == tmp_path / "../a.raw"


def outside(folder):
    """A folder beside which there is a picture and raw data that nobody must read."""
    inner = folder / "inner"
    inner.mkdir()
    put(folder / "a.raw", bytes(64))
    return inner


@pytest.mark.parametrize("name", ["../a.raw", "{folder}/a.raw"])
def test_headers_do_not_have_raw_data_outside_read(name, tmp_path):
    inner, name = outside(tmp_path), name.format(folder=tmp_path)
    head = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nencoding: raw\ndata file: "
    refused(Nrrd(), put(inner / "a.nhdr", f"{head}{name}\n"), match="own folder only")
    refused(Nrrd(), put(inner / "b.nhdr", f"{head}LIST\n{name}\n"), match="own folder only")
    mhd = "ObjectType = Image\nNDims = 3\nDimSize = 4 4 4\nElementType = MET_UCHAR\n"
    path = put(inner / "a.mhd", f"{mhd}ElementDataFile = {name}\n")
    refused(MetaImage(), path, match="own folder only")


@pytest.mark.parametrize("name", ["../a.png", "/a.png", "https://example.org/a.png"])
def test_meshes_do_not_have_textures_outside_read(name, tmp_path):
    inner = outside(tmp_path)
    put(inner / "a.mtl", f"newmtl a\nmap_Kd {name}\n")
    obj = "mtllib {}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl a\nf 1/1 2/1 3/1\n"
    for source in (
        put(inner / "a.obj", obj.format("a.mtl")),
        put(inner / "b.obj", obj.format(name)),
    ):
        refused(load_mesh, source, match="own folder only|an address")
        refused(read_mesh, str(source), match="own folder only|an address")
    ply = f"ply\nformat ascii 1.0\ncomment TextureFile {name}\nend_header\n"
    refused(load_mesh, put(inner / "a.ply", ply), match="own folder only|an address")
    for key in ("images", "buffers"):
        text = json.dumps({"asset": {"version": "2.0"}, key: [{"uri": name}]})
        source = put(inner / f"{key}.gltf", text)
        refused(load_mesh, source, match="own folder only|an address")


# Words


def test_control_characters_are_written_as_codes():
    assert visible("a\x1b[2Jb\r\n\u202ec é") == "a\\x1b[2Jb\\r\\n\\u202ec é"


def test_errors_of_the_system_are_said_without_their_numbers():
    assert one_line(OSError(28, "No space left on device")) == "No space left on device"
    assert one_line(OSError(2, "No such file", "a.png")) == "a.png: No such file"
    assert one_line(OSError("a.png is damaged")) == "a.png is damaged"


def test_messages_hold_no_control_characters_of_files(tmp_path):
    text = "ply\nformat ascii 1.0\nelement vertex \x1b[2J\nend_header\n"
    assert "\\x1b" in refused(read_cloud, put(tmp_path / "a.ply", text))
    head = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\ndata file: \x1b]0;x\x07.raw\n"
    assert "\\x1b" in refused(Nrrd(), put(tmp_path / "a.nhdr", head))


def test_a_command_raises_limits_for_itself_alone(monkeypatch):
    monkeypatch.setenv("RESAMPLE_LIMIT", "depth=10,items=20")
    with raised("depth=90", allow_outside=True):
        assert (limits().depth, limits().items) == (90, 20)
        assert allows_outside()
    assert (limits().depth, allows_outside()) == (10, False)
    with pytest.raises(ValueError, match="--limit has 'height=3'"), raised("height=3"):
        pass


@pytest.mark.sweep
@pytest.mark.parametrize("application", ["points", "texture", "volume", "warp3d"])
def test_every_command_takes_the_flags_that_raise_limits(application):
    app = registry.load("apps", application)
    for name in (name for name in app if not name.startswith("-")):
        options = options_of(app[name])
        if "settings" in options:
            assert {"memory", "limit", "allow-outside"} <= set(options), name


def test_an_animation_whose_frames_are_far_larger_than_its_file_is_refused(tmp_path):
    from PIL import Image

    frames = [Image.new("L", (8, 8), level) for level in (0, 100, 200)]
    frames[0].save(tmp_path / "a.gif", save_all=True, append_images=frames[1:])
    data = bytearray((tmp_path / "a.gif").read_bytes())
    data[6:10] = struct.pack("<HH", 7600, 7600)  # the screen, of which frames are a part
    put(tmp_path / "a.gif", bytes(data))
    refused(frames_of, tmp_path / "a.gif", match=r"unpack to 3 frames of 0\.86 GiB, over the limit")


@pytest.mark.parametrize("kind", ["u1", "<f8", ">i4"])
def test_of_an_array_that_is_cut_off_it_is_told_how_much_is_there(tmp_path, kind):
    values, path = np.arange(20, dtype=kind), tmp_path / "a.npy"
    np.save(path, values)
    path.write_bytes(path.read_bytes()[: -values.itemsize])
    with pytest.raises(
        OSError, match=f"{values.nbytes - values.itemsize} of {values.nbytes} bytes"
    ):
        read_npy(path)


@pytest.mark.parametrize("kind", ["u1", "<f8"])
def test_an_array_in_a_file_of_several_is_cut_off_by_its_own_size(tmp_path, kind):
    np.save(tmp_path / "a.npy", np.arange(20, dtype=kind))
    content = (tmp_path / "a.npy").read_bytes()
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as packed:
        packed.writestr("a.npy", content)
        packed.writestr("b.npy", content[: -np.dtype(kind).itemsize])
    assert read_npz(tmp_path / "a.npz", "a")["a"].size == 20
    with pytest.raises(OSError, match="b is cut off"):
        read_npz(tmp_path / "a.npz")


@pytest.mark.parametrize("reader", [read_npy, read_npz, read_picture])
def test_a_file_that_is_not_there_is_said_to_be_missing(tmp_path, reader):
    with pytest.raises(OSError, match="absent"):
        reader(tmp_path / "absent.npy")


def test_a_long_text_is_told_by_its_beginning_and_its_end():
    text = "".join(chr(ord("a") + n % 26) for n in range(LONGEST + 1))
    assert one_line(ValueError(text[:-1])) == text[:-1]
    begin, dots, end = one_line(ValueError(text)).partition(" ... ")
    assert dots
    assert text.startswith(begin)
    assert text.endswith(end)
    assert LONGEST - 1 <= len(begin) + len(end) <= LONGEST + 1
    assert abs(len(begin) - len(end)) <= 1
