"""Small valid files of every kind, made here, and what reads each of them."""

import gzip
import io
import json
import struct
import tempfile
import zlib
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tests import snapshots
from tests import splats as splat_files
from tests.fuzz.grids import grids
from tests.fuzz.scans import scans
from tests.fuzz.stores import SETTINGS, kernel, ome_zarr, png_with, zipped
from tests.laser import CENTER, copc_of, las_of

RNG = np.random.default_rng(21)
VALUES = (RNG.random((6, 7, 8)) * 255).astype(np.uint8)
CLOUD = RNG.random((20, 3)).astype(np.float32)


class Case(NamedTuple):
    """A file and those beside it, of which any may be changed."""

    reader: str  # one of READERS
    files: Mapping[str, bytes]  # the first is read


def _npy(values: Any) -> bytes:
    file = io.BytesIO()
    np.save(file, values)
    return file.getvalue()


def _npz(**arrays: Any) -> bytes:
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()


def _made(name: str, write: Callable[[Path], object]) -> bytes:
    """Bytes of a file that a function writes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, name)
        write(path)
        return path.read_bytes()


def _picture(name: str, shape: tuple[int, int, int], kind: str = "uint8") -> bytes:
    import OpenImageIO

    def write(path: Path) -> None:
        spec = OpenImageIO.ImageSpec(shape[1], shape[0], shape[2], kind)
        target = OpenImageIO.ImageOutput.create(str(path))
        target.open(str(path), spec)
        target.write_image(RNG.random(shape).astype(np.float32))
        target.close()

    return _made(name, write)


OME = (
    '<OME><Image><Pixels DimensionOrder="XYZCT" SizeZ="6" SizeC="1" SizeT="1" PhysicalSizeX="0.5" '
    'PhysicalSizeY="500" PhysicalSizeYUnit="nm"><Channel Color="-1"/><TiffData IFD="1" FirstZ="0"/>'
    '<TiffData IFD="0" FirstZ="1"/></Pixels></Image></OME>'
)


def _animated(name: str) -> bytes:
    from PIL import Image

    frames = [Image.fromarray(VALUES[n]) for n in range(3)]
    choices: dict[str, Any] = {"save_all": True, "append_images": frames[1:], "duration": 40}
    return _made(name, lambda path: frames[0].save(path, **choices))


def _pages(description: str = "") -> bytes:
    from PIL import Image

    frames = [Image.fromarray(part) for part in VALUES]
    told: dict[str, Any] = {"tiffinfo": {270: description, 282: 2.0, 283: 4.0}}
    choices: dict[str, Any] = {"save_all": True, "append_images": frames[1:], **told}
    return _made("a.tif", lambda path: frames[0].save(path, **choices))


def _itk(name: str) -> bytes:
    import SimpleITK

    image = SimpleITK.GetImageFromArray(VALUES)
    return _made(name, lambda path: SimpleITK.WriteImage(image, str(path)))


def _vti(kind: str, *, of_cells: bool = False) -> bytes:
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkImageData
    from vtkmodules.vtkIOXML import vtkXMLImageDataWriter

    image = vtkImageData()
    image.SetDimensions(np.add((8, 7, 6), of_cells).tolist())
    values = numpy_to_vtk(VALUES.ravel())
    values.SetName("density")
    (image.GetCellData() if of_cells else image.GetPointData()).SetScalars(values)
    writer = vtkXMLImageDataWriter()
    writer.SetInputData(image)
    getattr(writer, f"SetDataModeTo{kind}")()

    def write(path: Path) -> None:
        writer.SetFileName(str(path))
        writer.Write()

    return _made("a.vti", write)


def _zarr() -> bytes:
    import zarr

    def write(path: Path) -> None:
        with zarr.storage.ZipStore(path, mode="w") as store:
            zarr.create_array(store, data=VALUES, chunks=(3, 4, 4))

    return _made("a.zarr.zip", write)


def _film(name: str, codec: str) -> bytes:
    import av

    def write(path: Path) -> None:
        with av.open(str(path), "w") as film:
            stream = film.add_stream(codec, rate=10)
            stream.width, stream.height, stream.pix_fmt = 32, 24, "yuv420p"
            for n in range(3):
                levels = RNG.integers(0, 255, (24, 32, 3), np.uint8) // (n + 1)
                frame = av.VideoFrame.from_ndarray(levels, format="rgb24")
                film.mux(stream.encode(frame.reformat(format="yuv420p")))
            film.mux(stream.encode(None))

    return _made(name, write)


def films() -> list[Case]:
    """Films; none where PyAV is not installed."""
    try:
        import av  # noqa: F401
    except ImportError:
        return []
    codecs = {"mp4": "libx264", "webm": "libvpx-vp9", "avi": "mpeg4", "mkv": "ffv1"}
    codecs |= {"mpg": "mpeg2video", "mov": "libx264"}
    return [Case("film", {f"a.{end}": _film(f"a.{end}", name)}) for end, name in codecs.items()]


def _slice(z: int, *, frames: int = 1, packed: bool = False) -> bytes:
    """DICOM file of one slice, or of several frames."""
    import pydicom
    from pydicom import uid

    told = pydicom.Dataset()
    told.file_meta = pydicom.dataset.FileMetaDataset()
    told.file_meta.TransferSyntaxUID = uid.ExplicitVRLittleEndian
    told.SOPClassUID, told.SOPInstanceUID = uid.CTImageStorage, f"1.2.8.{z + 1}"
    told.file_meta.MediaStorageSOPClassUID = told.SOPClassUID
    told.file_meta.MediaStorageSOPInstanceUID = told.SOPInstanceUID
    told.Modality, told.SeriesInstanceUID, told.InstanceNumber = "CT", "1.2.3", z + 1
    told.ImagePositionPatient, told.PixelSpacing = [0, 0, 2.5 * z], [1, 1]
    told.ImageOrientationPatient, told.SliceThickness = [1, 0, 0, 0, 1, 0], 2.5
    told.RescaleSlope, told.RescaleIntercept = 1, -1024
    told.Rows, told.Columns, told.SamplesPerPixel = 7, 8, 1
    told.BitsAllocated, told.BitsStored, told.HighBit, told.PixelRepresentation = 16, 12, 11, 0
    told.PhotometricInterpretation = "MONOCHROME2"
    if frames > 1:
        told.NumberOfFrames = frames
    told.PixelData = (VALUES[z : z + frames].astype(np.uint16) * 9).tobytes()
    if packed:
        told.compress(uid.RLELossless)
    return _made("a.dcm", lambda path: told.save_as(path, enforce_file_format=True))


def dicoms() -> list[Case]:
    """Slices in a folder, and files of several frames."""
    slices = {f"{'bca'[z]}.dcm": _slice(z) for z in range(3)}
    return [
        Case("series", slices),
        Case("series", {name: _slice(n, packed=True) for n, name in enumerate(slices)}),
        Case("volume", {"a.dcm": _slice(0, frames=3)}),
    ]


def volumes() -> list[Case]:
    """Volumes of every reader."""
    data = VALUES.tobytes()
    nrrd = (
        b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 8 7 6\nencoding: %s\nspacings: 1 1 1.5\n"
        b"data file: %s\n"
    )
    mhd = (
        b"ObjectType = Image\nNDims = 3\nDimSize = 8 7 6\nElementType = MET_UCHAR\n"
        b"ElementSpacing = 1 1 2\nOffset = 0 0 0\n%sElementDataFile = a.raw\n"
    )
    names = ("a.nrrd", "a.mha", "a.nii", "a.nii.gz")
    made = [Case("volume", {name: _itk(name)}) for name in names]
    return [
        *made,
        Case("volume", {"a.nhdr": nrrd % (b"raw", b"a.raw"), "a.raw": data}),
        Case("volume", {"a.nhdr": nrrd % (b"gzip", b"a.raw"), "a.raw": gzip.compress(data)}),
        Case("volume", {"a.nhdr": nrrd % (b"raw", b"LIST 3\na.raw"), "a.raw": data}),
        Case("volume", {"a.mhd": mhd % b"", "a.raw": data}),
        Case("volume", {"a.mhd": mhd % b"CompressedData = True\n", "a.raw": zlib.compress(data)}),
        Case("volume", {"a_8x7x6_uint8.raw": data}),
        Case("volume", {"a_8x7x6_uint8.raw.gz": gzip.compress(data)}),
        Case("volume", {"a.npy": _npy(VALUES)}),
        Case(
            "volume",
            {"a.npz": _npz(x=np.arange(8), y=np.arange(7), z=[0, 1, 2, 3, 4, 6], v=VALUES)},
        ),
        Case("volume", {"a.tif": _pages()}),
        Case("volume", {"a.tif": _pages(OME)}),
        Case(
            "volume",
            {"a.tif": _pages("ImageJ=1.53t\nslices=6\nunit=um\nspacing=2.5\nc0=1\nc1=2\n")},
        ),
        Case("volume", {"a.vti": _vti("Ascii")}),
        Case("volume", {"a.vti": _vti("Appended")}),
        Case("volume", {"a.zarr.zip": _zarr()}),
    ]


def fields() -> list[Case]:
    """Maps of microscopy, cubes of chemistry, legacy files and cells of VTK."""
    head = bytearray(1024)
    struct.pack_into(
        "<4i3i3i3f3f3i", head, 0, 8, 7, 6, 6, 0, 0, 0, 8, 7, 6, 8, 7, 9, *[90] * 3, 3, 2, 1
    )
    struct.pack_into("<ii", head, 88, 1, 80)
    head[208:214] = b"MAP DD"
    mrc = bytes(head) + bytes(80) + VALUES.astype("<u2").tobytes()
    stack = bytearray(mrc)
    struct.pack_into("<i", stack, 36, 3)
    struct.pack_into("<3i3f", stack, 64, 1, 2, 3, 0, 0, 0)
    struct.pack_into("<i", stack, 88, 401)
    axes = "8 0.5 0 0\n7 0 0.5 0\n6 0 0.1 0.5\n"
    words = " ".join(f"{value:.5E}" for value in VALUES.ravel().tolist())
    cube = f"a\nb\n1 0 0 0\n{axes}1 1.0 0 0 0\n{words}\n".encode()
    orbitals = f"a\nb\n-1 0 0 0\n{axes}1 1.0 0 0 0\n2 5\n6\n{words} {words}\n".encode()
    vtk = "# vtk DataFile Version 3.0\na\n{}\nDATASET {}\nDIMENSIONS {}\n"
    points = vtk.format("BINARY", "STRUCTURED_POINTS", "8 7 6") + "SPACING 1 1 2\nORIGIN 0 0 0\n"
    points += "POINT_DATA 336\nFIELD a 1\nheat 2 336 unsigned_char\n"
    table = b"\nSCALARS v unsigned_char 1\nLOOKUP_TABLE default\n"
    binary = points.encode() + 2 * VALUES.tobytes() + table + VALUES.tobytes() + b"\n"
    cells = vtk.format("ASCII", "RECTILINEAR_GRID", "9 8 7")
    for axis, count in zip("XYZ", (9, 8, 7), strict=True):
        cells += f"{axis}_COORDINATES {count} float\n" + " ".join(map(str, range(count))) + "\n"
    listed = " ".join(map(str, VALUES.ravel()))
    cells += (
        f"METADATA\nINFORMATION 0\n\nCELL_DATA 336\nSCALARS v int\nLOOKUP_TABLE default\n{listed}\n"
    )
    return [
        Case("volume", {"a.mrc": mrc}),
        Case("volume", {"a.mrcs": bytes(stack)}),
        Case("volume", {"a.map.gz": gzip.compress(mrc)}),
        Case("volume", {"a.cube": cube}),
        Case("volume", {"a.cub": orbitals}),
        Case("volume", {"a.vtk": binary}),
        Case("volume", {"a.vtk": cells.encode()}),
        Case("volume", {"a.vti": _vti("Binary", of_cells=True)}),
    ]


def science() -> list[Case]:
    """Cubes of astronomy, climate, microscopy and brains, of the libraries that are installed."""
    files: dict[str, Callable[[Path], object]] = {}
    if find_spec("astropy") is not None:
        from astropy.io import fits

        files["a.fits"] = lambda path: fits.PrimaryHDU(VALUES).writeto(path)
        files["b.fits"] = lambda path: fits.HDUList(
            [fits.PrimaryHDU(), fits.CompImageHDU(VALUES.astype(np.int16))]
        ).writeto(path)
    if find_spec("h5py") is not None:
        import h5py

        def held(path: Path) -> None:
            with h5py.File(path, "w") as file:
                file.create_dataset("data", data=VALUES, compression="gzip")
                file["data"].attrs["element_size_um"] = [2.0, 0.5, 0.25]

        files["a.h5"] = held
    if find_spec("nibabel") is not None:
        import nibabel

        for name in ("a.mgz", "a.mgh"):
            files[name] = lambda path: nibabel.MGHImage(VALUES, np.eye(4)).to_filename(path)
        files["a.hdr"] = lambda path: nibabel.Spm2AnalyzeImage(VALUES, np.eye(4)).to_filename(path)

    def climate(path: Path) -> None:
        from scipy.io import netcdf_file

        with netcdf_file(path, "w") as file:
            for name, count in zip("zyx", VALUES.shape, strict=True):
                file.createDimension(name, count)
                file.createVariable(name, "f4", (name,))[:] = np.arange(count)
            file.createVariable("t", "i2", ("z", "y", "x"))[:] = VALUES

    files["a.nc"] = climate
    made = []
    for name, write in files.items():
        with tempfile.TemporaryDirectory() as folder:
            write(Path(folder, name))
            parts = {path.name: path.read_bytes() for path in sorted(Path(folder).iterdir())}
        made.append(Case("volume", {name: parts.pop(name), **parts}))
    return [*made, Case("volume", {"a.npz": _npz(volume=VALUES)})]


def stores() -> list[Case]:
    """Volumes in folders and archives of chunks, of both versions; settings in pictures; kernels.

    They come last, so that seeds of the others stand for what they did.
    """
    trees = [ome_zarr(version, VALUES) for version in (2, 3)]
    return [
        *(Case("store", tree) for tree in trees),
        *(Case("volume", {"a.ome.zarr.zip": zipped(tree)}) for tree in trees),
        Case("settings", {"a.png": png_with(SETTINGS)}),
        Case("kernel", {"a.kernel": kernel()}),
        *avifs(),
        *fields(),
        *(Case("volume", files) for files in grids()),
        *gaussians(),
        *(Case("cloud", files) for files in scans()),
        *(Case("particles", files) for files in particles()),
        *science(),
    ]


def particles() -> list[Mapping[str, bytes]]:
    """Snapshots of every kind, where h5py is installed; columns with masses."""
    columns = b"x,y,z,mass,h\n" + b"0,1,2,3,0.5\n" * 9
    if find_spec("h5py") is None:
        return [{"a.csv": columns}]
    writers = (snapshots.swift, snapshots.gadget, snapshots.arepo, snapshots.phantom)
    with tempfile.TemporaryDirectory() as folder:
        files = [write(Path(folder, f"{n}.h5")).read_bytes() for n, write in enumerate(writers)]
    return [{"a.csv": columns}, *({"a.h5": content} for content in files)]


def gaussians() -> list[Case]:
    """3D Gaussians in every format."""
    some = splat_files.scene(count=12, width=8)
    folders = [splat_files.sog_of(some, version) for version in (1, 2)]
    files = {
        "a.ply": splat_files.trained_of(some),
        "ascii.ply": splat_files.trained_of(splat_files.scene(count=5, width=0), "ascii"),
        "packed.ply": splat_files.compressed_of(some),
        "a.splat": splat_files.splat_of(some),
        **{f"{n}.ksplat": splat_files.ksplat_of(some, n) for n in (0, 1, 2)},
        "raw.spz": splat_files.spz_of(some, 2, packed=False),
        **{f"{version}.spz": splat_files.spz_of(some, version) for version in (1, 2, 3, 4)},
        "a.sog": splat_files.zipped(folders[1]),
    }
    return [
        *(Case("gaussians", {name: content}) for name, content in files.items()),
        *(Case("gaussians", folder) for folder in folders),
    ]


def avifs() -> list[Case]:
    """AVIF, where Pillow reads and writes it."""
    from PIL import Image, features

    if "avif" not in features.get_supported():
        return []
    image = Image.fromarray(VALUES[0])
    return [Case("picture", {"a.avif": _made("a.avif", image.save)})]


def pictures() -> list[Case]:
    """Pictures and depth images."""
    names = ("png", "jpg", "tif", "exr", "bmp", "tga", "pnm", "hdr")
    made = [Case("picture", {f"a.{end}": _picture(f"a.{end}", (9, 11, 3))}) for end in names]
    deep = np.linspace(1, 4, 63, dtype=np.float32).reshape(7, 9)
    colmap = b"9&7&1&" + deep.tobytes()
    return [
        *made,
        Case("picture", {"a.png": _picture("a.png", (9, 11, 4), "uint16")}),
        *(Case("film", {f"a.{end}": _animated(f"a.{end}")}) for end in ("gif", "png", "webp")),
        Case("depth", {"a.png": _picture("a.png", (9, 11, 1), "uint16")}),
        Case("depth", {"a.exr": _picture("a.exr", (9, 11, 1), "float")}),
        Case("depth", {"a.pfm": b"Pf\n9 7\n-1.0\n" + deep.tobytes()}),
        Case("depth", {"a.bin": colmap}),
        Case("depth", {"a.npy": _npy(deep)}),
        Case("depth", {"a.npz": _npz(depth=deep)}),
        Case("map", {"a.npy": _npy(np.zeros((5, 6, 2)))}),
        Case("map", {"a.npz": _npz(x=np.zeros((5, 6)), y=np.zeros((5, 6)))}),
        Case("map", {"a.flo": struct.pack("<f2i", 202021.25, 3, 2) + bytes(48)}),
        Case("matrix", {"a.txt": b"1 0 3\n0 1 2 # moved\n0 0 1\n"}),
    ]


def _ply(kind: str) -> bytes:
    head = (
        f"ply\nformat {kind} 1.0\nelement vertex 20\nproperty float x\nproperty float y\n"
        "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
        "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
    )
    if kind == "ascii":
        lines = [f"{x} {y} {z} 9 99 200\n" for x, y, z in CLOUD.tolist()]
        return (head + "".join(lines) + "3 0 1 2\n3 2 3 4\n").encode()
    points = b"".join(struct.pack("<3f3B", *point, 9, 99, 200) for point in CLOUD.tolist())
    return head.encode() + points + struct.pack("<B3iB3i", 3, 0, 1, 2, 3, 2, 3, 4)


def _pcd(kind: str) -> bytes:
    head = (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 20\n"
        f"HEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 20\nDATA {kind}\n"
    ).encode()
    if kind == "binary":
        return head + CLOUD.tobytes()
    if kind == "binary_compressed":
        data = np.ascontiguousarray(CLOUD.T).tobytes()
        packed = b"".join(
            bytes([len(part) - 1]) + part for part in (data[n : n + 32] for n in range(0, 240, 32))
        )
        return head + struct.pack("<II", len(packed), 240) + packed
    return head + "".join(f"{x} {y} {z}\n" for x, y, z in CLOUD.tolist()).encode()


def lasers() -> list[Case]:
    """Clouds of laser scanners; none where the extra is not installed."""
    if find_spec("laspy") is None or find_spec("lazrs") is None:
        return []
    x, y, z = (CENTER + CLOUD * 9).T
    columns = {"x": x, "y": y, "z": z, "intensity": np.arange(20)}
    bright = columns | dict.fromkeys(("red", "green", "blue"), np.full(20, 40_000))
    copc = copc_of([bright, bright], pages=2)
    return [
        Case("cloud", {"a.las": las_of(bright)}),
        Case("cloud", {"a.las": las_of(columns, point_format=6, version="1.4")}),
        Case("cloud", {"a.laz": las_of(columns, point_format=1, packed=True)}),
        Case("cloud", {"a.copc.laz": copc}),
        Case("coarse-cloud", {"a.copc.laz": copc}),
    ]


OBJ = (
    b"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0.5\nvt 0 0\nvt 1 0\nvt 0 1\nvt 1 1\n"
    b"usemtl a\nf 1/1 2/2 3/3\nf 2/2 4/4 3/3\n"
)
MTL = b"newmtl a\nKd 0.5 0.5 0.5\nmap_Kd a.png\n"


def gltf() -> tuple[dict[str, Any], bytes]:
    """JSON and buffer of a triangle with a texture."""
    corner = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    uv = np.array([[0, 0], [1, 0], [0, 1]], np.float32)
    data = corner.tobytes() + uv.tobytes() + np.arange(3, dtype=np.uint32).tobytes()
    views = [(0, 36), (36, 24), (60, 12)]
    kinds = [(5126, 3, "VEC3"), (5126, 3, "VEC2"), (5125, 3, "SCALAR")]
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [
            {
                "primitives": [
                    {"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}
                ]
            }
        ],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0, "sampler": 0}],
        "samplers": [{"wrapS": 10497}],
        "images": [{"uri": "a.png"}],
        "buffers": [{"byteLength": len(data), "uri": "a.buf"}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": start, "byteLength": size} for start, size in views
        ],
        "accessors": [
            {"bufferView": n, "componentType": kind, "count": count, "type": name}
            for n, (kind, count, name) in enumerate(kinds)
        ],
    }, data


def meshes() -> list[Case]:
    """Clouds and meshes."""
    tree, data = gltf()
    png = _picture("a.png", (4, 4, 3))
    bare = {
        key: part for key, part in tree.items() if key not in ("images", "textures", "samplers")
    }
    bare |= {"materials": [{"pbrMetallicRoughness": {}}], "buffers": [{"byteLength": len(data)}]}
    text = json.dumps(bare).encode()
    text += b" " * (-len(text) % 4)
    glb = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(data))
    glb += struct.pack("<I4s", len(text), b"JSON") + text
    glb += struct.pack("<I4s", len(data), b"BIN\0") + data
    triangle = struct.pack("<12fH", 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0)
    stl = bytes(80) + struct.pack("<I", 2) + triangle * 2
    table = "".join(f"{x},{y},{z},0.5\n" for x, y, z in CLOUD.tolist()).encode()
    plys = {kind: _ply(kind) for kind in ("ascii", "binary_little_endian")}
    cases = [Case("cloud", {"a.ply": content}) for content in plys.values()]
    cases += [Case("mesh", {"a.ply": content}) for content in plys.values()]
    for kind in ("ascii", "binary", "binary_compressed"):
        cases.append(Case("cloud", {"a.pcd": _pcd(kind)}))
    return [
        *cases,
        *lasers(),
        Case("cloud", {"a.csv": b"x,y,z,w\n" + table}),
        Case("cloud", {"a.npz": _npz(position=CLOUD, color=CLOUD)}),
        Case("mesh", {"a.obj": OBJ, "a.mtl": MTL, "a.png": png}),
        Case("mesh", {"a.gltf": json.dumps(tree).encode(), "a.buf": data, "a.png": png}),
        Case("mesh", {"a.glb": glb}),
        Case("scene-mesh", {"a.stl": stl}),
        Case("scene-mesh", {"a.obj": OBJ, "a.mtl": MTL, "a.png": png}),
    ]


def _texts(reader: str, **files: str) -> list[Case]:
    return [Case(reader, {name.replace("_", "."): text.encode()}) for name, text in files.items()]


XML = (
    '<?xml version="1.0"?><opencv_storage><camera_matrix type_id="opencv-matrix"><rows>3</rows>'
    "<cols>3</cols><dt>d</dt><data>500. 0. 320. 0. 500. 240. 0. 0. 1.</data></camera_matrix>"
    "<dist><rows>1</rows><cols>4</cols><data>0.1 0. 0. 0.</data></dist></opencv_storage>"
)


def cameras() -> list[Case]:
    """Cameras, poses and lenses."""
    identity = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 2.5], [0, 0, 0, 1]]
    nerf = {
        "w": 640,
        "h": 480,
        "camera_angle_x": 0.7,
        "frames": [{"file_path": "a", "transform_matrix": identity}],
    }
    open3d = {
        "parameters": [
            {
                "extrinsic": np.eye(4).ravel().tolist(),
                "intrinsic": {
                    "width": 640,
                    "height": 480,
                    "intrinsic_matrix": [500.0, 0, 0, 0, 500, 0, 320, 240, 1],
                },
            }
        ]
    }
    lens = {
        "camera_matrix": [[500.0, 0, 320], [0, 500, 240], [0, 0, 1]],
        "distortion_coefficients": [0.1, -0.05, 0, 0],
        "image_height": 480,
        "image_width": 640,
    }
    yaml = (
        "%YAML:1.0\n---\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
        "   data: [ 500., 0., 320., 0., 500., 240., 0., 0., 1. ]\n"
        "distortion_coefficients: !!opencv-matrix\n   rows: 1\n   cols: 4\n   dt: d\n"
        "   data: [ 0.1, 0., 0., 0. ]\n"
    )
    ros = (
        "image_width: 640\nimage_height: 480\ndistortion_model: plumb_bob\ncamera_matrix:\n"
        "  rows: 3\n  cols: 3\n  data: [500.0, 0, 320, 0, 500, 240, 0, 0, 1]\n"
        "distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [0.1, 0, 0, 0, 0]\n"
    )
    colmap = struct.pack("<Q", 1) + struct.pack("<I7dI", 1, 1, 0, 0, 0, 0, 0, 2, 1)
    colmap += b"a.png\0" + struct.pack("<Q", 0)
    camera = struct.pack("<QIiQQ3d", 1, 1, 0, 640, 480, 500.0, 320, 240)
    texts = "# id qw qx qy qz tx ty tz camera name\n1 1 0 0 0 0 0 2 1 a.png\n\n"
    intrinsics = "1 SIMPLE_RADIAL 640 480 500 320 240 0.1\n"
    return [
        Case("poses", {"a.npy": _npy(np.array([identity, identity], np.float64))}),
        Case("poses", {"images.bin": colmap, "cameras.bin": camera}),
        Case("poses", {"images.txt": texts.encode(), "cameras.txt": intrinsics.encode()}),
        *_texts(
            "poses",
            tum_txt="0.1 0 0 1 0 0 0 1\n0.2 0 0 2 0 0.1 0 1\n",
            icl_txt="0 0 1 0 0 0 1\n0 0 2 0 0.1 0 1\n",
            matrix_txt="1 0 0 0\n0 1 0 0\n0 0 1 2\n",
            a_log="0 0 0\n1 0 0 0\n0 1 0 0\n0 0 1 2\n0 0 0 1\n",
            nerf_json=json.dumps(nerf),
            open3d_json=json.dumps(open3d),
        ),
        *_texts("viewpoint", a_toml='azimuth = 30\nelevation = 10\nzoom = 1.5\nup = "z"\n'),
        *_texts(
            "viewpoint",
            b_toml="eye = [1, 2, 3]\ntarget = [0, 0, 0]\nfov = 30\nwidth = 64\nheight = 48\n",
        ),
        *_texts("lens", a_json=json.dumps(lens), a_yml=yaml, b_yaml=ros),
        *_texts(
            "lens",
            a_toml="camera_matrix = [[5e2, 0, 9], [0, 5e2, 9], [0, 0, 1]]\ndist = [0.1, 0, 0, 0]\n",
        ),
        *_texts("lens", a_xml=XML),
    ]


def choices() -> list[Case]:
    """Transfer functions, keyframes, settings."""
    points = {"points": [{"value": n * 50, "color": "#ff8800", "opacity": 0.5} for n in (0, 1, 2)]}
    region = {
        "regions": [
            {"value": [10, 99.5], "color": [1, 0, 0], "opacity": 0.5, "gradient": [0, 9]},
            {"value": [99, None], "color": "red", "opacity": 0.2, "softness": [1, 1]},
        ]
    }
    toml = (
        'points = [\n  { value = 1, color = "red", opacity = 0.1 },\n'
        "  { value = 9.5, color = [0, 1, 0.5], opacity = 1 },\n]\n"
    )
    keyframes = (
        "[[camera]]\ntime = 0\nazimuth = 30\n\n[[camera]]\ntime = 4.5\nazimuth = 120\nzoom = 3\n"
    )
    return [
        *_texts("transfer", a_json=json.dumps(points), b_json=json.dumps(region), a_toml=toml),
        *_texts("keyframes", a_toml=keyframes),
        *_texts("settings", a_toml=SETTINGS),
    ]


def corpus() -> list[Case]:
    """All of them."""
    every = [*volumes(), *dicoms(), *pictures(), *films(), *meshes(), *cameras(), *choices()]
    return [*every, *stores()]
