"""Small files that become gigabytes: each kind is refused before memory holds what it becomes."""

import bz2
import gzip
import io
import json
import lzma
import os
import struct
import zipfile
import zlib
from functools import partial
from itertools import pairwise

import numpy as np
import pytest

from resample.files.films import film_picture, new_film, new_stream
from resample.files.images import read_image
from resample.files.metadata.tags import read_tags, settings_in
from resample.files.pictures import read_picture
from resample.files.saving import DepthSlab, write_deep
from resample.files.sequences import frames_of
from resample.files.writing import load_arrays
from resample.messages import one_line
from resample.reading.arrays import read_npz
from resample.reading.limits import deflated, unpacked
from resample.reading.meshes import check_mesh
from resample.reading.pictures import size_at_once, size_of
from resample_meshes.files import load_mesh
from resample_points.files.readers import read_cloud
from resample_volume.files.dicom import Dicom
from resample_volume.files.nrrd import Nrrd
from resample_volume.files.tiff import TiffStack
from resample_volume.files.vtk import check_blocks
from resample_volume.meshes import read_mesh
from resample_warp3d.depth.files import read_depth
from tests.deep import read_deep

DATA = b"abcdefgh" * 100
PACKERS = {
    "zlib": (zlib.compress, deflated),
    "gzip": (gzip.compress, deflated),
    "bzip2": (bz2.compress, partial(unpacked, new=bz2.BZ2Decompressor)),
    "xz": (lzma.compress, partial(unpacked, new=lzma.LZMADecompressor)),
}
PIXEL = struct.pack(">IIBBBBB", 1, 1, 8, 2, 0, 0, 0)


@pytest.fixture
def tight(monkeypatch):
    """Limits that small files are over."""
    monkeypatch.setenv("RESAMPLE_LIMIT", "unpacked=64KB,ratio=100,items=20,tree=10KB")


def refused(read, *given, match):
    with pytest.raises((ValueError, OSError), match=match) as caught:
        read(*given)
    assert one_line(caught.value).isprintable()


# Packings


@pytest.mark.parametrize("kind", PACKERS)
def test_what_is_packed_becomes_no_more_than_it_may(kind):
    pack, unpack = PACKERS[kind]
    assert unpack(pack(DATA), len(DATA)) == DATA
    refused(unpack, pack(DATA), len(DATA) - 1, match="unpacks to more than")
    refused(unpack, pack(DATA)[:-9], len(DATA), match="is cut off|is damaged")


@pytest.mark.parametrize("kind", ["gzip", "bzip2", "xz"])
def test_streams_behind_each_other_are_bounded_together(kind):
    pack, unpack = PACKERS[kind]
    assert unpack(pack(DATA) * 2, 2 * len(DATA)) == DATA * 2
    refused(unpack, pack(DATA) * 2, 2 * len(DATA) - 1, match="unpacks to more than")


@pytest.mark.parametrize("by", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_zip_files_whose_sizes_cannot_be_relied_on_are_refused(by, tmp_path):
    for name in ("a.npz", "a.3mf"):
        with zipfile.ZipFile(tmp_path / name, "w") as packed:
            packed.writestr("a.npy", DATA, by)
    refused(read_npz, tmp_path / "a.npz", match="packed by a method with unreliable sizes")
    refused(check_mesh, tmp_path / "a.3mf", match="packed by a method with unreliable sizes")


@pytest.mark.usefixtures("tight")
def test_files_of_caches_are_bounded_like_others(tmp_path):
    head = b"{'descr': '|u1', 'fortran_order': False, 'shape': (1000000,), }"
    claim = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head
    (tmp_path / "a.npy").write_bytes(claim)
    assert load_arrays(tmp_path / "a.npy", "measured") is None


# Volumes


def dicom(path, pixels=bytes(32), syntax="1.2.840.10008.1.2.1", private=b"", **facts):
    import pydicom
    from pydicom.dataset import FileMetaDataset

    meta = FileMetaDataset()
    meta.TransferSyntaxUID, meta.MediaStorageSOPInstanceUID = syntax, "1.2.3"
    meta.MediaStorageSOPClassUID = "1.2.840.10008.5.1.4.1.1.2"
    told = pydicom.Dataset()
    told.file_meta, told.SOPClassUID = meta, meta.MediaStorageSOPClassUID
    told.SeriesInstanceUID, told.PhotometricInterpretation = "1.2.3", "MONOCHROME2"
    told.Rows, told.Columns, told.SamplesPerPixel, told.NumberOfFrames = 4, 4, 1, 2
    told.BitsAllocated = told.BitsStored = 8
    told.HighBit, told.PixelRepresentation = 7, 0
    for key, value in facts.items():
        setattr(told, key, value)
    told.add_new(0x00091001, "OB", private)
    told.PixelData = pixels
    told.save_as(path, enforce_file_format=True)
    return path


DEFLATED = "1.2.840.10008.1.2.1.99"


def test_deflated_dicom_is_read(tmp_path):
    values = bytes(range(32))
    found = Dicom()(dicom(tmp_path / "a.dcm", values, DEFLATED)).values
    assert found.tobytes() == values


@pytest.mark.usefixtures("tight")
@pytest.mark.parametrize("is_folder", [False, True])
def test_deflated_dicom_that_becomes_far_too_much_is_refused(is_folder, tmp_path):
    path = dicom(tmp_path / "a.dcm", syntax=DEFLATED, private=bytes(500_000))
    refused(Dicom(), tmp_path if is_folder else path, match=r"a\.dcm: .* that unpack to")


@pytest.mark.usefixtures("tight")
def test_dicom_of_very_many_frames_is_refused(tmp_path):
    path = dicom(tmp_path / "a.dcm", bytes(16 * 30), NumberOfFrames=30)
    refused(Dicom(), path, match="30 frames, over the limit of 20")


def jpeg(mark, size):
    """First bytes of a picture of JPEG, or one of its kin."""
    return b"\xff\xd8\xff" + mark + struct.pack(">HB2H4B", 11, 8, *size, 1, 1, 17, 0) + bytes(50)


def test_packed_pictures_tell_their_sizes():
    comment = b"\xff\xd8\xff\xfe\0\x04ab\xff\xff" + jpeg(b"\xc3", (5, 6))[3:]
    assert size_of(comment) == (5, 6)
    assert size_of(jpeg(b"\xf7", (7, 8))) == (7, 8)
    sized = struct.pack(">2H4I", 41, 0, 30, 20, 10, 5)
    assert size_of(b"\xff\x4f\xff\x51" + sized) == (15, 20)
    assert size_of(bytes(40)) is None
    assert size_of(b"\xff\xd8\xff\xc0\0") is None


@pytest.mark.parametrize(
    ("syntax", "mark"), [("1.2.840.10008.1.2.4.50", b"\xc0"), ("1.2.840.10008.1.2.4.80", b"\xf7")]
)
def test_packed_pictures_of_another_size_than_their_file_says_are_refused(syntax, mark, tmp_path):
    pydicom = pytest.importorskip("pydicom")
    if mark == b"\xf7":
        pytest.importorskip("gdcm", reason="JPEG-LS is unpacked by the extra dicom")
    frames = pydicom.encaps.encapsulate([jpeg(mark, (65000, 65000))] * 2)
    path = dicom(tmp_path / "a.dcm", frames, syntax)
    refused(Dicom(), path, match="holds a picture of 65000 x 65000 pixels and says that it has 4 x")


def test_pipes_among_slices_are_refused(tmp_path):
    os.mkfifo(tmp_path / "a.dcm")
    refused(Dicom(), tmp_path, match="a device or a pipe")
    refused(Dicom(), tmp_path / "a.dcm", match="a device or a pipe")
    os.mkfifo(tmp_path / "a.tif")
    refused(TiffStack(), tmp_path, match="a device or a pipe")


@pytest.mark.usefixtures("tight")
def test_a_packed_file_that_is_named_many_times_is_counted_once(tmp_path):
    (tmp_path / "a.gz").write_bytes(gzip.compress(bytes(64 * 64 * 8)))
    head = (
        "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 64 64 160\nencoding: gzip\ndata file: LIST\n"
    )
    (tmp_path / "a.nhdr").write_text(head + "a.gz\n" * 20)
    refused(Nrrd(), tmp_path / "a.nhdr", match=r"a: .* that unpack to 0\.62 MiB or more")


@pytest.mark.usefixtures("tight")
def test_arrays_of_vtk_are_counted_together(tmp_path):
    arrays = '<DataArray format="appended" offset="0"/>' * 3
    text = f'<VTKFile header_type="UInt64" compressor="a">{arrays}<AppendedData encoding="raw">_'
    block = struct.pack("<4Q", 1, 50_000, 0, 60)
    (tmp_path / "a.vti").write_bytes(text.encode() + block + bytes(60) + b"</VTKFile>")
    refused(check_blocks, tmp_path / "a.vti", match=r"that unpack to 0\.10 MiB or more")


@pytest.mark.parametrize("start", ["==eJw", "!AAAA", "AQ==eJwAA", "AQAAAA==eJwAA"])
def test_arrays_of_vtk_that_do_not_begin_with_their_size_are_refused(start, tmp_path):
    head = '<VTKFile header_type="UInt32" compressor="vtkZLibDataCompressor">'
    for kind, rest in (("binary", start), ("appended", "")):
        text = f'{head}<DataArray format="{kind}" offset="0">\n{rest}</DataArray>'
        if kind == "appended":
            text += f'<AppendedData encoding="base64">_{start}</AppendedData>'
        (tmp_path / "a.vti").write_text(text)
        refused(check_blocks, tmp_path / "a.vti", match="do not begin with their size")


# Pictures


def tiff(path, pages, side, strip, tags=(), *, goes_round=False):
    """TIFF of pages that share one strip."""
    data, before = bytearray(b"II*\0\0\0\0\0" + strip + bytes(len(strip) % 2)), 4
    for _ in range(pages):
        struct.pack_into("<I", data, before, len(data))
        lines = [(256, 4, 1, side), (257, 4, 1, side), (258, 3, 1, 8), (259, 3, 1, 8)]
        lines += [(262, 3, 1, 1), (273, 4, 1, 8), (277, 3, 1, 1), (278, 4, 1, side)]
        lines = sorted([*lines, (279, 4, 1, len(strip)), *tags])
        data += struct.pack("<H", len(lines))
        data += b"".join(struct.pack("<HHII", *line) for line in lines)
        before = len(data)
        data += struct.pack("<I", 8 + len(strip) + len(strip) % 2 if goes_round else 0)
    path.write_bytes(data)
    return path


@pytest.mark.usefixtures("tight")
def test_pages_that_share_their_pixels_are_counted_together(tmp_path):
    path = tiff(tmp_path / "a.tif", 10, 250, zlib.compress(bytes(250 * 250)))
    refused(TiffStack(), path, match=r"a: .* that unpack to 0\.60 MiB or more")
    many = tiff(tmp_path / "b.tif", 30, 4, zlib.compress(bytes(16)))
    refused(TiffStack(), many, match="21 slices, over the limit of 20")


@pytest.mark.sweep
def test_tags_that_overlap_or_go_round_are_damage(tmp_path):
    texts = [(tag, 2, 1 << 17, 8) for tag in (270, 271, 272)]
    path = tiff(tmp_path / "a.tif", 60, 4, bytes(1 << 17), texts)
    refused(read_tags, path, (270, 271, 272), {}, match="directories overlap or form a loop")
    padding = [(60000 + n, 3, 1, 1) for n in range(2000)]
    path = tiff(tmp_path / "b.tif", 1, 4, bytes(16), padding, goes_round=True)
    refused(read_tags, path, (270,), {}, match="directories overlap or form a loop")


def png(path, *texts):
    chunks = [(b"IHDR", PIXEL), *texts, (b"IDAT", zlib.compress(bytes(4))), (b"IEND", b"")]
    content = b"\x89PNG\r\n\x1a\n"
    for name, data in chunks:
        content += struct.pack(">I", len(data)) + name + data
        content += struct.pack(">I", zlib.crc32(name + data))
    path.write_bytes(content)
    return path


LONG = zlib.compress(b"a" * 15_000)
TEXTS = {
    b"zTXt": b"resample:settings\0\0" + LONG,
    b"iTXt": b"resample:settings\0\1\0\0\0" + LONG,
    b"iCCP": b"profile\0\0" + LONG,
}


@pytest.mark.usefixtures("tight")
@pytest.mark.parametrize("suffix", ["jxl", "jp2", "j2k"])
def test_pictures_that_are_unpacked_as_they_are_opened_are_looked_at_before(suffix, tmp_path):
    sized = b"\xff\x4f\xff\x51" + struct.pack(">2H4I", 41, 0, 3000, 2000, 0, 0)
    boxed = b"\0\0\0\x0cjP  \r\n\x87\n" + bytes(60)
    bits = 2 << 1 | 1999 << 3 | 0 << 21 | 2 << 24 | 2999 << 26
    content = {"j2k": sized, "jp2": boxed + sized, "jxl": b"\xff\x0a" + bits.to_bytes(12, "little")}
    (tmp_path / f"a.{suffix}").write_bytes(content[suffix] + bytes(40))
    refused(read_picture, tmp_path / f"a.{suffix}", match=r"that unpack to 5\.72 MiB or more")


@pytest.mark.parametrize("shape", [(16, 24), (17, 300), (9, 9), (30, 40), (5000, 3)])
def test_pictures_of_jpeg_xl_tell_their_sizes(shape, tmp_path):
    import OpenImageIO

    target = OpenImageIO.ImageOutput.create(str(tmp_path / "a.jxl"))
    target.open(str(tmp_path / "a.jxl"), OpenImageIO.ImageSpec(*shape[::-1], 1, "uint8"))
    target.write_image(np.zeros((*shape, 1), np.uint8))
    target.close()
    assert size_at_once(tmp_path / "a.jxl") == shape


@pytest.mark.usefixtures("tight")
@pytest.mark.parametrize("name", TEXTS)
def test_packed_texts_of_a_png_are_bounded(name, tmp_path):
    path = png(tmp_path / "a.png", (name, TEXTS[name]))
    for read in (settings_in, read_picture, read_depth, TiffStack()):
        refused(read, path, match=r"a\.png, its text '.*': 0\.01 MiB, over the limit of")


@pytest.mark.usefixtures("tight")
def test_packed_texts_of_a_png_are_counted_together(tmp_path):
    each = (b"zTXt", b"a\0\0" + zlib.compress(b"a" * 2000))
    assert read_picture(png(tmp_path / "a.png", each, each)).data.shape == (1, 1, 3)
    refused(read_picture, png(tmp_path / "b.png", *[each] * 6), match="over the limit of")


def shaded(path, side=300, **told):
    import OpenImageIO

    form = "float" if path.suffix in (".exr", ".hdr") else "uint8"
    spec = OpenImageIO.ImageSpec(side, side, 3, form)
    for name, value in told.items():
        spec.attribute(name, value)
    target = OpenImageIO.ImageOutput.create(str(path))
    assert target.open(str(path), spec)
    assert target.write_image(np.zeros((side, side, 3), np.float32))
    assert target.close()
    return path


PICTURES = ["png", "jpg", "webp", "gif", "hdr", "jxl", "jp2"]
PACKED = [
    ("tga", "rle"),
    *((one, "") for one in PICTURES),
    *(("tif", one) for one in ("zip", "lzw", "packbits")),
]
PACKED += [("exr", one) for one in ("rle", "zips", "zip", "piz", "pxr24", "dwaa")]


@pytest.mark.some(1)
@pytest.mark.parametrize(("suffix", "packing"), PACKED)
def test_pictures_that_become_far_too_much_are_refused(suffix, packing, tmp_path, monkeypatch):
    told = {"compression": packing} if packing else {}
    path = shaded(tmp_path / f"a.{suffix}", 64 if suffix in ("jxl", "jp2") else 300, **told)
    monkeypatch.setenv("RESAMPLE_LIMIT", "unpacked=1KB,ratio=2")
    for read in (read_picture, read_image):
        refused(read, path, match=r"a\.\w+: .* that unpack to")


@pytest.mark.parametrize("suffix", ["apng", "webp", "gif"])
def test_animations_that_become_far_too_much_are_refused(suffix, tmp_path, monkeypatch):
    from PIL import Image

    frames, path = [Image.new("RGB", (64, 64), (n, n, n)) for n in (0, 200)], tmp_path / "a"
    form = {"apng": "PNG"}.get(suffix, suffix.upper())
    path = path.with_suffix(f".{suffix}")
    frames[0].save(path, form, save_all=True, append_images=frames[1:])
    monkeypatch.setenv("RESAMPLE_LIMIT", "unpacked=1KB,ratio=2")
    refused(frames_of, path, match="that unpack to")


def test_films_that_become_far_too_much_are_refused(tmp_path, monkeypatch):
    pytest.importorskip("av", reason="the extra film is not installed")
    shade = np.zeros((64, 64, 3), np.uint8)
    with new_film(tmp_path / "a.mp4") as film:
        stream = new_stream(film, 5.0, (64, 64))
        film.mux(stream.encode(film_picture(shade, stream)))
        film.mux(stream.encode(None))
    monkeypatch.setenv("RESAMPLE_LIMIT", "unpacked=1KB,ratio=2")
    refused(frames_of, tmp_path / "a.mp4", match="that unpack to")


def test_deep_pictures_are_refused(tmp_path):
    rgba = np.ones((3, 4, 4), np.float32)
    write_deep(tmp_path / "a.exr", [DepthSlab(1.0, 2.0, rgba)])
    assert len(read_deep(tmp_path / "a.exr")) == 3
    for read in (read_picture, read_depth):
        name = "a.exr" if read is read_picture else "a.exr:Z"
        refused(read, tmp_path / name, match=r"a\.exr is a deep picture")


# Clouds


@pytest.mark.usefixtures("tight")
def test_packed_clouds_that_become_far_too_much_are_refused(tmp_path):
    head = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nPOINTS 100000\nDATA binary_compressed\n"
    content = head.encode() + struct.pack("<2I", 100, 1_200_000) + bytes(100)
    (tmp_path / "a.pcd").write_bytes(content)
    refused(read_cloud, tmp_path / "a.pcd", match="that unpack to")


def test_clouds_of_lasers_that_become_far_too_much_are_refused(tmp_path, monkeypatch):
    laspy = pytest.importorskip("laspy", reason="the extra las is not installed")
    scan = laspy.create(point_format=0)
    scan.x = scan.y = scan.z = np.zeros(2000)
    scan.write(str(tmp_path / "a.laz"))
    monkeypatch.setenv("RESAMPLE_LIMIT", "unpacked=1KB,ratio=2")
    refused(read_cloud, tmp_path / "a.laz", match="that unpack to")


# Meshes


def glb(path, parts, picture):
    """Triangles that share one material and its texture."""
    places = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes()
    corners = np.array([0, 1, 2, 0], "<u2").tobytes()
    content = places + places[:24] + corners + picture + bytes(-len(picture) % 4)
    ends = [0, 36, 60, 68, 68 + len(picture)]
    views = [
        {"buffer": 0, "byteOffset": first, "byteLength": last - first}
        for first, last in pairwise(ends)
    ]
    types = ((5126, "VEC3"), (5126, "VEC2"), (5123, "SCALAR"))
    accessors = [
        {"bufferView": n, "componentType": kind, "count": 3, "type": form}
        for n, (kind, form) in enumerate(types)
    ]
    accessors[0] |= {"min": [0, 0, 0], "max": [1, 1, 0]}
    one = {"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}
    told = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": list(range(parts))}],
        "nodes": [{"mesh": n} for n in range(parts)],
        "meshes": [{"primitives": [one]}] * parts,
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(content)}],
        "images": [{"bufferView": 3, "mimeType": "image/png"}],
        "textures": [{"source": 0}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
    }
    text = json.dumps(told).encode()
    text += b" " * (-len(text) % 4)
    head = b"glTF" + struct.pack("<4I", 2, 28 + len(text) + len(content), len(text), 0x4E4F534A)
    path.write_bytes(head + text + struct.pack("<2I", len(content), 0x004E4942) + content)
    return path


def picture(side):
    from PIL import Image

    file = io.BytesIO()
    Image.new("RGB", (side, side), (200, 100, 50)).save(file, "png")
    return file.getvalue()


def test_parts_of_a_mesh_share_one_texture(tmp_path):
    mesh = load_mesh(glb(tmp_path / "a.glb", 5, picture(8)))
    assert len(mesh.textures) == 1
    assert mesh.texture.tolist() == [0] * 5


@pytest.mark.usefixtures("tight")
@pytest.mark.parametrize("suffix", ["gltf", "glb"])
def test_numbers_that_no_file_holds_are_counted(suffix, tmp_path):
    accessor = {"componentType": 5126, "count": 1_000_000, "type": "VEC3"}
    told = {"asset": {"version": "2.0"}, "nodes": [{"mesh": 0}], "accessors": [accessor]}
    told["meshes"] = [{"primitives": [{"attributes": {"POSITION": 0}}]}]
    text = json.dumps(told).encode()
    head = struct.pack("<4s4I", b"glTF", 2, 20 + len(text), len(text), 0x4E4F534A)
    path = tmp_path / f"a.{suffix}"
    path.write_bytes(head + text if suffix == "glb" else text)
    for read in (load_mesh, *([read_mesh] if suffix == "glb" else [])):
        given = path if read is load_mesh else f"{path}"
        refused(read, given, match=r"that unpack to 11\.44 MiB or more")


@pytest.mark.sweep
def test_a_mesh_that_very_many_nodes_show_is_counted_for_each(tmp_path, monkeypatch):
    monkeypatch.setenv("RESAMPLE_LIMIT", "unpacked=1KB,ratio=2")
    path = glb(tmp_path / "a.glb", 1, picture(8))
    content = path.read_bytes()
    told = json.loads(content[20 : 20 + struct.unpack_from("<I", content, 12)[0]])
    told["nodes"] = [{"mesh": 0}] * 5000
    (tmp_path / "a.gltf").write_text(json.dumps(told))
    refused(check_mesh, tmp_path / "a.gltf", match=r"that unpack to 0\.31 MiB or more")


@pytest.mark.usefixtures("tight")
def test_a_texture_that_becomes_far_too_much_is_refused(tmp_path):
    refused(load_mesh, glb(tmp_path / "a.glb", 1, picture(200)), match="its textures: .* unpack to")
    (tmp_path / "a.png").write_bytes(picture(200))
    (tmp_path / "a.mtl").write_text("newmtl a\nmap_Kd a.png\n")
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
    (tmp_path / "a.obj").write_text(f"mtllib a.mtl\n{corners}usemtl a\nf 1/1 2/2 3/3\n")
    refused(load_mesh, tmp_path / "a.obj", match="its textures: .* unpack to")
