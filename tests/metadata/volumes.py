"""Tiny volume files, written byte by byte, with a known place of every voxel."""

import base64
import struct
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

VALUES = np.random.default_rng(7).integers(-900, 1800, (5, 6, 7)).astype(np.int16)  # z, y, x
COUNTS = (VALUES + 1000).astype(np.uint16)
SPACING, ORIGIN = np.array([0.75, 0.5, 2.5]), np.array([-30.0, 12.0, 55.0])
LPS = np.diag([-1.0, -1.0, 1.0])  # from RAS, and back


def turned(about_z: float, about_x: float) -> np.ndarray:
    """A rotation."""
    a, b, c, d = np.cos(about_z), np.sin(about_z), np.cos(about_x), np.sin(about_x)
    first = np.array([[a, -b, 0], [b, a, 0], [0, 0, 1]])
    return first @ np.array([[1, 0, 0], [0, c, -d], [0, d, c]])


TURN = turned(0.4, 0.3)


class Truth(NamedTuple):
    """What a file holds."""

    path: Path
    values: Any = VALUES  # (Z, Y, X) or (T, C, Z, Y, X); None: not compared, nor are places
    spacing: Any = SPACING
    origin: Any = (0.0, 0.0, 0.0)
    turn: Any = np.eye(3)
    unit: str = ""  # of lengths; empty: not compared, mm
    units: str | None = None  # of values; None: not compared
    looks: Any = ()  # of channels


def saved(path: Path, content: bytes | str) -> Path:
    """The path of a file with a content."""
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def listed(numbers: Any) -> str:
    """Numbers with blanks between them."""
    return " ".join(f"{number:.9f}" for number in np.ravel(numbers))


def nrrd(folder: Path, fields: str, data: bytes = VALUES.tobytes(), encoding: str = "raw") -> Path:
    """A NRRD of short integers with the given further fields."""
    order = "" if "endian" in fields else "endian: little\n"
    head = f"NRRD0005\ntype: short\ndimension: 3\nsizes: 7 6 5\n{order}{fields}"
    return saved(folder / "a.nrrd", f"{head}encoding: {encoding}\n\n".encode() + data)


def directions(steps: np.ndarray) -> str:
    """The field of NRRD, of a matrix whose columns are the steps."""
    vectors = (f"({','.join(f'{step:.9f}' for step in column)})" for column in steps.T)
    return f"space directions: {' '.join(vectors)}\n"


def metaimage(folder: Path, fields: str, data: bytes = VALUES.tobytes(), **other: str) -> Path:
    """A MetaImage of short integers with the given further fields."""
    lines = {
        "ObjectType": "Image",
        "NDims": "3",
        "DimSize": "7 6 5",
        "ElementSpacing": listed(SPACING),
        **other,
        "ElementType": "MET_SHORT",
        "ElementDataFile": "a.raw",
    }
    saved(folder / "a.raw", data)
    end = f"{fields}ElementType = {lines.pop('ElementType')}\nElementDataFile = a.raw\n"
    del lines["ElementDataFile"]
    text = "".join(f"{key} = {value}\n" for key, value in lines.items() if value)
    return saved(folder / "a.mhd", text + end)


def nifti(
    folder: Path,
    *,
    pixdim: tuple[float, ...] = (1, *SPACING),
    q: int = 0,
    s: int = 0,
    quaternion: Any = (0, 0, 0),
    offset: Any = (0, 0, 0),
    rows: Any = None,
    scale: tuple[float, float] = (0, 0),
    units: int = 2,
    order: str = "<",
) -> Path:
    """A NIfTI-1 of short integers."""
    head = bytearray(348)
    for place, form, numbers in (
        (0, "i", (348,)),
        (40, "8h", (3, 7, 6, 5, 1, 1, 1, 1)),
        (70, "2h", (4, 16)),
        (76, "8f", (*pixdim, 1, 1, 1, 1)),
        (108, "3f", (352, *scale)),
        (252, "2h", (q, s)),
        (256, "6f", (*quaternion, *offset)),
        (280, "12f", np.zeros(12) if rows is None else np.ravel(rows)),
    ):
        struct.pack_into(order + form, head, place, *numbers)
    head[123], head[344:348] = units, b"n+1\0"
    data = VALUES.astype(VALUES.dtype.newbyteorder(order)).tobytes()
    return saved(folder / "a.nii", bytes(head) + bytes(4) + data)


def mrc(
    folder: Path,
    values: np.ndarray = VALUES,
    *,
    mode: int = 1,
    cell: Any = SPACING * (7, 6, 5),
    axes: tuple[int, ...] = (1, 2, 3),
    start: tuple[int, ...] = (0, 0, 0),
    origin: tuple[float, ...] = (0, 0, 0),
    order: str = "<",
    angles: tuple[float, ...] = (90, 90, 90),
    grid: tuple[int, ...] = (7, 6, 5),
    extended: int = 0,
    imod: tuple[int, int] = (0, 0),
) -> Path:
    """A map of MRC2014."""
    head = bytearray(1024)
    for place, form, numbers in (
        (0, "4i", (*values.shape[::-1], mode)),
        (16, "6i", (*start, *grid)),
        (40, "6f", (*cell, *angles)),
        (64, "3i", axes),
        (88, "2i", (1, extended)),
        (152, "2i", imod),
        (196, "3f", origin),
    ):
        struct.pack_into(order + form, head, place, *numbers)
    head[208:216] = b"MAP " + (b"\x44\x44\0\0" if order == "<" else b"\x11\x11\0\0")
    data = values.astype(values.dtype.newbyteorder(order)).tobytes()
    return saved(folder / "a.mrc", bytes(head) + b"e" * extended + data)


def dicom(folder: Path, values: np.ndarray = VALUES, **tags: Any) -> Path:
    """A series of CT whose names are in no order; a tag that is None is left out.

    `gap`: numbers of slices by which they lie apart; `turn`: their axes.
    """
    from pydicom.dataset import Dataset, FileMetaDataset
    from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian

    gap, turn = tags.pop("gap", range(5)), tags.pop("turn", np.eye(3))
    numbers = tags.pop("numbers", range(5))
    for z in range(5):
        made = Dataset()
        made.file_meta = FileMetaDataset()
        made.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
        made.file_meta.MediaStorageSOPClassUID = made.SOPClassUID = CTImageStorage
        made.file_meta.MediaStorageSOPInstanceUID = made.SOPInstanceUID = f"1.2.8.{z + 1}"
        place = ORIGIN + turn[:, 2] * SPACING[2] * gap[z]
        told = {
            "SeriesInstanceUID": "1.2.3",
            "StudyInstanceUID": "1.2.9",
            "Modality": "CT",
            "InstanceNumber": numbers[z],
            "Rows": 6,
            "Columns": 7,
            "PixelSpacing": [SPACING[1], SPACING[0]],
            "SliceThickness": 1.0,
            "ImagePositionPatient": [f"{number:.9f}" for number in place],
            "ImageOrientationPatient": [f"{number:.9f}" for number in turn[:, :2].T.ravel()],
            "BitsAllocated": 16,
            "BitsStored": 16,
            "HighBit": 15,
            "PixelRepresentation": int(values.dtype.kind == "i"),
            "SamplesPerPixel": 1,
            "PhotometricInterpretation": "MONOCHROME2",
            "RescaleSlope": 1,
            "RescaleIntercept": 0,
        } | tags
        for key, value in told.items():
            if value is not None:
                setattr(made, key, value)
        made.PixelData = values[z].tobytes()
        made.save_as(folder / f"{'edbca'[z]}.dcm", enforce_file_format=True)
    return folder


def vti(folder: Path, extent: str = "0 6 0 5 0 4", *, order: str = "<", direction: Any = None,
        spacing: Any = SPACING, of_cells: bool = False) -> Path:  # fmt: skip
    """VTK's image data at points, or cells."""
    data = VALUES.astype(VALUES.dtype.newbyteorder(order)).tobytes()
    packed = base64.b64encode(struct.pack(f"{order}I", len(data)) + data).decode()
    name = "LittleEndian" if order == "<" else "BigEndian"
    turn = "" if direction is None else f'Direction="{listed(direction)}"'
    kind = "CellData" if of_cells else "PointData"
    return saved(
        folder / "a.vti",
        f'<?xml version="1.0"?><VTKFile type="ImageData" version="1.0" byte_order="{name}">'
        f'<ImageData WholeExtent="{extent}" Origin="1 2 3" Spacing="{listed(spacing)}" {turn}>'
        f'<Piece Extent="{extent}"><{kind} Scalars="s"><DataArray type="Int16" Name="s" '
        f'format="binary">{packed}</DataArray></{kind}></Piece></ImageData></VTKFile>',
    )


def vtk(folder: Path, place: str = "ORIGIN 1 2 3\nSPACING 0.75 0.5 2.5\n") -> Path:
    """VTK's legacy file of image data, big-endian."""
    head = (
        "# vtk DataFile Version 3.0\nx\nBINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS 7 6 5\n"
        f"{place}POINT_DATA 210\nSCALARS s short 1\nLOOKUP_TABLE default\n"
    )
    return saved(folder / "a.vtk", head.encode() + VALUES.astype(">i2").tobytes())


def ome_zarr(
    folder: Path,
    values: np.ndarray = VALUES,
    *,
    axes: str = "zyx",
    scale: Any = SPACING[::-1],
    units: tuple[str, ...] = ("micrometer",) * 3,
    image: dict[str, Any] | None = None,
    more: list[dict[str, Any]] | None = None,
    **attributes: Any,
) -> Path:
    """OME-Zarr 0.4."""
    import zarr

    group = zarr.open_group(folder / "a.ome.zarr", mode="w", zarr_format=2)
    group.create_array("0", data=values, chunks=values.shape)
    units_of = iter(units)
    kinds = {"t": "time", "c": "channel"}
    told = [{"name": axis, "type": kinds.get(axis, "space")} for axis in axes]
    for axis in told:
        if axis["type"] == "space" and (unit := next(units_of, "")):
            axis["unit"] = unit
    steps = [{"type": "scale", "scale": [float(step) for step in scale]}, *(more or [])]
    level = {"path": "0", "coordinateTransformations": steps}
    whole = {"version": "0.4", "axes": told, "datasets": [level], **(image or {})}
    group.attrs.update({"multiscales": [whole], **attributes})
    return folder / "a.ome.zarr"


def tiff(folder: Path, values: np.ndarray = COUNTS, **options: Any) -> Path:
    """A TIFF by tifffile."""
    import tifffile

    path = folder / ("a.ome.tif" if options.get("ome") else "a.tif")
    tifffile.imwrite(path, values, **options)
    return path


def ome_tiff(folder: Path, values: np.ndarray = COUNTS, axes: str = "ZYX", **told: Any) -> Path:
    """An OME-TIFF by tifffile, with attributes of its Pixels."""
    known = {f"PhysicalSize{axis}": float(SPACING[n]) for n, axis in enumerate("XYZ")}
    return tiff(folder, values, ome=True, metadata={"axes": axes, **known, **told})


def described(folder: Path, text: str, values: np.ndarray = COUNTS, **options: Any) -> Path:
    """A TIFF whose first page has a description."""
    return tiff(folder, values, description=text, metadata=None, **options)


def imagej(folder: Path, values: np.ndarray = COUNTS, axes: str = "ZYX", **told: Any) -> Path:
    """A TIFF by tifffile as ImageJ writes it."""
    steps = told.pop("resolution", (1 / SPACING[0], 1 / SPACING[1]))
    options = {key: told.pop(key) for key in ("resolutionunit",) if key in told}
    told = {"spacing": float(SPACING[2]), "unit": "um", **told}
    told = {key: value for key, value in told.items() if value is not None}
    return tiff(
        folder, values, imagej=True, resolution=steps, metadata={"axes": axes, **told}, **options
    )
