"""Readers and writers of volumes beside SimpleITK, which knows nothing of them."""

import bz2
import struct
from itertools import product
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from resample_volume.files import dicom
from resample_volume.files.dicom import Dicom
from resample_volume.files.metaimage import MetaImage
from resample_volume.files.nifti import Nifti
from resample_volume.files.nrrd import Nrrd
from resample_volume.files.source import find_reader, open_recording, open_volume, write_volume
from resample_volume.types import Volume

sitk = pytest.importorskip("SimpleITK", reason="readers are compared with SimpleITK")

SPACING, ORIGIN = (1.0, 2.0, 3.5), (5.0, 6.0, -7.0)
TURNS = {
    "upright": np.eye(3),
    "turned": np.array(((0.8, -0.6, 0), (0.6, 0.8, 0), (0, 0, 1))),
    "mirrored": np.array(((0, -1, 0), (1, 0, 0), (0, 0, -1.0))),
    "coronal": np.array(((1, 0, 0), (0, 0, 1), (0, -1, 0.0))),
}
NRRD = "NRRD0004\ntype: uint8\ndimension: {}\nsizes: {}\nencoding: raw\n{}\n\n"
BYTES = bytes(range(192))


@pytest.fixture
def values(rng):
    return rng.integers(-3000, 3000, (6, 7, 8)).astype(np.int16)


def agrees(volume, image):
    """Whether values and places are ITK's."""
    assert np.array_equal(volume.values, sitk.GetArrayFromImage(image))
    np.testing.assert_allclose(volume.spacing, image.GetSpacing(), rtol=1e-6)
    np.testing.assert_allclose(volume.origin, image.GetOrigin(), rtol=1e-6, atol=1e-6)
    direction = np.reshape(image.GetDirection(), (3, 3))
    np.testing.assert_allclose(volume.direction, direction, atol=1e-6)


def image_of(values, turn="turned"):
    image = sitk.GetImageFromArray(values)
    image.SetSpacing(SPACING)
    image.SetOrigin(ORIGIN)
    image.SetDirection(TURNS[turn].ravel().tolist())
    return image


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("name", ["a.nrrd", "a.mha", "a.mhd", "a.nii", "a.nii.gz"])
@pytest.mark.parametrize("packed", [False, True])
def test_what_itk_writes_is_read_as_itk_reads_it(turn, name, packed, values, tmp_path):
    sitk.WriteImage(image_of(values, turn), str(tmp_path / name), packed)
    agrees(open_volume(tmp_path / name), sitk.ReadImage(str(tmp_path / name)))


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("name", ["a.nrrd", "a.mha", "a.nii", "a.nii.gz"])
@pytest.mark.parametrize("kind", ["uint8", "int16", "uint16", "int32", "float32", "float64"])
def test_what_is_written_itk_reads_alike(turn, name, kind, values, tmp_path):
    given = Volume(values.astype(kind), np.array(SPACING), np.array(ORIGIN), TURNS[turn], "a")
    write_volume(tmp_path / name, given)
    agrees(given, sitk.ReadImage(str(tmp_path / name)))


# NRRD


@pytest.mark.parametrize(
    "more",
    [
        *(
            f"space: {space}\nspace directions: (1,0,0) (0.5,2,0) (0,0,3)\nspace origin: (1,2,3)"
            for space in ("RAS", "LAS", "LPS", "right-anterior-superior", "scanner-xyz")
        ),
        "space dimension: 3\nspace directions: (0,1,0) (2,0,0) (0,0,3)",
        "spacings: 1 nan 3",
        "axis mins: 1 2 3",
        "axis mins: 1 2 3\nspacings: 2 2 2",
        "axis mins: 1 2 3\nspacings: 2 2 2\ncenters: node node node",
        "axis mins: 1 2 3\naxis maxs: 3 4 9",
    ],
)
def test_places_of_nrrd(more, tmp_path):
    path = tmp_path / "a.nrrd"
    path.write_bytes(NRRD.format(3, "8 6 4", more).encode() + BYTES)
    agrees(Nrrd()(path), sitk.ReadImage(str(path)))


@pytest.mark.parametrize("last", [False, True])
def test_a_list_may_be_the_first_axis_or_the_last(last, tmp_path):
    axes = ["domain", "domain", "domain"]
    axes.insert(3 if last else 0, "list")
    sizes = "4 4 4 3" if last else "3 4 4 4"
    more = f"kinds: {' '.join(axes)}"
    path = tmp_path / "a.nrrd"
    path.write_bytes(NRRD.format(4, sizes, more).encode() + BYTES)
    found = open_recording(path).values[0]
    assert np.array_equal(np.moveaxis(found, 0, -1), sitk.GetArrayFromImage(sitk.ReadImage(path)))


def test_times_with_a_place_are_read_where_itk_refuses_them(tmp_path):
    more = (
        "space: RAS\nspace directions: (1,0,0) (0,2,0) (0,0,3) none\nkinds: space space space time"
    )
    path = tmp_path / "a.nrrd"
    path.write_bytes(NRRD.format(4, "4 4 4 3", more).encode() + BYTES)
    held = open_recording(path)
    assert np.array_equal(held.values[:, 0].ravel(), np.frombuffer(BYTES, np.uint8))
    assert np.array_equal(np.diag(held.direction), (-1, -1, 1))


@pytest.mark.parametrize("encoding", ["text", "hex", "bzip2"])
def test_other_encodings_of_nrrd(encoding, tmp_path):
    text = " ".join(map(str, BYTES)).encode()
    held = {"text": text, "hex": BYTES.hex().encode(), "bzip2": bz2.compress(BYTES)}[encoding]
    path = tmp_path / "a.nrrd"
    head = NRRD.format(3, "8 6 4", "spacings: 1 1 1").replace("raw", encoding)
    path.write_bytes(head.encode() + held)
    found = Nrrd()(path)
    assert np.array_equal(found.values.ravel(), np.frombuffer(BYTES, np.uint8))
    if encoding != "bzip2":  # ITK's does not have it
        agrees(found, sitk.ReadImage(str(path)))


@pytest.mark.parametrize("skip", ["line skip: 2", "byte skip: 9", "byte skip: -1"])
@pytest.mark.parametrize("data", ["a.raw", "%d.raw 1 4 1", "LIST\n1.raw\n2.raw\n3.raw\n4.raw"])
def test_data_beside_a_header(skip, data, tmp_path):
    parts = {"a": BYTES} | {str(n + 1): BYTES[48 * n : 48 * n + 48] for n in range(4)}
    for name, part in parts.items():
        (tmp_path / f"{name}.raw").write_bytes(b"one\ntwo\n "[: 9 if "b" in skip else 8] + part)
    head = NRRD.format(3, "8 6 4", skip).strip() + f"\ndata file: {data}\n"
    (tmp_path / "a.nhdr").write_text(head)
    agrees(Nrrd()(tmp_path / "a.nhdr"), sitk.ReadImage(str(tmp_path / "a.nhdr")))


# MetaImage


META = """ObjectType = Image
NDims = 3
{}Offset = 1 2 3
Rotation = 0 1 0 -1 0 0 0 0 1
ElementSize = 1 2 3
DimSize = 8 7 6
ElementType = MET_SHORT
ElementDataFile = {}
"""


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("more", ["", "HeaderSize = 7\n", "HeaderSize = -1\n"])
def test_forms_of_metaimage(order, more, values, tmp_path):
    skipped = b"1234567" if more else b""
    (tmp_path / "a.raw").write_bytes(skipped + values.astype(order + "i2").tobytes())
    more += f"BinaryData = True\nBinaryDataByteOrderMSB = {order == '>'}\n"
    (tmp_path / "a.mhd").write_text(META.format(more, "a.raw"))
    agrees(MetaImage()(tmp_path / "a.mhd"), sitk.ReadImage(str(tmp_path / "a.mhd")))


def test_metaimage_as_text(values, tmp_path):
    path = tmp_path / "a.mha"
    path.write_text(META.format("BinaryData = False\n", "LOCAL") + " ".join(map(str, values.flat)))
    assert np.array_equal(MetaImage()(path).values, values)  # ITK 5.4 reads none


def test_metaimage_of_several_files(values, tmp_path):
    for n, plane in enumerate(values):
        (tmp_path / f"{n}.raw").write_bytes(plane.tobytes())
    head = "ObjectType = Image\nNDims = 3\nDimSize = 8 7 6\nElementType = MET_SHORT\n"
    head += "ElementDataFile = "
    names = "\n".join(f"{n}.raw" for n in range(6))
    for data in (f"LIST\n{names}\n", "%d.raw 0 5 1\n"):
        (tmp_path / "a.mhd").write_text(head + data)
        agrees(MetaImage()(tmp_path / "a.mhd"), sitk.ReadImage(str(tmp_path / "a.mhd")))


# NIfTI


def nifti(path, values, *, codes, affine=None, pixdim=(1, 1, 2, 3.5), more=()):
    """File of NIfTI-1 with a qform that is turned and an sform that is what is given."""
    head = bytearray(352)
    struct.pack_into("<i", head, 0, 348)
    struct.pack_into("<8h", head, 40, values.ndim, *values.shape[::-1], *(1,) * (7 - values.ndim))
    kinds = {"i2": (4, 16), "i4": (8, 32), "f4": (16, 32), "f8": (64, 64), "u1": (2, 8)}
    struct.pack_into("<2h", head, 70, *kinds[values.dtype.str[1:]])
    struct.pack_into("<4f", head, 76, *pixdim)
    struct.pack_into("<3f", head, 108, 352, *(more or (1, 0)))
    struct.pack_into("<2h", head, 252, *codes)
    struct.pack_into("<6f", head, 256, 0.1, -0.3, 0.5, 10, 20, 30)
    if affine is not None:
        struct.pack_into("<12f", head, 280, *np.ravel(affine))
    head[344:348] = b"n+1\0"
    path.write_bytes(bytes(head) + values.tobytes())
    return path


@pytest.mark.parametrize("codes", list(product(range(4), range(4))))
@pytest.mark.parametrize("sign", [1, -1])
def test_what_itk_takes_for_the_place_of_nifti(codes, sign, values, tmp_path, capfd):
    turned = TURNS["turned"] * [[1], [sign], [1]] * (1, 2, 3.5)
    affine = np.column_stack([turned, (1, 2, 3)])
    path = nifti(tmp_path / "a.nii", values, codes=codes, affine=affine, pixdim=(sign, 1, 2, 3.5))
    agrees(Nifti()(path), sitk.ReadImage(str(path)))
    capfd.readouterr()


@pytest.mark.parametrize("kind", ["u1", "i2", "i4", "f4", "f8"])
@pytest.mark.parametrize("scale", [(2.0, 10.0), (0.3, -7.0), (0.0, 5.0), (1.0, 0.5)])
def test_slopes_of_nifti(kind, scale, values, tmp_path):
    path = nifti(tmp_path / "a.nii", values.astype(kind), codes=(1, 0), more=scale)
    image = sitk.ReadImage(str(path))
    found = Nifti()(path)
    assert found.values.dtype == sitk.GetArrayViewFromImage(image).dtype
    np.testing.assert_allclose(found.values, sitk.GetArrayFromImage(image), rtol=1e-6, atol=1e-6)


def test_nifti_2_is_read_as_nifti_1_is(values, tmp_path):
    first = nifti(tmp_path / "a.nii", values, codes=(1, 0))
    old = first.read_bytes()
    new = bytearray(544)
    struct.pack_into("<i8s2h", new, 0, 540, b"n+2\0\r\n\032\n", 4, 16)
    struct.pack_into("<8q", new, 16, *struct.unpack_from("<8h", old, 40))
    struct.pack_into("<8d", new, 104, *struct.unpack_from("<8f", old, 76))
    struct.pack_into("<q2d", new, 168, 544, 1, 0)
    struct.pack_into("<2i", new, 344, 1, 0)
    struct.pack_into("<6d", new, 352, *struct.unpack_from("<6f", old, 256))
    (tmp_path / "b.nii").write_bytes(bytes(new) + old[352:])
    one, two = (Nifti()(tmp_path / name) for name in ("a.nii", "b.nii"))
    assert np.array_equal(one.values, two.values)
    assert np.array_equal(one.spacing, two.spacing)
    assert np.array_equal(one.direction, two.direction)
    assert np.array_equal(one.origin, two.origin)


# DICOM


def series(folder: Path, values, *, turn="turned", packing="", **changed) -> Path:
    """Slices whose names are in no order, changed by pydicom after ITK has written them."""
    import pydicom

    image = image_of(values, turn)
    writer = sitk.ImageFileWriter()
    writer.KeepOriginalImageUIDOn()
    if packing:
        writer.UseCompressionOn()
        writer.SetCompressor(packing)
    axes = TURNS[turn]
    for z in range(len(values)):
        plane = image[:, :, z]
        tags = {
            "0008|0060": "CT",
            "0008|0018": f"1.2.8.{z + 1}",
            "0020|000d": "1.2.9",
            "0020|000e": "1.2.3",
            "0020|0013": str(z),
            "0020|0032": "\\".join(map(str, image.TransformIndexToPhysicalPoint((0, 0, z)))),
            "0020|0037": "\\".join(map(str, axes[:, :2].T.ravel())),
        }
        for tag, value in tags.items():
            plane.SetMetaData(tag, value)
        path = folder / f"{'fcaebd'[z]}.dcm"
        writer.SetFileName(str(path))
        writer.Execute(plane)
        if changed:
            told = pydicom.dcmread(path)
            for key, value in changed.items():
                if value is None:
                    delattr(told, key)
                else:
                    setattr(told, key, value)
            told.save_as(path)
    return folder


def by_itk(folder):
    reader = sitk.ImageSeriesReader()
    reader.SetFileNames(reader.GetGDCMSeriesFileNames(str(folder), "1.2.3"))
    return reader.Execute()


@pytest.mark.some(1)
@pytest.mark.parametrize("turn", TURNS)
def test_places_of_dicom(turn, values, tmp_path):
    agrees(Dicom()(series(tmp_path, values, turn=turn)), by_itk(tmp_path))


@pytest.mark.some(2)
@pytest.mark.parametrize("kind", ["int16", "uint16", "uint8"])
@pytest.mark.parametrize("scale", [(1, -1024), (2, -7), (0.5, 0.25), (0.3, 0)])
@pytest.mark.parametrize("form", ["MONOCHROME2", "MONOCHROME1"])
def test_values_of_dicom(kind, scale, form, values, tmp_path):
    scales = {"RescaleSlope": scale[0], "RescaleIntercept": scale[1]}
    given = (values % 200).astype(kind)
    modality = "CT" if form == "MONOCHROME2" else "MR"
    series(tmp_path, given, PhotometricInterpretation=form, Modality=modality, **scales)
    found, image = Dicom()(tmp_path), by_itk(tmp_path)
    assert found.values.dtype == sitk.GetArrayViewFromImage(image).dtype
    agrees(found, image)


def test_hounsfield_units_are_kept_where_low_values_are_shown_white(values, tmp_path):
    """The interpretation is of what is shown; ITK inverts values, too, so that air were bone."""
    scales = {"RescaleSlope": 1, "RescaleIntercept": -1024}
    series(tmp_path, values, PhotometricInterpretation="MONOCHROME1", **scales)
    found = Dicom()(tmp_path)
    assert np.array_equal(found.values, values.astype(np.int32) - 1024)
    assert "MONOCHROME1" in found.note


def test_slices_of_letters_without_numbers_are_sorted_by_their_places(values, tmp_path):
    found = Dicom()(series(tmp_path, values, InstanceNumber=None))
    assert np.array_equal(found.values, values)
    agrees(found, by_itk(tmp_path))


def test_slices_without_places_are_sorted_by_their_numbers(values, tmp_path):
    nowhere = dict.fromkeys(("ImagePositionPatient", "ImageOrientationPatient"))
    assert np.array_equal(Dicom()(series(tmp_path, values, **nowhere)).values, values)


@pytest.mark.parametrize("places", [[0.0, 0.0], [np.nan, 2.0], [1.0]])
def test_slices_that_do_not_tell_their_distance_have_that_of_the_header(places):
    pydicom = pytest.importorskip("pydicom")
    dataset = pydicom.Dataset()
    dataset.SpacingBetweenSlices, dataset.PixelSpacing = 2.5, [0.5, 0.7]
    slices = [SimpleNamespace(dataset=dataset, frame=0, axes=np.eye(3)[:2]) for _ in places]
    spacing, direction = dicom._lattice(slices, np.outer(places, [0.0, 0.0, 1.0]))
    np.testing.assert_allclose(spacing, [0.7, 0.5, 2.5])
    np.testing.assert_array_equal(direction, np.eye(3))


@pytest.mark.parametrize(
    ("numbers", "names", "order"),
    [
        ((3, 1, 2), ("a", "b", "c"), [1, 2, 0]),
        ((3, None, 2), ("a10", "a9", "b"), [1, 0, 2]),
        ((None, None, None), ("c", "b", "a"), [2, 1, 0]),
        ((3, 1, 2), ("a", "a", "a"), [2, 1, 0]),
    ],
)
def test_slices_without_places_are_sorted_by_numbers_or_by_names(numbers, names, order):
    """By names if one has no number, and by frames within a file."""
    pydicom = pytest.importorskip("pydicom")
    slices = []
    for n, (number, name) in enumerate(zip(numbers, names, strict=True)):
        dataset = pydicom.Dataset()
        if number is not None:
            dataset.InstanceNumber = number
        place, axes = np.full(3, np.nan), np.eye(3)[:2]
        slices.append(
            SimpleNamespace(dataset=dataset, path=Path(name), frame=2 - n, axes=axes, place=place)
        )
    assert [2 - each.frame for each in dicom._sorted(slices)] == order


@pytest.mark.parametrize(("packing", "needs"), [("JPEG2000", ""), ("JPEG", "gdcm")])
def test_packed_slices(packing, needs, values, tmp_path):
    if needs:
        pytest.importorskip(needs, reason="lossless JPEG is unpacked by the extra dicom")
    series(tmp_path, np.cumsum(np.ones_like(values), axis=2, dtype=np.int16), packing=packing)
    agrees(Dicom()(tmp_path), by_itk(tmp_path))


@pytest.mark.sweep
def test_slices_of_run_lengths(values, tmp_path):
    import pydicom

    series(tmp_path, values)
    wanted = by_itk(tmp_path)
    for path in tmp_path.iterdir():
        told = pydicom.dcmread(path)
        told.compress(pydicom.uid.RLELossless)
        told.SOPInstanceUID = told.file_meta.MediaStorageSOPInstanceUID
        told.save_as(path)
    agrees(Dicom()(tmp_path), wanted)


def test_packing_that_needs_more_says_what_to_install(values, tmp_path, monkeypatch):
    from pydicom.pixels.decoders import base

    series(tmp_path, values, packing="JPEG")
    monkeypatch.setattr(base.Decoder, "available_plugins", ())
    with pytest.raises(
        ValueError, match=r"packed as JPEG Lossless.*hybrid-resample\[dicom\]"
    ) as caught:
        Dicom()(tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.sweep
def test_damaged_dicom_is_refused_in_a_line(values, tmp_path, rng):
    series(tmp_path, values[:3])
    whole = {path: path.read_bytes() for path in tmp_path.iterdir()}
    for _ in range(60):
        path = list(whole)[rng.integers(3)]
        content = bytearray(whole[path])
        for at in rng.integers(132, len(content), 3):
            content[at] = rng.integers(256)
        path.write_bytes(content)
        try:
            Dicom()(tmp_path)
        except (ValueError, OSError) as error:
            assert "\n" not in str(error)  # noqa: PT017 - or it is read
        path.write_bytes(whole[path])


def test_a_tilted_gantry_makes_a_sheared_volume(values, tmp_path):
    """ITK makes its slices lie straight behind each other, where they are not."""
    import pydicom

    series(tmp_path, values, turn="upright")
    for path in tmp_path.iterdir():
        told = pydicom.dcmread(path)
        x, y, z = map(float, told.ImagePositionPatient)
        told.ImagePositionPatient = [x, y + (z - ORIGIN[2]) / 7, z]
        told.save_as(path)
    volume = Dicom()(tmp_path)
    assert np.array_equal(volume.values, values)
    step = volume.spacing * volume.direction
    np.testing.assert_allclose(step[:, 2], (0, 0.5, 3.5), atol=1e-9)
    np.testing.assert_allclose(step[:, :2], [[1, 0], [0, 2], [0, 0]], atol=1e-9)


def test_frames_of_one_file(values, tmp_path):
    path = tmp_path / "a.dcm"
    sitk.WriteImage(image_of(values.astype(np.uint16), "coronal"), str(path))
    agrees(Dicom()(path), sitk.ReadImage(str(path)))


# Real data


@pytest.mark.some(1)
@pytest.mark.parametrize(
    "name",
    [
        *("engine.nhdr", "lobster.nhdr", "headsq_quarter.nhdr", "hydrogen_orbital.nhdr"),
        *("neghip.nhdr", "tooth.nhdr", "original/tooth.nrrd", "chris_t1.nii.gz"),
    ],
)
def test_real_volumes(name, volumes):
    path = volumes / name
    agrees(find_reader(path)(path), sitk.ReadImage(str(path)))
