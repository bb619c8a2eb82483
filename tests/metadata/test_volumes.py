"""What files of volumes say of places, lengths and values is obeyed, told or refused."""

import bz2
import gzip
import math
import re
from pathlib import Path

import numpy as np
import pytest
import SimpleITK
import tifffile

from resample.lengths import ratio
from resample_volume.data.recordings import assumed, unit_of_space
from resample_volume.files.readers import Raw
from resample_volume.files.source import open_recording, open_volume
from resample_volume.types import ChannelLook
from tests.metadata.corpus import Outcome, Variant
from tests.metadata.volumes import (
    COUNTS,
    LPS,
    ORIGIN,
    SPACING,
    TURN,
    VALUES,
    Truth,
    described,
    dicom,
    directions,
    imagej,
    listed,
    metaimage,
    mrc,
    nifti,
    nrrd,
    ome_tiff,
    ome_zarr,
    saved,
    tiff,
    turned,
    vti,
    vtk,
)

STEPS = TURN * SPACING  # columns are the steps along x, y, z
VARIANTS: list[Variant] = []


def add(form, field, case, write, *, told="", refused=""):
    """Add a variant; `write` gets a folder and returns a Truth, or the path of a refused file."""
    outcome: Outcome = "refused" if refused else "told" if told else "obeyed"
    VARIANTS.append(Variant(form, field, case, outcome, write, told or refused))


def by_itk(path: Path) -> Truth:
    """What ITK reads, whose lengths are mm."""
    image = SimpleITK.ReadImage(str(path))
    turn = np.array(image.GetDirection()).reshape(3, 3)
    values = SimpleITK.GetArrayFromImage(image)
    return Truth(path, values, np.array(image.GetSpacing()), image.GetOrigin(), turn)


# NRRD

for name in (
    "left-posterior-superior", "right-anterior-superior", "left-anterior-superior",
    "LPS", "RAS", "LAS",
):  # fmt: skip
    add("NRRD", "space", name, lambda folder, name=name: by_itk(
        nrrd(folder, f"space: {name}\n{directions(STEPS)}space origin: (-30,12,55)\n")
    ))  # fmt: skip
for case, steps in (
    ("rotated", STEPS),
    ("mirrored", STEPS * (1, 1, -1)),
    ("permuted axes", STEPS[:, [2, 0, 1]]),
):
    add("NRRD", "space directions", case, lambda folder, steps=steps: by_itk(
        nrrd(folder, f"space: LPS\n{directions(steps)}space origin: (1,2,3)\n")
    ))  # fmt: skip
SHEAR = STEPS + np.outer(STEPS[:, 0], (0, 0.4, 0))
add("NRRD", "space directions", "sheared", lambda folder: Truth(
    nrrd(folder, f"space: LPS\n{directions(SHEAR)}"),
    spacing=np.linalg.norm(SHEAR, axis=0),
    turn=SHEAR / np.linalg.norm(SHEAR, axis=0),
))  # fmt: skip
AXES = f"spacings: {listed(SPACING)}\n"
add("NRRD", "spacings", "without a space", lambda folder: by_itk(nrrd(folder, AXES)))
add("NRRD", "axis mins", "1, 2, 3", lambda folder: by_itk(
    nrrd(folder, f"{AXES}axis mins: 1 2 3\n")
))  # fmt: skip
add("NRRD", "centerings", "cell", lambda folder: by_itk(
    nrrd(folder, f"{AXES}centerings: cell cell cell\naxis mins: 1 2 3\n")
))  # fmt: skip
add("NRRD", "centerings", "node", lambda folder: Truth(
    nrrd(folder, f"{AXES}centerings: node node node\naxis mins: 1 2 3\n"), origin=(1, 2, 3)
))  # fmt: skip
add("NRRD", "centerings", "two", lambda folder: nrrd(
    folder, f"{AXES}centerings: node node\n"
), refused="its centers are 2, not one per axis")  # fmt: skip
add("NRRD", "axis maxs", "without spacings", lambda folder: by_itk(
    nrrd(folder, "axis mins: 1 2 3\naxis maxs: 5.5 4.5 13\n")
), told="axis maxs do not give it, as in ITK; no spacing is stated")  # fmt: skip
add("NRRD", "endian", "big", lambda folder: by_itk(
    nrrd(folder, f"{AXES}endian: big\n", VALUES.astype(">i2").tobytes())
))  # fmt: skip
add("NRRD", "byte skip", "-1", lambda folder: Truth(
    nrrd(folder, f"{AXES}byte skip: -1\n", b"junk" + VALUES.tobytes())
))  # fmt: skip
add("NRRD", "byte skip", "16", lambda folder: Truth(
    nrrd(folder, f"{AXES}byte skip: 16\n", bytes(16) + VALUES.tobytes())
))  # fmt: skip
add("NRRD", "line skip", "2", lambda folder: Truth(
    nrrd(folder, f"{AXES}line skip: 2\n", b"a\nb\n" + VALUES.tobytes())
))  # fmt: skip
for encoding, data in (
    ("ascii", " ".join(map(str, VALUES.ravel())).encode()),
    ("hex", VALUES.tobytes().hex().encode()),
    ("gzip", gzip.compress(VALUES.tobytes())),
    ("bzip2", bz2.compress(VALUES.tobytes())),
):
    add("NRRD", "encoding", encoding, lambda folder, encoding=encoding, data=data: Truth(
        nrrd(folder, AXES, data, encoding)
    ))  # fmt: skip
for word, unit, by in (
    ("mm", "mm", 1), ("cm", "mm", 10), ("m", "mm", 1000), ("inch", "mm", 25.4),
    ("um", "µm", 1), ("microns", "µm", 1), ("nm", "µm", 1e-3),
):  # fmt: skip
    add("NRRD", "space units", word, lambda folder, word=word, unit=unit, by=by: Truth(
        nrrd(folder, f'space: LPS\n{directions(STEPS)}space units: "{word}" "{word}" "{word}"\n'),
        spacing=by * SPACING, turn=TURN, unit=unit,
    ))  # fmt: skip
add("NRRD", "units", "um", lambda folder: Truth(
    nrrd(folder, f'{AXES}units: "um" "um" "um"\n'), unit="µm"
))  # fmt: skip
add("NRRD", "space units", "two", lambda folder: nrrd(
    folder, f'space: LPS\n{directions(STEPS)}space units: "mm" "mm" "um"\n'
), refused="lengths are in mm, mm, um; give one unit")  # fmt: skip
add("NRRD", "space units", "unknown", lambda folder: Truth(
    nrrd(folder, f'space: LPS\n{directions(STEPS)}space units: "ell" "ell" "ell"\n'), turn=TURN
), told="no unit of length is stated")  # fmt: skip
add("NRRD", "space units", "missing", lambda folder: Truth(
    nrrd(folder, f"space: LPS\n{directions(STEPS)}"), turn=TURN
), told="no unit of length is stated")  # fmt: skip
add("NRRD", "spacings", "nan along z", lambda folder: Truth(
    nrrd(folder, "spacings: 0.75 0.5 nan\n"), spacing=(0.75, 0.5, 1)
), told="no spacing along z is stated; 1 is assumed")  # fmt: skip
add("NRRD", "spacings", "missing", lambda folder: Truth(
    nrrd(folder, ""), spacing=(1, 1, 1)
), told="no spacing is stated")  # fmt: skip
add("NRRD", "spacings", "negative", lambda folder: nrrd(
    folder, "spacings: 0.75 0.5 -2.5\n"
), refused="must be positive and finite")  # fmt: skip
add("NRRD", "old min", "-1000, of quantized values", lambda folder: Truth(
    nrrd(folder, f"{AXES}old min: -1000\nold max: 3000\n")
), told="old min and old max are not applied")  # fmt: skip
add("NRRD", "sample units", "HU", lambda folder: Truth(
    nrrd(folder, f'{AXES}sample units: "HU"\n'), units="hu"
))  # fmt: skip

# MetaImage

MATRIX = f"TransformMatrix = {listed(TURN.T)}\n"
for field, case, fields in (
    ("TransformMatrix", "rotated", f"{MATRIX}Offset = -30 12 55\n"),
    ("TransformMatrix", "mirrored", "TransformMatrix = 1 0 0 0 1 0 0 0 -1\nOffset = 0 0 0\n"),
    ("CenterOfRotation", "1, 2, 3", f"{MATRIX}Offset = 1 2 3\nCenterOfRotation = 1 2 3\n"),
    ("Position", "for Offset", f"Position = 1 2 3\nRotation = {listed(TURN.T)}\n"),
    ("AnatomicalOrientation", "RAI", f"{MATRIX}Offset = 1 2 3\nAnatomicalOrientation = RAI\n"),
    ("AnatomicalOrientation", "LPS", f"{MATRIX}Offset = 1 2 3\nAnatomicalOrientation = LPS\n"),
    ("Comment", "a text", "Comment = scanned at night\n"),
):
    add("MetaImage", field, case, lambda folder, fields=fields: by_itk(metaimage(folder, fields)))
add("MetaImage", "BinaryDataByteOrderMSB", "True", lambda folder: by_itk(
    metaimage(folder, "BinaryDataByteOrderMSB = True\n", VALUES.astype(">i2").tobytes())
))  # fmt: skip
add("MetaImage", "HeaderSize", "16", lambda folder: Truth(
    metaimage(folder, "HeaderSize = 16\n", bytes(16) + VALUES.tobytes())
))  # fmt: skip
add("MetaImage", "HeaderSize", "-1", lambda folder: Truth(
    metaimage(folder, "HeaderSize = -1\n", bytes(23) + VALUES.tobytes())
))  # fmt: skip
add("MetaImage", "ElementSize", "for ElementSpacing", lambda folder: by_itk(
    metaimage(folder, f"ElementSize = {listed(SPACING)}\n", ElementSpacing="")
))  # fmt: skip
add("MetaImage", "ElementSpacing", "negative", lambda folder: metaimage(
    folder, "", ElementSpacing="0.75 0.5 -2.5"
), refused="must be positive and finite")  # fmt: skip
add("MetaImage", "ElementSpacing", "missing", lambda folder: Truth(
    metaimage(folder, "", ElementSpacing=""), spacing=(1, 1, 1)
), told="no spacing is stated")  # fmt: skip
add("MetaImage", "ElementToIntensityFunctionSlope", "2", lambda folder: by_itk(
    metaimage(folder, "ElementToIntensityFunctionSlope = 2\n")
), told="ElementToIntensityFunctionSlope is not applied")  # fmt: skip
for word, unit, by in (("mm", "mm", 1), ("um", "µm", 1), ("cm", "mm", 10)):
    add("MetaImage", "DistanceUnits", word, lambda folder, word=word, unit=unit, by=by: Truth(
        metaimage(folder, f"DistanceUnits = {word}\n"), spacing=by * SPACING, unit=unit
    ))  # fmt: skip
add("MetaImage", "DistanceUnits", "missing", lambda folder: Truth(
    metaimage(folder, "")
), told="no unit of length is stated")  # fmt: skip

# NIfTI


def quaternion(turn):
    """The numbers b, c, d of a rotation."""
    from scipy.spatial.transform import Rotation

    found = Rotation.from_matrix(turn).as_quat()
    return (found * (1 if found[3] >= 0 else -1))[:3]


def rows(steps, origin=(5, 6, 7)):
    """The rows of sform."""
    return np.column_stack([steps, origin])


def of_rows(path, steps, unit="mm", note=1.0):
    """What a file holds by sform, in LPS."""
    length = np.linalg.norm(steps, axis=0)
    origin = LPS @ (5.0, 6.0, 7.0) * note
    return Truth(path, spacing=length * note, origin=origin, turn=LPS @ steps / length, unit=unit)


TURNED = {"q": 1, "quaternion": quaternion(TURN), "offset": (5, 6, 7)}
for field, case, options in (
    ("qform_code", "1", TURNED),
    ("pixdim[0]", "-1", TURNED | {"pixdim": (-1, *SPACING)}),
    ("scl_slope", "2", TURNED | {"scale": (2, -1000)}),
    ("sizeof_hdr", "big-endian", TURNED | {"order": ">"}),
    ("qform_code", "0", {}),
    ("xyzt_units", "meter", TURNED | {"units": 1}),
    ("xyzt_units", "mm", TURNED | {"units": 2}),
    ("xyzt_units", "micron", TURNED | {"units": 3}),
    ("xyzt_units", "micron and seconds", TURNED | {"units": 3 | 8}),
    ("sform_code", "1, with qform", TURNED | {"s": 1, "rows": rows(STEPS)}),
):
    add("NIfTI", field, case, lambda folder, options=options: by_itk(nifti(folder, **options)))
add("NIfTI", "xyzt_units", "unknown", lambda folder: by_itk(
    nifti(folder, **TURNED, units=0)
), told="no unit of length is stated; mm are assumed")  # fmt: skip
MIRRORED = TURN @ np.diag([-0.75, 0.5, 2.5])
add("NIfTI", "sform_code", "1, mirrored", lambda folder: of_rows(
    nifti(folder, s=1, rows=rows(MIRRORED)), MIRRORED
))  # fmt: skip
add("NIfTI", "srow", "sheared", lambda folder: of_rows(
    nifti(folder, s=1, rows=rows(SHEAR)), SHEAR
), told="voxels are .* by sform, which is used, and .* by pixdim")  # fmt: skip
add("NIfTI", "srow", "other lengths than pixdim", lambda folder: of_rows(
    nifti(folder, s=1, rows=rows(2 * STEPS)), 2 * STEPS
), told="voxels are 1.5 x 1 x 5 by sform, which is used, and 0.75 x")  # fmt: skip
add("NIfTI", "srow", "micron", lambda folder: of_rows(
    nifti(folder, s=1, rows=rows(STEPS), units=3), STEPS, "µm"
))  # fmt: skip
add("NIfTI", "srow", "differs from qform", lambda folder: Truth(
    nifti(folder, **TURNED, s=2, rows=rows(turned(0.1, 0.9) * SPACING)),
    origin=LPS @ (5, 6, 7), turn=LPS @ TURN,
), told="sform and qform differ; qform is used")  # fmt: skip
add("NIfTI", "scl_slope", "nan", lambda folder: Truth(
    nifti(folder, **TURNED, scale=(math.nan, 5)), origin=LPS @ (5, 6, 7), turn=LPS @ TURN
), told="scl_slope nan and scl_inter 5 are not a scale")  # fmt: skip
for case, size in (("0", 0.0), ("negative", -2.5), ("nan", math.nan)):
    add("NIfTI", "pixdim", case, lambda folder, size=size: nifti(
        folder, **TURNED, pixdim=(1, 0.75, 0.5, size)
    ), refused="must be positive and finite")  # fmt: skip

# MRC and cubes

for field, case, options in (
    ("mode", "1", {}),
    ("mode", "6", {"values": COUNTS, "mode": 6}),
    ("mode", "12", {"values": VALUES.astype(np.float16), "mode": 12}),
    ("mode", "0, signed", {"values": (VALUES % 100 - 50).astype(np.int8), "mode": 0}),
    ("imodFlags", "unsigned", {"values": (VALUES & 255).astype(np.uint8), "mode": 0,
                               "imod": (1146047817, 2)}),
    ("machst", "big-endian", {"order": ">"}),
    ("nsymbt", "64", {"extended": 64}),
):  # fmt: skip
    add("MRC", field, case, lambda folder, options=options: Truth(
        mrc(folder, **options), options.get("values", VALUES), unit="Å"
    ))  # fmt: skip
add("MRC", "nxstart", "3, 4, 5", lambda folder: Truth(
    mrc(folder, start=(3, 4, 5)), origin=SPACING * (3, 4, 5), unit="Å"
))  # fmt: skip
add("MRC", "origin", "10, 20, 30", lambda folder: Truth(
    mrc(folder, origin=(10, 20, 30)), origin=(10, 20, 30), unit="Å"
))  # fmt: skip
for case, order in (("3, 2, 1", (2, 1, 0)), ("3, 1, 2", (2, 0, 1))):
    add("MRC", "mapc", case, lambda folder, order=order: Truth(
        mrc(
            folder, axes=tuple(axis + 1 for axis in order),
            cell=[(SPACING * (7, 6, 5))[order.index(axis)] for axis in range(3)],
            grid=tuple((7, 6, 5)[order.index(axis)] for axis in range(3)),
        ),
        turn=np.eye(3)[:, order], unit="Å",
    ))  # fmt: skip
OBLIQUE = np.array([[1, -0.5, 0], [0, math.sqrt(0.75), 0], [0, 0, 1]])
add("MRC", "cellb", "120 degrees", lambda folder: Truth(
    mrc(folder, angles=(90, 90, 120)), turn=OBLIQUE, unit="Å"
))  # fmt: skip
add("MRC", "cella", "0", lambda folder: Truth(
    mrc(folder, cell=(0, 0, 0)), spacing=(1, 1, 1)
), told="no spacing is stated")  # fmt: skip
add("MRC", "cella", "0 along z", lambda folder: Truth(
    mrc(folder, cell=(*(SPACING * (7, 6, 5))[:2], 0)), spacing=(0.75, 0.5, 1), unit="Å"
), told="no size of the cell along z: voxels of 1 Å are assumed")  # fmt: skip
BOHR = 0.529177210903


def cube(folder, sign):
    """A cube of Gaussian's."""
    head = (
        f"a\nb\n1 0 0 0\n{7 * sign} 0.75 0 0\n{6 * sign} 0 0.5 0\n{5 * sign} 0 0 2.5\n6 0 0 0 0\n"
    )
    values = VALUES.transpose(2, 1, 0).ravel()
    return saved(folder / "a.cube", head + "\n".join(map(str, values)) + "\n")


for case, sign, scale in (("in Bohr", 1, BOHR), ("in Å", -1, 1.0)):
    add("Cube", "numbers of voxels", case, lambda folder, sign=sign, scale=scale: Truth(
        cube(folder, sign), spacing=scale * SPACING, unit="Å"
    ))  # fmt: skip

# DICOM

CT = Truth(Path(), origin=ORIGIN, unit="mm", units="hu")
for field, case, tags, truth in (
    ("ImagePositionPatient", "not by names", {}, CT),
    ("InstanceNumber", "shuffled", {"numbers": (5, 3, 1, 2, 4)}, CT),
    ("ImageOrientationPatient", "oblique", {"turn": TURN}, CT._replace(turn=TURN)),
    ("RescaleSlope", "2", {"RescaleSlope": 2, "RescaleIntercept": -1024},
     CT._replace(values=VALUES * 2.0 - 1024)),
    ("RescaleSlope", "0.5", {"RescaleSlope": 0.5}, CT._replace(values=VALUES * 0.5)),
    ("RescaleType", "other than HU", {"RescaleType": "mg/ml"}, CT._replace(units="")),
    ("BitsStored", "12, junk above", {"values": (VALUES & 0xFFF).astype(np.uint16) | 0xA000,
     "BitsStored": 12, "HighBit": 11}, CT._replace(values=VALUES & 0xFFF)),
    ("PixelRepresentation", "12 bits with a sign", {"values": (VALUES & 0xFFF).astype(np.uint16),
     "BitsStored": 12, "HighBit": 11, "PixelRepresentation": 1}, CT),
    ("PhotometricInterpretation", "MONOCHROME1, no HU", {"PhotometricInterpretation": "MONOCHROME1",
     "Modality": "MR"}, CT._replace(values=-1 - VALUES, units="")),
):  # fmt: skip
    add("DICOM", field, case, lambda folder, tags=tags, truth=truth: truth._replace(
        path=dicom(folder, **tags)
    ))  # fmt: skip
add("DICOM", "PhotometricInterpretation", "MONOCHROME1, HU", lambda folder: CT._replace(
    path=dicom(folder, PhotometricInterpretation="MONOCHROME1")
), told="MONOCHROME1: low values are meant to be white")  # fmt: skip
add("DICOM", "ModalityLUTSequence", "a table", lambda folder: CT._replace(
    path=dicom(folder, ModalityLUTSequence=[])
), told="ModalityLUTSequence is not applied")  # fmt: skip
add("DICOM", "ImagePositionPatient", "a slice missing", lambda folder: CT._replace(
    path=dicom(folder, gap=(0, 1, 2, 4, 5)), values=None
), told="is a slice missing")  # fmt: skip
add("DICOM", "ImagePositionPatient", "twice", lambda folder: dicom(
    folder, gap=(0, 1, 1, 2, 3)
), refused="there twice")  # fmt: skip
NOWHERE = {"ImagePositionPatient": None, "ImageOrientationPatient": None}
add("DICOM", "SpacingBetweenSlices", "without positions", lambda folder: CT._replace(
    path=dicom(folder, **NOWHERE, SpacingBetweenSlices=2.5), values=None
))  # fmt: skip
add("DICOM", "SliceThickness", "missing, without positions", lambda folder: CT._replace(
    path=dicom(folder, **NOWHERE, SliceThickness=None), values=None
), told="no distance of slices is stated; 1 mm is assumed")  # fmt: skip
add("DICOM", "PixelSpacing", "missing", lambda folder: CT._replace(
    path=dicom(folder, PixelSpacing=None), spacing=(1, 1, 2.5), unit=""
), told="no spacing is stated")  # fmt: skip
add("DICOM", "ImagerPixelSpacing", "for PixelSpacing", lambda folder: CT._replace(
    path=dicom(folder, PixelSpacing=None, ImagerPixelSpacing=[0.5, 0.75])
))  # fmt: skip

# VTK

PLACED = Truth(Path(), origin=(1, 2, 3))
for field, case, options, truth in (
    ("Origin", "1, 2, 3", {}, PLACED),
    ("WholeExtent", "not from 0", {"extent": "10 16 20 25 30 34"},
     PLACED._replace(origin=(1, 2, 3) + SPACING * (10, 20, 30))),
    ("Direction", "rotated", {"direction": TURN}, PLACED._replace(turn=TURN)),
    ("byte_order", "BigEndian", {"order": ">"}, PLACED),
    ("CellData", "cells", {"extent": "0 7 0 6 0 5", "of_cells": True},
     PLACED._replace(origin=(1, 2, 3) + SPACING / 2)),
):  # fmt: skip
    add("VTI", field, case, lambda folder, options=options, truth=truth: truth._replace(
        path=vti(folder, **options)
    ))  # fmt: skip
add("VTI", "Spacing", "negative", lambda folder: vti(
    folder, spacing=(0.75, 0.5, -2.5)
), refused="must be positive and finite")  # fmt: skip
add("VTI", "unit", "none in the format", lambda folder: PLACED._replace(
    path=vti(folder)
), told="no unit of length is stated")  # fmt: skip
add("VTK", "SPACING", "0.75, 0.5, 2.5", lambda folder: PLACED._replace(path=vtk(folder)))
add("VTK", "ASPECT_RATIO", "for SPACING", lambda folder: PLACED._replace(
    path=vtk(folder, "ORIGIN 1 2 3\nASPECT_RATIO 0.75 0.5 2.5\n")
))  # fmt: skip
add("VTK", "SPACING", "negative", lambda folder: vtk(
    folder, "ORIGIN 1 2 3\nSPACING 0.75 0.5 -2.5\n"
), refused="must be positive and finite")  # fmt: skip

# Arrays


def npy(folder, values):
    """An array in a file."""
    np.save(folder / "a.npy", values)
    return Truth(folder / "a.npy", values, spacing=(1, 1, 1))


add("NPY", "descr", "big-endian", lambda folder: npy(folder, VALUES.astype(">i2")))
add("NPY", "fortran_order", "True", lambda folder: npy(folder, np.asfortranarray(VALUES)))
add("NPY", "spacing", "none in the format", lambda folder: npy(folder, VALUES),
    told="no spacing is stated; voxels of 1 x 1 x 1 are assumed")  # fmt: skip
for case, name, values in (
    ("sizes and type", "a_7x6x5_int16.raw", VALUES),
    ("big-endian", "a.raw", VALUES.astype(">i2")),
):
    add("RAW", "name", case, lambda folder, name=name, values=values: Truth(
        saved(folder / name, values.tobytes()), spacing=(1, 1, 1)
    ), told="no spacing is stated")  # fmt: skip


def npz(folder, z):
    """Planes and values in a file."""
    np.savez(folder / "a.npz", x=0.75 * np.arange(7), y=0.5 * np.arange(6), z=z, v=VALUES)
    return Truth(folder / "a.npz")


add("NPZ", "x, y, z", "even", lambda folder: npz(folder, 2.5 * np.arange(5)))
add("NPZ", "x, y, z", "uneven", lambda folder: npz(folder, np.array([0, 1, 2, 4, 5]))._replace(
    values=None
), told="were interpolated onto an even lattice")  # fmt: skip

# OME-Zarr

MICRONS = Truth(Path(), unit="µm")
for field, case, options, truth in (
    ("scale", "2.5, 0.5, 0.75", {}, MICRONS),
    ("translation", "3, 2, 1", {"more": [{"type": "translation", "translation": [3, 2, 1]}]},
     MICRONS._replace(origin=(1, 2, 3))),
    ("translation", "before a scale of the image", {
        "more": [{"type": "translation", "translation": [3, 2, 1]}],
        "image": {"coordinateTransformations": [{"type": "scale", "scale": [2, 2, 2]}]}},
     MICRONS._replace(spacing=2 * SPACING, origin=(2, 4, 6))),
    ("axes", "x, y, z", {"values": VALUES.T.copy(), "axes": "xyz", "scale": SPACING}, MICRONS),
    ("axes", "t, c, z, y, x", {"values": VALUES[None, None], "axes": "tczyx",
     "scale": (1, 1, *SPACING[::-1])}, MICRONS),
    ("dtype", "big-endian", {"values": VALUES.astype(">i2")}, MICRONS),
    ("unit", "nanometer", {"units": ("nanometer",) * 3}, MICRONS._replace(spacing=SPACING / 1000)),
    ("unit", "angstrom", {"units": ("angstrom",) * 3}, MICRONS._replace(spacing=SPACING / 10000)),
    ("unit", "millimeter", {"units": ("millimeter",) * 3}, MICRONS._replace(unit="mm")),
    ("unit", "meter", {"units": ("meter",) * 3},
     MICRONS._replace(spacing=SPACING * 1000, unit="mm")),
    ("unit", "z in millimeter", {"units": ("millimeter", "micrometer", "micrometer")},
     MICRONS._replace(spacing=SPACING * (1, 1, 1000))),
):  # fmt: skip
    add("OME-Zarr", field, case, lambda folder, options=options, truth=truth: truth._replace(
        path=ome_zarr(folder, **options)
    ))  # fmt: skip
add("OME-Zarr", "unit", "missing", lambda folder: MICRONS._replace(
    path=ome_zarr(folder, units=()), unit=""
), told="no unit of length is stated")  # fmt: skip
add("OME-Zarr", "unit", "parsec along z", lambda folder: ome_zarr(
    folder, units=("parsec", "micrometer", "micrometer")
), refused="lengths along z are in parsec, along x in micrometer")  # fmt: skip
add("OME-Zarr", "omero", "no color", lambda folder: ome_zarr(
    folder, omero={"channels": [{"color": "tomato"}]}
), refused="omero: channels.0.color")  # fmt: skip

# OME-TIFF and TIFF


def by_tifffile(path, unit="µm", by=1.0):
    """What tifffile reads: values in the order of axes, and sizes by its own parser of XML."""
    with tifffile.TiffFile(path) as file:
        values = file.series[0].asarray()
        pixels = tifffile.xml2dict(file.ome_metadata)["OME"]["Image"]["Pixels"]
    spacing = by * np.array([pixels[f"PhysicalSize{axis}"] for axis in "XYZ"])
    return Truth(path, values, spacing, unit=unit)


add("OME-TIFF", "PhysicalSize", "without a unit", lambda folder: by_tifffile(ome_tiff(folder)))
for word, unit, by in (
    ("nm", "µm", 1e-3), ("µm", "µm", 1), ("mm", "mm", 1), ("cm", "mm", 10), ("m", "mm", 1000),
    ("Å", "µm", 1e-4), ("in", "mm", 25.4),
):  # fmt: skip
    add("OME-TIFF", "PhysicalSizeUnit", word, lambda folder, word=word, unit=unit, by=by:
        by_tifffile(ome_tiff(folder, **{f"PhysicalSize{a}Unit": word for a in "XYZ"}), unit, by)
    )  # fmt: skip
add("OME-TIFF", "PhysicalSizeUnit", "z in mm", lambda folder: Truth(
    ome_tiff(folder, PhysicalSizeZ=0.0025, PhysicalSizeZUnit="mm"), COUNTS, unit="µm"
))  # fmt: skip
add("OME-TIFF", "PhysicalSizeUnit", "pixel", lambda folder: Truth(
    ome_tiff(folder, **{f"PhysicalSize{axis}Unit": "pixel" for axis in "XYZ"}), COUNTS
), told="no unit of length is stated")  # fmt: skip
add("OME-TIFF", "PhysicalSize", "missing", lambda folder: Truth(
    tiff(folder, COUNTS, ome=True, metadata={"axes": "ZYX"}), COUNTS, spacing=(1, 1, 1)
), told="no spacing is stated")  # fmt: skip
XML = (
    '<?xml version="1.0" encoding="UTF-8"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/'
    '2016-06"><Image ID="Image:0"><Pixels DimensionOrder="{}" SizeX="7" SizeY="6" {}>{}</Pixels>'
    "</Image></OME>"
)
SIZES = 'PhysicalSizeX="0.75" PhysicalSizeY="0.5" '
FIVE = f'{SIZES}PhysicalSizeZ="2.5" SizeZ="5" SizeC="1" SizeT="1"'
add("OME-TIFF", "PhysicalSizeZ", "missing", lambda folder: Truth(
    described(folder, XML.format("XYZCT", f'{SIZES}SizeZ="5" SizeC="1" SizeT="1"', "")), COUNTS,
    spacing=(0.75, 0.5, 0.75), unit="µm",
), told="no distance of slices is stated")  # fmt: skip
NANOMETERS = FIVE.replace('"2.5"', '""').replace('PhysicalSizeZ="" ', "")
NANOMETERS += ' PhysicalSizeXUnit="nm" PhysicalSizeYUnit="nm"'
add("OME-TIFF", "PhysicalSizeZ", "missing, others in nm", lambda folder: Truth(
    described(folder, XML.format("XYZCT", NANOMETERS, "")), COUNTS,
    spacing=(0.00075, 0.0005, 0.00075), unit="µm",
), told="no distance of slices is stated")  # fmt: skip
add("OME-TIFF", "PhysicalSize", "0", lambda folder: described(
    folder, XML.format("XYZCT", FIVE.replace("2.5", "0"), "")
), refused="voxels of 0.75 x 0.5 x 0")  # fmt: skip
BACKWARD = "".join(f'<TiffData IFD="{n}" FirstZ="{4 - n}" PlaneCount="1"/>' for n in range(5))
add("OME-TIFF", "TiffData", "pages backward", lambda folder: Truth(
    described(folder, XML.format("XYZCT", FIVE, BACKWARD)), COUNTS[::-1], unit="µm"
))  # fmt: skip
add("OME-TIFF", "TiffData", "a page twice", lambda folder: described(
    folder, XML.format("XYZCT", FIVE, BACKWARD.replace('IFD="0"', 'IFD="1"'))
), refused="names a page twice")  # fmt: skip
add("OME-TIFF", "SizeZ", "more than there are", lambda folder: described(
    folder, XML.format("XYZCT", FIVE.replace('SizeZ="5"', 'SizeZ="9"'), "")
), refused="has 5 pages and says that they are")  # fmt: skip
add("OME-TIFF", "BinaryOnly", "sizes in another file", lambda folder: Truth(
    described(folder, '<OME><BinaryOnly MetadataFile="a.companion.ome" UUID="a"/></OME>'), COUNTS,
    spacing=(1, 1, 1),
), told="its OME-XML holds no image, so that it states no sizes")  # fmt: skip
add("OME-TIFF", "Image", "two", lambda folder: described(
    folder, XML.format("XYZCT", FIVE, "").replace("</OME>", "") + XML.format(
        "XYZCT", FIVE, "").partition("2016-06\">")[2]
), refused="holds 2 images of OME")  # fmt: skip
add("OME-TIFF", "DOCTYPE", "with an entity", lambda folder: described(
    folder, '<!DOCTYPE a [<!ENTITY b "c">]>' + XML.format("XYZCT", FIVE, "")
), refused="DOCTYPE|defines")  # fmt: skip
MICRON_STACK = Truth(Path(), COUNTS, unit="µm")
for field, case, told, truth in (
    ("unit", "um", {}, MICRON_STACK),
    ("unit", "micron", {"unit": "micron"}, MICRON_STACK),
    ("unit", "\\u00B5m", {"unit": "\\u00B5m"}, MICRON_STACK),
    ("unit", "nm", {"unit": "nm"}, MICRON_STACK._replace(spacing=SPACING / 1000)),
    ("unit", "mm", {"unit": "mm"}, MICRON_STACK._replace(unit="mm")),
    ("unit", "inch", {"unit": "inch"}, MICRON_STACK._replace(spacing=25.4 * SPACING, unit="mm")),
    ("ResolutionUnit", "cm", {"unit": None, "resolutionunit": "CENTIMETER"},
     MICRON_STACK._replace(spacing=10 * SPACING, unit="mm")),
    ("zunit", "mm", {"spacing": 0.0025, "zunit": "mm"}, MICRON_STACK),
    ("xorigin", "10", {"xorigin": 10, "yorigin": 20, "zorigin": 2},
     MICRON_STACK._replace(origin=-SPACING * (10, 20, 2))),
    ("c0", "-32768", {"cf": 0, "c0": -32768, "c1": 1},
     MICRON_STACK._replace(values=COUNTS - 32768.0)),
):  # fmt: skip
    add("ImageJ TIFF", field, case, lambda folder, told=told, truth=truth: truth._replace(
        path=imagej(folder, **told)
    ))  # fmt: skip
add("ImageJ TIFF", "unit", "pixel", lambda folder: MICRON_STACK._replace(
    path=imagej(folder, unit="pixel"), unit=""
), told="no unit of length is stated")  # fmt: skip
add("ImageJ TIFF", "spacing", "missing", lambda folder: MICRON_STACK._replace(
    path=imagej(folder, spacing=None), spacing=(0.75, 0.5, 0.75)
), told="no distance of slices is stated")  # fmt: skip
add("ImageJ TIFF", "cf", "a curve", lambda folder: MICRON_STACK._replace(
    path=imagej(folder, cf=3, c0=1, c1=2)
), told="its calibration of values is not linear")  # fmt: skip
add("ImageJ TIFF", "slices", "more than there are", lambda folder: described(
    folder, "ImageJ=1.53t\nimages=9\nslices=9\n"
), refused="has 5 pages and says that they are")  # fmt: skip
add("TIFF", "XResolution", "per cm", lambda folder: Truth(
    tiff(folder, resolution=(1000, 1000), resolutionunit="CENTIMETER", metadata=None), COUNTS,
    spacing=(1, 1, 1),
), told="its resolution of 1000 x 1000 pixels per cm is not used")  # fmt: skip
for case, values in (("bytes", COUNTS.astype(np.uint8)), ("16 bits", COUNTS)):
    add("TIFF", "PhotometricInterpretation", f"MinIsWhite, {case}", lambda folder, values=values:
        Truth(tiff(folder, values, metadata=None, photometric="miniswhite"),
              np.iinfo(values.dtype).max - values, spacing=(1, 1, 1))
    )  # fmt: skip
add("TIFF", "Orientation", "6", lambda folder: Truth(
    tiff(folder, metadata=None, extratags=[(274, "H", 1, 6, False)]), COUNTS, spacing=(1, 1, 1)
), told="their orientation tag, 6, is not applied")  # fmt: skip
add("TIFF", "XResolution", "missing", lambda folder: Truth(
    tiff(folder, metadata=None), COUNTS, spacing=(1, 1, 1)
), told="no spacing is stated")  # fmt: skip


# Times and channels

FILMS = np.random.default_rng(7).integers(0, 60000, (2, 5, 3, 6, 7)).astype(np.uint16)  # t, z, c
BY_TIMES = FILMS.transpose(0, 2, 1, 3, 4)
COLORS = {"Name": ["a", "b", "c"], "Color": [0x0000FFFF, 0x00FF00FF, -16776961]}
LOOKS = tuple(ChannelLook(*pair) for pair in (("a", "#0000ff"), ("b", "#00ff00"), ("c", "#ff0000")))
for axes in ("TZC", "TCZ", "ZTC", "ZCT", "CTZ", "CZT"):
    add("OME-TIFF", "DimensionOrder", f"XY{axes[::-1]}", lambda folder, axes=axes: Truth(
        ome_tiff(folder, FILMS.transpose(*map("TZC".index, axes), 3, 4), f"{axes}YX"),
        BY_TIMES, unit="µm",
    ))  # fmt: skip
add("OME-TIFF", "Channel Color", "blue, green, red", lambda folder: Truth(
    ome_tiff(folder, FILMS, "TZCYX", Channel=COLORS), BY_TIMES, unit="µm", looks=LOOKS
))  # fmt: skip
add("ImageJ TIFF", "channels, slices, frames", "3, 5, 2", lambda folder: Truth(
    imagej(folder, FILMS, "TZCYX"), BY_TIMES, unit="µm"
))  # fmt: skip
FIVE_AXES = (1, 1, *SPACING[::-1])
SHOWN = [
    {"label": "a", "color": "0000FF", "window": {"start": 1, "end": 9}, "active": False},
    {"label": "b", "color": "00FF00"},
    {"label": "c", "color": "#ff000080"},
]
add("OME-Zarr", "omero", "color, window, active, label", lambda folder: Truth(
    ome_zarr(folder, BY_TIMES, axes="tczyx", scale=FIVE_AXES, omero={"channels": SHOWN}),
    BY_TIMES, unit="µm", looks=(ChannelLook("a", "#0000ff", (1, 9), False), *LOOKS[1:]),
))  # fmt: skip
add("OME-Zarr", "omero", "of a single channel", lambda folder: MICRONS._replace(
    path=ome_zarr(folder, omero={"channels": SHOWN[:1]})
), told="color #0000ff and window .1.0, 9.0. of its channel: not used")  # fmt: skip


@pytest.mark.parametrize("variant", VARIANTS, ids=str)
def test_a_field_is_obeyed_told_or_refused(variant, tmp_path):
    truth = variant.write(tmp_path)
    if variant.outcome == "refused":
        with pytest.raises(ValueError, match=variant.says) as caught:
            open_volume(truth)
        assert "\n" not in str(caught.value)
        return
    if np.ndim(truth.values) == 5:
        every = open_recording(truth.path)
        np.testing.assert_array_equal(every.values, truth.values)
        np.testing.assert_allclose(every.spacing, truth.spacing)
        assert every.looks == truth.looks
        return
    bare = truth.path.name == "a.raw"
    found = open_volume(truth.path, Raw("7x6x5", ">i2") if bare else None)
    if variant.outcome == "told":
        said = "; ".join([found.note, assumed(found)])
        assert re.search(variant.says, said), said
    if truth.values is not None:
        check_places(found, truth)
    assert truth.units in (None, found.units)


def check_places(found, truth):
    """Each voxel has the value of the true voxel at its place."""
    unit = unit_of_space(found)
    if truth.unit:
        assert unit == truth.unit
    by = ratio(unit, truth.unit or "mm") if unit else 1.0
    values = np.asarray(found.values)
    index = np.indices(values.shape[::-1]).reshape(3, -1)  # x, y, z
    steps = np.asarray(found.direction) * found.spacing
    places = by * (steps @ index + np.asarray(found.origin)[:, np.newaxis])
    true_steps = np.asarray(truth.turn) * truth.spacing
    at = np.linalg.solve(true_steps, places - np.asarray(truth.origin, float)[:, np.newaxis])
    voxel = np.rint(at).astype(int)
    assert np.abs(at - voxel).max() < 1e-4
    assert sorted(values.shape) == sorted(truth.values.shape)
    x, y, z = voxel
    np.testing.assert_array_equal(values[tuple(index[::-1])], np.asarray(truth.values)[z, y, x])
