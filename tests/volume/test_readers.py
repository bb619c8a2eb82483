import gzip
import os
import shutil
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
import SimpleITK

from resample.memory import physical_memory
from resample_formats.maps import Cube, Mrc
from resample_volume.data import values as volume_values
from resample_volume.data.recordings import volume_at
from resample_volume.files.dicom import Dicom
from resample_volume.files.metaimage import MetaImage
from resample_volume.files.nifti import Nifti
from resample_volume.files.nrrd import Nrrd
from resample_volume.files.readers import Npy, Raw
from resample_volume.files.source import describe
from resample_volume.files.tiff import TiffStack
from resample_volume.files.vtk import Vti, Vtk

SPACING, ORIGIN = (1.0, 2.0, 3.5), (5.0, 6.0, -7.0)
ROTATED = ((0, -1, 0), (1, 0, 0), (0, 0, 1))
MIRRORED = ((0, -1, 0), (1, 0, 0), (0, 0, -1))
OBLIQUE = ((0.8, -0.6, 0), (0.6, 0.8, 0), (0, 0, 1))
NRRD = """NRRD0004
type: {type}
dimension: {dimension}
{more}sizes: {sizes}
endian: little
encoding: {encoding}
"""
META = """ObjectType = Image
NDims = 3
BinaryData = True
{more}ElementSpacing = {spacing}
TransformMatrix = {matrix}
DimSize = {sizes}
ElementType = MET_USHORT
ElementDataFile = {data}
"""
ITK = {
    "a.nrrd": Nrrd,
    "a.nhdr": Nrrd,
    "a.mha": MetaImage,
    "a.mhd": MetaImage,
    "a.nii": Nifti,
    "a.nii.gz": Nifti,
}


@pytest.fixture
def values(rng) -> np.ndarray:
    return rng.integers(0, 60000, (10, 11, 12)).astype(np.uint16)


@pytest.fixture(autouse=True)
def nothing_is_printed(capfd):
    """C++ libraries print behind Python's back; no reader lets them."""
    yield
    assert capfd.readouterr() == ("", "")


def image(values: np.ndarray, direction=ROTATED, **more) -> SimpleITK.Image:
    made = SimpleITK.GetImageFromArray(values, **more)
    made.SetSpacing(SPACING)
    made.SetOrigin(ORIGIN)
    made.SetDirection(np.ravel(direction).astype(float).tolist())
    return made


def write(path: Path, values: np.ndarray, direction=ROTATED, **more) -> Path:
    SimpleITK.WriteImage(image(values, direction, **more), str(path), path.suffix == ".gz")
    return path


def put(path: Path, content: bytes | str) -> Path:
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def nrrd(path: Path, *, data="", encoding="raw", sizes="12 11 10", kind="uint16", more="") -> Path:
    head = NRRD.format(
        type=kind, dimension=len(sizes.split()), more=more, sizes=sizes, encoding=encoding
    )
    return put(path, head + (f"data file: {data}\n" if data else ""))


def meta(
    path: Path, *, data="a.raw", sizes="12 11 10", spacing="1 1 1", matrix="", more=""
) -> Path:
    matrix = matrix or "1 0 0 0 1 0 0 0 1"
    return put(path, META.format(data=data, sizes=sizes, spacing=spacing, matrix=matrix, more=more))


def flipped(content: bytes, at: int) -> bytes:
    changed = bytearray(content)
    changed[at] ^= 255
    return bytes(changed)


def refused(reader, path: Path, match: str, error=ValueError) -> None:
    """Whether it is refused in one line that says so."""
    with pytest.raises(error, match=match) as caught:
        reader(path)
    assert "\n" not in str(caught.value)


# What is read


@pytest.mark.parametrize("direction", [np.eye(3), ROTATED, MIRRORED, OBLIQUE])
@pytest.mark.parametrize("name", ITK)
def test_itk_formats_keep_values_and_space(name, direction, values, tmp_path):
    volume = ITK[name]()(write(tmp_path / name, values, direction))
    assert np.array_equal(volume.values, values)
    assert volume.values.dtype == np.uint16
    np.testing.assert_allclose(volume.spacing, SPACING, rtol=1e-6)  # NIfTI stores float32
    np.testing.assert_allclose(volume.origin, ORIGIN, rtol=1e-6)
    np.testing.assert_allclose(volume.direction, direction, atol=1e-6)
    assert volume.name == "a"


@pytest.mark.parametrize("name", ITK)
def test_positions_are_those_of_itk(name, values, tmp_path):
    path = write(tmp_path / name, values, MIRRORED)
    volume = ITK[name]()(path)
    index = np.array([3, 5, 7])
    position = volume.origin + volume.direction @ (volume.spacing * index)
    wanted = SimpleITK.ReadImage(str(path)).TransformIndexToPhysicalPoint(index.tolist())
    np.testing.assert_allclose(position, wanted, rtol=1e-6)


@pytest.mark.parametrize(
    "kind", ["uint8", "int8", "uint16", "int16", "int32", "float32", "float64"]
)
def test_types_are_kept(kind, values, tmp_path):
    volume = Nrrd()(write(tmp_path / "a.nrrd", values.astype(kind)))
    assert volume.values.dtype == kind
    assert np.array_equal(volume.values, values.astype(kind))


def test_a_right_anterior_superior_nrrd_comes_out_as_lps(values, tmp_path):
    more = "space: RAS\nspace directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (1,2,3)\n"
    put(tmp_path / "a.raw", values.tobytes())
    volume = Nrrd()(nrrd(tmp_path / "a.nhdr", data="a.raw", more=more))
    assert volume.origin.tolist() == [-1, -2, 3]
    assert np.diag(volume.direction).tolist() == [-1, -1, 1]


def test_an_unknown_nrrd_spacing_is_1(values, tmp_path):
    put(tmp_path / "a.raw", values.tobytes())
    volume = Nrrd()(nrrd(tmp_path / "a.nhdr", data="a.raw", more="spacings: nan 2 3\n"))
    assert volume.spacing.tolist() == [1, 2, 3]


def test_steps_that_are_no_unit_steps_give_their_length_to_the_spacing(values, tmp_path):
    put(tmp_path / "a.raw", values.tobytes())
    volume = MetaImage()(meta(tmp_path / "a.mhd", spacing="1 2 3", matrix="2 0 0 0 1 0 0 0 1"))
    assert volume.spacing.tolist() == [2, 2, 3]
    assert np.array_equal(volume.direction, np.eye(3))


def test_a_compressed_nifti_is_not_mistaken_for_its_neighbor(values, tmp_path):
    write(tmp_path / "a.nii", np.zeros_like(values))
    path = write(tmp_path / "a.nii.gz", values)
    assert np.array_equal(Nifti()(path).values, values)


def test_nifti_slope_and_intercept_are_applied(values, tmp_path):
    content = bytearray(write(tmp_path / "a.nii", values).read_bytes())
    struct.pack_into("<2f", content, 112, 2.0, 10.0)
    volume = Nifti()(put(tmp_path / "b.nii", bytes(content)))
    assert np.array_equal(volume.values, 2.0 * values + 10)


@pytest.mark.parametrize("order", "<>")
def test_nifti_comes_in_two_byte_orders(order, values, tmp_path):
    content = bytearray(352)
    struct.pack_into(order + "i", content, 0, 348)
    struct.pack_into(order + "8h", content, 40, 3, *values.shape[::-1], 1, 1, 1, 1)
    struct.pack_into(order + "2h", content, 70, 512, 16)  # uint16
    struct.pack_into(order + "8f", content, 76, 1, *SPACING, 0, 0, 0, 0)
    struct.pack_into(order + "f", content, 108, 352)
    content[344:348] = b"n+1\0"
    data = values.astype(order + "u2").tobytes()
    volume = Nifti()(put(tmp_path / "a.nii", bytes(content) + data))
    assert np.array_equal(volume.values, values)
    assert volume.spacing.tolist() == list(SPACING)
    cut = put(tmp_path / "a.nii", bytes(content) + data[:-10])
    refused(Nifti(), cut, "holds 2630 bytes, 2640 are wanted")


def test_vti_keeps_values_and_space(values, tmp_path):
    volume = Vti()(write_vti(tmp_path / "a.vti", values))
    assert np.array_equal(volume.values, values)
    assert volume.spacing.tolist() == list(SPACING)
    assert np.array_equal(volume.direction, MIRRORED)
    # the extent begins at x = 2, which the matrix turns into y
    assert volume.origin.tolist() == [ORIGIN[0], ORIGIN[1] + 2 * SPACING[0], ORIGIN[2]]


def write_vti(path: Path, values: np.ndarray, names=("density",)) -> Path:
    io = pytest.importorskip("vtkmodules.vtkIOXML")
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkImageData

    data = vtkImageData()
    data.SetExtent(2, 13, 0, 10, 0, 9)
    data.SetSpacing(SPACING)
    data.SetOrigin(ORIGIN)
    data.SetDirectionMatrix(np.ravel(MIRRORED).tolist())
    for n, name in enumerate(names):
        array = numpy_to_vtk((values + n).ravel(), deep=1)
        array.SetName(name)
        data.GetPointData().AddArray(array)
    writer = io.vtkXMLImageDataWriter()
    writer.SetInputData(data)
    writer.SetFileName(str(path))
    writer.Write()
    return path


def test_an_array_of_many_is_chosen_by_name(values, tmp_path):
    path = write_vti(tmp_path / "a.vti", values, ("heat", "wind"))
    assert np.array_equal(Vti(array="wind")(path).values, values + 1)
    refused(Vti(), path, "heat, wind")
    refused(Vti(array="rain"), path, "rain given.*heat, wind")


def test_vectors_of_vti_are_channels_or_colors(values, tmp_path):
    io = pytest.importorskip("vtkmodules.vtkIOXML")
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkImageData

    data = vtkImageData()
    data.SetDimensions(12, 11, 10)
    wind = np.stack([values.ravel() + n for n in range(2)], 1).astype(np.float32)
    color = np.stack([values.ravel() % (99 + n) for n in range(3)], 1).astype(np.uint8)
    for name, array in (("wind", wind), ("color", color)):
        made = numpy_to_vtk(array, deep=1)
        made.SetName(name)
        data.GetPointData().AddArray(made)
    writer = io.vtkXMLImageDataWriter()
    writer.SetInputData(data)
    writer.SetFileName(str(tmp_path / "a.vti"))
    writer.Write()
    refused(Vti(), tmp_path / "a.vti", "wind, color")
    refused(Vti(array="wind"), tmp_path / "a.vti", "wind: 2, color: 3.*by channel, 0 to 1")
    held = Vti(array="wind").recorded(tmp_path / "a.vti")
    assert np.array_equal(volume_at(held, None, 1).values.ravel(), wind[:, 1])
    assert np.array_equal(Vti(array="color")(tmp_path / "a.vti").colors.reshape(-1, 3), color)


def test_a_missing_vtk_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "vtkmodules.vtkIOXML", None)
    refused(Vti(), put(tmp_path / "a.vti", ""), r"pip install 'hybrid-resample\[vtk\]'")


@pytest.mark.parametrize("suffix", [".tif", ".png"])
def test_slices_are_sorted_by_their_numbers(suffix, values, tmp_path):
    for z, plane in enumerate(values):
        SimpleITK.WriteImage(
            SimpleITK.GetImageFromArray(plane), str(tmp_path / f"s{z + 1}{suffix}")
        )
    volume = TiffStack(spacing="1x1x2.5")(tmp_path)
    assert np.array_equal(volume.values, values)
    assert volume.spacing.tolist() == [1, 1, 2.5]
    assert volume.name == tmp_path.name


@pytest.mark.parametrize("kind", ["uint8", "uint16", "float32"])
def test_a_tiff_of_many_pages_is_a_volume_with_spacing_1(kind, values, tmp_path):
    volume = TiffStack()(write(tmp_path / "a.tif", values.astype(kind)))
    assert np.array_equal(volume.values, values.astype(kind))
    assert volume.spacing.tolist() == [1, 1, 1]


def write_dicom(folder: Path, values: np.ndarray, *, uid="1.2.3", skip=()) -> Path:
    """Slices whose names are in no order."""
    volume = image(values.astype(np.int16))
    writer = SimpleITK.ImageFileWriter()
    writer.KeepOriginalImageUIDOn()
    axes = np.array(ROTATED)
    for z in range(volume.GetDepth()):
        place = volume.TransformIndexToPhysicalPoint((0, 0, z))
        tags = {
            "0008|0060": "CT",
            "0008|0018": f"{uid}.8.{z + 1}",
            "0020|000d": f"{uid}.9",
            "0020|000e": uid,
            "0020|0013": str(z),
            "0020|0032": "\\".join(map(str, place)),
            "0020|0037": "\\".join(map(str, axes[:, :2].T.ravel())),
        }
        plane = volume[:, :, z]
        for tag, value in tags.items():
            plane.SetMetaData(tag, value)
        writer.SetFileName(str(folder / f"{7 * z % 10}-{uid}.dcm"))
        if z not in skip:
            writer.Execute(plane)
    return folder


@pytest.mark.sweep
def test_dicom_slices_are_sorted_by_position(values, tmp_path):
    volume = Dicom()(write_dicom(tmp_path, values % 2000))
    assert np.array_equal(volume.values, values % 2000)
    assert volume.spacing.tolist() == list(SPACING)
    assert volume.origin.tolist() == list(ORIGIN)
    assert np.array_equal(volume.direction, ROTATED)


@pytest.mark.sweep
def test_a_series_of_many_is_chosen_by_its_id(values, tmp_path):
    for uid in ("1.2.3", "1.2.4"):
        write_dicom(tmp_path, values % 2000 + int(uid[-1]), uid=uid)
    assert Dicom(series="1.2.4")(tmp_path).values.min() >= 4
    refused(Dicom(), tmp_path, r"name one series .*--reader dicom:series=UID.*1\.2\.3, 1\.2\.4")


def test_raw_is_mapped_and_told_by_its_name(values, tmp_path):
    volume = Raw()(put(tmp_path / "my_head_12x11x10_uint16.raw", values.tobytes()))
    assert isinstance(volume.values, np.memmap)
    assert np.array_equal(volume.values, values)
    assert volume.name == "my_head"


@pytest.mark.parametrize("shape", ["12x11x10", (12, 11, 10)])
def test_raw_takes_options(shape, values, tmp_path):
    path = put(tmp_path / "a.raw", b"head" + values.astype(">u2").tobytes())
    reader = Raw(shape, "uint16", spacing="1x2x3.5", endian="big", offset=4)
    volume = reader(path)
    assert np.array_equal(volume.values, values)
    assert volume.values.dtype.isnative
    assert volume.spacing.tolist() == list(SPACING)


@pytest.mark.parametrize("name", ["a.raw", "b_12x11x5x2_uint16.raw", "a.raw.gz"])
def test_raw_has_times(name, values, tmp_path):
    content = values.tobytes()
    path = put(tmp_path / name, gzip.compress(content) if name.endswith("gz") else content)
    reader = Raw() if "_" in name else Raw("12x11x5x2", "uint16")
    held = reader.recorded(path)
    assert np.array_equal(volume_at(held, 1, None).values, values[5:])
    refused(reader, path, r"4 dimensions, 12 x 11 x 5 x 2; .* by time, 0 to 1")


def test_compressed_raw_is_unpacked(values, tmp_path):
    path = put(
        tmp_path / "a_12x11x10_uint16.raw.gz", gzip.compress(b"head" + values.tobytes(), mtime=0)
    )
    assert np.array_equal(Raw(offset=4)(path).values, values)


def test_npy_is_mapped(values, tmp_path):
    np.save(tmp_path / "a.npy", values)
    volume = Npy(spacing=(1, 1, 2))(tmp_path / "a.npy")
    assert isinstance(volume.values, np.memmap)
    assert np.array_equal(volume.values, values)
    assert volume.spacing.tolist() == [1, 1, 2]


@pytest.mark.parametrize(
    ("given", "kept"), [("bool", "uint8"), ("float16", "float32"), (">i2", "i2")]
)
def test_types_that_fit_into_a_known_one_are_widened(given, kept, values, tmp_path):
    array = (values % 2000).astype(given)
    np.save(tmp_path / "a.npy", array)
    volume = Npy()(tmp_path / "a.npy")
    assert volume.values.dtype == np.dtype(kept)
    assert np.array_equal(volume.values, array)


@pytest.mark.sweep
def test_importing_the_readers_imports_no_heavy_library():
    code = """import sys, resample_volume.files.readers
print({"SimpleITK", "OpenImageIO", "vtkmodules", "numba"} & set(sys.modules))"""
    printed = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert printed.stdout.strip() == "set()"


# What is refused: files that are not there or not whole

EVERY = {Nrrd: ".nrrd", MetaImage: ".mhd", Nifti: ".nii.gz", Vti: ".vti", TiffStack: ".tif"}
EVERY |= {Dicom: ".dcm", Raw: ".raw", Npy: ".npy", Vtk: ".vtk", Mrc: ".mrc", Cube: ".cube"}


@pytest.mark.parametrize("reader", EVERY)
def test_missing_files_are_named(reader, tmp_path):
    refused(reader(), tmp_path / f"a{EVERY[reader]}", "no such file", FileNotFoundError)


@pytest.mark.parametrize("reader", [reader for reader in EVERY if reader is not Raw])
@pytest.mark.parametrize("content", [b"", b"neither fish nor flesh\n" * 50])
def test_other_files_are_refused(reader, content, tmp_path):
    if reader is Vti:
        pytest.importorskip("vtkmodules")
    refused(reader(), put(tmp_path / f"a{EVERY[reader]}", content), r"a\b")


@pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() == 0, reason="root may read all")
def test_unreadable_files_are_refused(values, tmp_path):
    path = write(tmp_path / "a.nrrd", values)
    path.chmod(0)
    refused(Nrrd(), path, "cannot be read: Permission denied", PermissionError)


def test_a_folder_is_no_file(tmp_path):
    refused(Nrrd(), tmp_path, "is a folder; name one of its files", IsADirectoryError)


@pytest.mark.parametrize("name", ["a.nrrd", "a.mha", "a.nii"])
def test_truncated_files_are_refused(name, values, tmp_path):
    content = write(tmp_path / name, values).read_bytes()
    refused(ITK[name](), put(tmp_path / name, content[:-1000]), "expected|wanted|got only")


@pytest.mark.parametrize("cut", [1000, 6])  # in the data; in the checksum
@pytest.mark.parametrize("form", ["nhdr", "nrrd", "nii.gz", "raw.gz"])
def test_truncated_gzip_is_refused(form, cut, values, tmp_path):
    reader, path = packed(tmp_path, form, values, lambda content: content[:-cut])
    refused(reader, path, "damaged|data read error|expected 2640 bytes")


@pytest.mark.parametrize("at", [1500, -6])  # in the data; in the checksum
@pytest.mark.parametrize("form", ["nhdr", "nrrd", "nii.gz", "raw.gz"])
def test_corrupt_gzip_is_refused(form, at, values, tmp_path):
    reader, path = packed(tmp_path, form, values, lambda content: flipped(content, at))
    refused(reader, path, "damaged|data read error")


def packed(folder: Path, form: str, values: np.ndarray, harm) -> tuple:
    """Reader and path of a compressed volume that has come to harm."""
    data = harm(gzip.compress(values.tobytes(), mtime=0))
    if form == "raw.gz":
        return Raw(), put(folder / "a_12x11x10_uint16.raw.gz", data)
    if form == "nii.gz":
        content = gzip.decompress(write(folder / "a.nii.gz", values).read_bytes())
        return Nifti(), put(folder / "b.nii.gz", harm(gzip.compress(content, mtime=0)))
    if form == "nhdr":
        put(folder / "a.raw.gz", data)
        return Nrrd(), nrrd(folder / "a.nhdr", data="a.raw.gz", encoding="gzip")
    path = nrrd(folder / "a.nrrd", encoding="gzip")
    return Nrrd(), put(path, path.read_bytes() + b"\n" + data)


@pytest.mark.parametrize("given", [2000, 2740])
def test_detached_data_of_another_size_is_refused(given, values, tmp_path):
    data = (values.tobytes() + bytes(100))[:given]
    put(tmp_path / "a.raw", data)
    put(tmp_path / "a.raw.gz", gzip.compress(data, mtime=0))
    sizes = f"{given} bytes, 2640 are wanted"
    refused(Nrrd(), nrrd(tmp_path / "a.nhdr", data="a.raw"), sizes)
    refused(MetaImage(), meta(tmp_path / "a.mhd"), sizes)
    refused(Raw("12x11x10", "uint16"), tmp_path / "a.raw", sizes)
    packed = nrrd(tmp_path / "b.nhdr", data="a.raw.gz", encoding="gzip")
    refused(Nrrd(), packed, f"{given} bytes, 2640|expected 2640 bytes but received {given}")
    refused(Raw("12x11x10", "uint16"), tmp_path / "a.raw.gz", "bytes, 2640 are wanted")


def test_detached_data_that_is_missing_is_named(tmp_path):
    for reader, path in (
        (Nrrd(), nrrd(tmp_path / "a.nhdr", data="gone.raw")),
        (MetaImage(), meta(tmp_path / "a.mhd", data="gone.raw")),
    ):
        refused(reader, path, "gone.raw, which is not beside it", FileNotFoundError)


@pytest.mark.parametrize(
    "harm",
    [
        lambda content: zlib.compress(content)[:-1000],
        lambda content: zlib.compress(content[:-1000]),
        lambda content: flipped(zlib.compress(content), -2),
        lambda content: flipped(zlib.compress(content), 0),
    ],
)
def test_damaged_compressed_metaimage_is_refused(harm, values, tmp_path):
    put(tmp_path / "a.raw", zlib.compress(values.tobytes()))
    path = meta(tmp_path / "a.mhd", more="CompressedData = True\n")
    assert np.array_equal(MetaImage()(path).values, values)
    put(tmp_path / "a.raw", harm(values.tobytes()))
    refused(MetaImage(), path, "damaged|1640 bytes, 2640")


@pytest.mark.parametrize(
    "harm", [lambda c: c[: len(c) // 2], lambda c: c[:300], lambda c: flipped(c, len(c) // 2)]
)
def test_damaged_vti_is_refused(harm, values, tmp_path):
    content = write_vti(tmp_path / "a.vti", values).read_bytes()
    refused(Vti(), put(tmp_path / "a.vti", harm(content)), "damaged")


@pytest.mark.parametrize("suffix", [".tif", ".png"])
def test_a_damaged_slice_is_refused(suffix, values, tmp_path):
    for z, plane in enumerate(values):
        path = tmp_path / f"{z}{suffix}"
        SimpleITK.WriteImage(SimpleITK.GetImageFromArray(plane), str(path))
    path = tmp_path / f"3{suffix}"
    put(path, path.read_bytes()[:150])
    refused(TiffStack(), tmp_path, "damaged|cannot be read")


@pytest.mark.sweep
def test_a_missing_dicom_slice_is_interpolated_and_said(values, tmp_path):
    smooth = (2000 + 10 * np.arange(10)[:, None, None] ** 2 + values % 7).astype(np.int16)
    volume = Dicom()(write_dicom(tmp_path, smooth, skip=(4,)))
    assert volume.values.shape == smooth.shape
    assert volume.spacing.tolist() == list(SPACING)
    assert volume.origin.tolist() == list(ORIGIN)
    np.testing.assert_allclose(volume.direction, ROTATED, atol=1e-12)
    kept = np.delete(np.arange(10), 4)
    np.testing.assert_allclose(volume.values[kept], smooth[kept], rtol=1e-6)
    assert np.abs(volume.values[4] - smooth[4]).max() < 15
    assert volume.units == "hu"
    assert "z 3.5 to 7" in volume.note
    assert volume.note.endswith("is a slice missing?")
    assert volume.note in describe(volume)["findings"]


def test_dicom_slices_at_one_place_are_refused(values, tmp_path):
    write_dicom(tmp_path, values % 2000)
    twice = sorted(tmp_path.iterdir())[3]
    shutil.copy(twice, tmp_path / "copy.dcm")
    refused(Dicom(), tmp_path, "apart; is one missing, or there twice")


def test_a_damaged_dicom_slice_is_refused(values, tmp_path):
    write_dicom(tmp_path, values)
    path = max(tmp_path.iterdir())
    put(path, path.read_bytes()[:-100])
    refused(Dicom(), tmp_path, f"{path.name} is a damaged DICOM file")


def test_a_cut_off_npy_is_refused(values, tmp_path):
    np.save(tmp_path / "a.npy", values)
    put(tmp_path / "a.npy", (tmp_path / "a.npy").read_bytes()[:-100])
    refused(Npy(), tmp_path / "a.npy", "a.npy is not an array of numbers, or cut off")


def test_pickled_npy_is_refused(tmp_path):
    np.save(tmp_path / "a.npy", np.array([{}], object), allow_pickle=True)
    refused(Npy(), tmp_path / "a.npy", "not an array of numbers")


# What is refused: data that are no scalar volume


@pytest.mark.parametrize("name", ["a.nrrd", "a.mha", "a.nii"])
def test_pictures_are_no_volumes(name, values, tmp_path):
    plane = SimpleITK.GetImageFromArray(values[0])
    SimpleITK.WriteImage(plane, str(tmp_path / name))
    refused(ITK[name](), tmp_path / name, "2 dimensions, 12 x 11")


def test_a_single_slice_is_no_volume(values, tmp_path):
    refused(Nrrd(), write(tmp_path / "a.nrrd", values[:1]), "single slice of 12 x 11 x 1")
    refused(TiffStack(), write(tmp_path / "a.tif", values[:1]), "single slice of 12 x 11 x 1")
    refused(Dicom(), next(write_dicom(tmp_path, values[:1]).glob("*.dcm")), "give the folder")


def test_four_dimensions_are_no_volume(values, tmp_path):
    np.save(tmp_path / "a.npy", np.stack([values, values]))
    refused(Npy(), tmp_path / "a.npy", "4 dimensions, 12 x 11 x 10 x 2")
    path = nrrd(tmp_path / "a.nrrd", sizes="12 11 5 2")
    refused(Nrrd(), put(path, path.read_bytes() + b"\n" + values.tobytes()), "4 dimensions")


@pytest.mark.parametrize("name", ["a.nrrd", "a.mha"])
def test_vectors_that_are_no_colors_are_no_scalars(name, values, tmp_path):
    vectors = np.stack([values] * 2, -1).astype(np.uint8)
    path = write(tmp_path / name, vectors, isVector=True)
    refused(ITK[name](), path, "'vector of uint8', 2 numbers each")
    shifts = np.stack([values] * 3, -1).astype(np.float32) - 9e4
    refused(ITK[name](), write(path, shifts, isVector=True), "below 0, which are not colors")


def test_slices_of_gray_and_opacity_are_no_scalars(values, tmp_path):
    pair = SimpleITK.GetImageFromArray(
        np.stack([values[0]] * 2, -1).astype(np.uint8), isVector=True
    )
    for n in range(3):
        SimpleITK.WriteImage(pair, str(tmp_path / f"{n}.png"))
    refused(TiffStack(), tmp_path, "2 channels.*convert it to gray")


@pytest.mark.parametrize("name", ["a.nrrd", "a.nii"])
def test_complex_numbers_are_refused(name, values, tmp_path):
    path = write(tmp_path / name, values.astype(np.complex64))
    refused(ITK[name](), path, "complex numbers")


@pytest.mark.parametrize("kind", ["int64", "uint32", "uint64", "complex64", "U3"])
def test_other_types_are_refused(kind, values, tmp_path):
    np.save(tmp_path / "a.npy", values.astype(kind))
    refused(Npy(), tmp_path / "a.npy", f"voxels of type .*{kind[1:]}; known are uint8")


def test_int64_nrrd_is_refused(values, tmp_path):
    refused(Nrrd(), write(tmp_path / "a.nrrd", values.astype(np.int64)), "type int64")


def test_empty_volumes_are_refused(values, tmp_path):
    put(tmp_path / "a.raw", b"")
    np.save(tmp_path / "a.npy", values[:0])
    refused(Nrrd(), nrrd(tmp_path / "a.nhdr", data="a.raw", sizes="0 11 10"), "empty: 0 x 11 x 10")
    refused(MetaImage(), meta(tmp_path / "a.mhd", sizes="0 11 10"), "empty: 0 x 11 x 10")
    refused(Npy(), tmp_path / "a.npy", "empty: 12 x 11 x 0")
    refused(Raw(), put(tmp_path / "a_0x11x10_uint8.raw", b""), "positive numbers")
    content = bytearray(write(tmp_path / "a.nii", values).read_bytes())
    struct.pack_into("<h", content, 42, 0)
    refused(Nifti(), put(tmp_path / "a.nii", bytes(content)), "empty")


def test_an_empty_folder_is_no_volume(tmp_path):
    refused(TiffStack(), tmp_path, "holds no slices; known are .tif")
    refused(Dicom(), tmp_path, "is this a folder of DICOM files")


def test_slices_that_differ_are_refused(values, tmp_path):
    for n, plane in enumerate((values[0], values[1], values[2, :5])):
        SimpleITK.WriteImage(SimpleITK.GetImageFromArray(plane), str(tmp_path / f"{n}.tif"))
    refused(TiffStack(), tmp_path, "2.tif is 12 x 5 uint16, 0.tif is 12 x 11 uint16")


@pytest.mark.parametrize("spacing", ["-1 1 1", "0 1 1", "nan 1 1", "inf 1 1"])
def test_metaimage_spacing_is_checked(spacing, values, tmp_path):
    put(tmp_path / "a.raw", values.tobytes())
    refused(MetaImage(), meta(tmp_path / "a.mhd", spacing=spacing), "must be positive and finite")


@pytest.mark.parametrize("spacing", ["-1 1 1", "0 1 1", "inf 1 1"])
def test_nrrd_spacing_is_checked(spacing, values, tmp_path):
    put(tmp_path / "a.raw", values.tobytes())
    path = nrrd(tmp_path / "a.nhdr", data="a.raw", more=f"spacings: {spacing}\n")
    refused(Nrrd(), path, "must be positive and finite|invalid")


@pytest.mark.parametrize("spacing", [-2, 0, float("nan"), float("inf")])
def test_nifti_spacing_is_checked(spacing, values, tmp_path):
    content = bytearray(write(tmp_path / "a.nii", values).read_bytes())
    struct.pack_into("<f", content, 80, spacing)
    refused(Nifti(), put(tmp_path / "a.nii", bytes(content)), "must be positive and finite")


@pytest.mark.parametrize("spacing", ["-1 2 3.5", "0 2 3.5", "nan 2 3.5"])
def test_vti_spacing_is_checked(spacing, values, tmp_path):
    content = write_vti(tmp_path / "a.vti", values).read_text("latin-1")
    changed = content.replace('Spacing="1 2 3.5"', f'Spacing="{spacing}"')
    refused(Vti(), put(tmp_path / "a.vti", changed), "must be positive and finite")


@pytest.mark.parametrize(
    "matrix", ["0 0 0 0 1 0 0 0 1", "1 0 0 1 0 0 0 0 1", "nan 0 0 0 1 0 0 0 1"]
)
def test_metaimage_direction_is_checked(matrix, values, tmp_path):
    put(tmp_path / "a.raw", values.tobytes())
    refused(MetaImage(), meta(tmp_path / "a.mhd", matrix=matrix), "singular|is not finite")


@pytest.mark.parametrize("first", ["(0,0,0)", "(0,1,0)", "(nan,0,0)"])
def test_nrrd_direction_is_checked(first, values, tmp_path):
    put(tmp_path / "a.raw", values.tobytes())
    more = f"space: LPS\nspace directions: {first} (0,1,0) (0,0,1)\n"
    path = nrrd(tmp_path / "a.nhdr", data="a.raw", more=more)
    refused(Nrrd(), path, "singular|positive|must be consistent")


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"shape": "12x11"}, "shape is three positive numbers"),
        ({"shape": "12x11x0"}, "shape is three positive numbers"),
        ({"shape": (1.5, 2, 2)}, "whole numbers"),
        ({"shape": 7}, "shape is three positive numbers"),
        ({"dtype": "uint7"}, "name like uint8"),
        ({"dtype": "int64"}, "known are uint8"),
        ({"spacing": "1x-1x1"}, "spacing is three positive numbers"),
        ({"spacing": "1x1xnan"}, "spacing is three positive numbers"),
        ({"endian": "middle"}, "little or big"),
        ({"dtype": ">i2", "endian": "little"}, "'>i2' is big-endian, endian says little"),
        ({"offset": -1}, "from 0 on"),
    ],
)
def test_options_are_checked_when_they_are_given(options, match):
    with pytest.raises(ValueError, match=match):
        Raw(**options)


def test_raw_that_does_not_tell_its_shape_is_refused(tmp_path):
    refused(Raw(), put(tmp_path / "a.raw", b"1"), "give shape and dtype")


@pytest.mark.parametrize(
    "form", ["a.nrrd", "a.mha", "a.nii", "a.nii.gz", "a.tif", "a.raw.gz", "dcm"]
)
def test_what_cannot_fit_is_refused_before_it_is_read(form, values, tmp_path, monkeypatch):
    monkeypatch.setattr("resample.memory.physical_memory", lambda: 2000)
    if form == "dcm":
        reader, path = Dicom(), write_dicom(tmp_path, values)
    elif form == "a.raw.gz":
        reader, path = Raw("12x11x10", "uint16"), put(tmp_path / form, b"")
    else:
        reader, path = ({"a.tif": TiffStack} | ITK)[form](), write(tmp_path / form, values)
    refused(reader, path, "needs 0.0 GiB, this machine has 0.0 GiB")


def test_a_huge_header_does_not_allocate(tmp_path):
    path = nrrd(tmp_path / "a.nrrd", sizes="12000 11000 10000")
    refused(Nrrd(), put(path, path.read_bytes() + b"\n123"), "needs 2458.7 GiB, this machine has")


def test_a_platform_that_does_not_tell_its_memory_refuses_nothing(monkeypatch):
    monkeypatch.delattr("os.sysconf")
    assert physical_memory() is None
    volume_values.require_memory(1 << 80, "all")


# Real data


@pytest.mark.parametrize(
    ("name", "shape", "spacing"),
    [
        ("engine.nhdr", (128, 256, 256), (1, 1, 1)),
        ("lobster.nhdr", (56, 324, 301), (1, 1, 1.4)),
        ("headsq_quarter.nhdr", (93, 64, 64), (3.2, 3.2, 1.5)),
    ],
)
def test_the_papers_data_have_their_shape(name, shape, spacing, volumes):
    volume = Nrrd()(volumes / name)
    assert volume.values.shape == shape
    assert volume.spacing.tolist() == list(spacing)


@pytest.mark.some(1)
@pytest.mark.parametrize(
    ("name", "low", "high", "count"),
    [
        ("engine.nhdr", 71, 256, 1_160_038),
        ("aneurism.nhdr", 25, 256, 114_695),
        ("lobster.nhdr", 65, 222, 190_815),
    ],
)
def test_the_papers_data_have_their_voxels(name, low, high, count, volumes):
    values = Nrrd()(volumes / name).values
    assert np.count_nonzero((values >= low) & (values < high)) == count


def test_one_tooth_in_two_containers_is_one(volumes):
    whole, detached = Nrrd()(volumes / "original/tooth.nrrd"), Nrrd()(volumes / "tooth.nhdr")
    assert np.array_equal(whole.values, detached.values)


def test_a_head_in_nifti_is_read(volumes):
    volume = Nifti()(volumes / "chris_t1.nii.gz")
    assert volume.values.shape == (190, 256, 188)
    np.testing.assert_allclose(volume.spacing, 0.88, rtol=1e-6)
    assert volume.name == "chris_t1"


@pytest.mark.sweep
def test_one_aneurysm_in_two_containers_is_one(volumes):
    pytest.importorskip("vtkmodules")
    first, second = Vti()(volumes / "original/aneurism.vti"), Nrrd()(volumes / "aneurism.nhdr")
    assert np.array_equal(first.values, second.values)
    assert np.array_equal(first.spacing, second.spacing)


@pytest.mark.parametrize("first", ["(1e200,0,0)", "(inf,0,0)", "(1e200,1e200,inf)"])
def test_nrrd_steps_beyond_numbers_are_refused_without_a_warning(first, values, tmp_path):
    put(tmp_path / "a.raw", values.tobytes())
    more = f"space: LPS\nspace directions: {first} (0,1,0) (0,0,1)\n"
    refused(Nrrd(), nrrd(tmp_path / "a.nhdr", data="a.raw", more=more), "a: ")


@pytest.mark.parametrize(
    ("place", "value", "complaint"),
    [
        (72, 8, "is damaged: bitpix 8 of type 512"), (72, 32, "is damaged: bitpix 32 of type 512"),
        (40, 0, "has 0 dimensions; there are 1 to 7"), (40, 8, "has 8 dimensions"),
        (42, 0, "is empty"),
    ],
)  # fmt: skip
def test_a_header_of_nifti_that_contradicts_itself_is_refused(
    values, tmp_path, place, value, complaint
):
    content = bytearray(write(tmp_path / "a.nii", values.astype(np.uint16)).read_bytes())
    assert struct.unpack_from("<2h", content, 70) == (512, 16)
    struct.pack_into("<h", content, place, value)
    refused(Nifti(), put(tmp_path / "b.nii", bytes(content)), complaint)


@pytest.mark.parametrize("offset", [347.0, 2.0**40, float("nan"), -1.0])
def test_voxels_of_nifti_begin_behind_the_header(values, tmp_path, offset):
    content = bytearray(write(tmp_path / "a.nii", values).read_bytes())
    struct.pack_into("<f", content, 108, offset)
    refused(Nifti(), put(tmp_path / "b.nii", bytes(content)), "its voxels begin at")
