"""NIfTI-1 and NIfTI-2 in one file (nifti.nimh.nih.gov), with positions as in ITK.

Its coordinates are RAS; they are converted to LPS, like other formats' coordinates. Of its two
transforms, the affine one (sform) is used if it is of the scanner, or the only one; spacings are
taken from pixdim, unless its columns have other lengths or are sheared.
"""

import gzip
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles
from resample_volume.data.recordings import in_unit, is_color, unit_of_space
from resample_volume.data.values import require_memory
from resample_volume.files.headers import (
    Check,
    OneOfAll,
    VolumeHeader,
    VoxelData,
    check_shape,
    first_bytes,
    header,
    recording,
    voxels,
)
from resample_volume.files.texts import is_hounsfield
from resample_volume.types import UNKNOWN, Recording, Volume

FIELDS = {  # name: NumPy's type in NIfTI-1, its place there, and both in NIfTI-2
    "size": ("i4", 0, "i4", 0),
    "dim": ("8i2", 40, "8i8", 16),
    "datatype": ("i2", 70, "i2", 12),
    "bitpix": ("i2", 72, "i2", 14),
    "pixdim": ("8f4", 76, "8f8", 104),
    "offset": ("f4", 108, "i8", 168),
    "slope": ("f4", 112, "f8", 176),
    "inter": ("f4", 116, "f8", 184),
    "units": ("u1", 123, "i4", 500),
    "qform": ("i2", 252, "i4", 344),
    "sform": ("i2", 254, "i4", 348),
    "quatern": ("3f4", 256, "3f8", 352),
    "qoffset": ("3f4", 268, "3f8", 376),
    "srow": ("(3,4)f4", 280, "(3,4)f8", 400),
    "intent": ("S16", 328, "S16", 508),
    "magic": ("S4", 344, "S8", 4),
}
LENGTHS = (348, 540)  # bytes of both headers


def _form(version: int) -> np.dtype[Any]:
    """Return the header of version 1 or 2 as a structured dtype."""
    held = {
        "names": list(FIELDS),
        "formats": [each[2 * version - 2] for each in FIELDS.values()],
        "offsets": [each[2 * version - 1] for each in FIELDS.values()],
        "itemsize": LENGTHS[version - 1],
    }
    return np.dtype(held)  # type: ignore[call-overload, no-any-return]


FORMS = (_form(1), _form(2))
TYPES = {2: "uint8", 4: "int16", 8: "int32", 16: "float32", 64: "float64", 256: "int8"}
TYPES |= {512: "uint16", 768: "uint32", 1024: "int64", 1280: "uint64"}
COLORS = {128: 3, 2304: 4}  # numbers of a color, each a byte
COMPLEX = (32, 1792, 2048)
CODES = {name: code for code, name in TYPES.items()}
SCANNER = 1  # coordinates of the scanner
UNITS = {1: ("mm", 1000.0), 2: ("mm", 1.0), 3: ("µm", 1.0)}
MILLIMETERS = 2
SAME = 1e-3  # of a voxel, by which transforms may differ
TO_LPS = np.diag([-1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Nifti(OneOfAll):
    """NIfTI-1 or -2 in a single file; slope and intercept are applied and give floats.

    Its coordinates are RAS; they are converted to LPS, like other formats' coordinates.
    """

    space: ClassVar[str] = "lps"
    suffixes: ClassVar[tuple[str, ...]] = (".nii", ".nii.gz")

    def read(self, path: Path, name: str, check: Check) -> Recording:
        start = first_bytes(path, LENGTHS[1])
        orders: tuple[Literal["<", ">"], ...] = ("<", ">")
        fields: Any = None  # of either version, in either order of bytes
        for form, length, magic in zip(FORMS, LENGTHS, (b"n+1", b"n+2"), strict=True):
            for order in orders if len(start) >= length and fields is None else ():
                found = np.frombuffer(start, form.newbyteorder(order), 1)[0]
                if found["size"] == length and bytes(found["magic"]).startswith(magic):
                    fields = found
        if fields is None:
            told = "is not a NIfTI file of one piece, or its header is cut off"
            raise ValueError(f"{path.name} {told}")
        known = _header(fields, path, name)
        check(known)
        offset = int(fields["offset"])
        if path.name.lower().endswith(".gz"):
            stored = VoxelData([path], 0, "gzip", offset, is_exact=False)
        else:
            stored = VoxelData([path], offset, is_exact=False)
        values = _scaled(voxels(stored, known), fields, name)
        known = known._replace(dtype=values.dtype)
        if int(fields["datatype"]) in COLORS:
            return recording(values, known)
        every = values.reshape(known.parts, known.times, *known.shape[::-1])
        return recording(every.swapaxes(0, 1), known, channels_first=True)


def write_nifti(path: Path, volume: Volume, *, is_packed: bool) -> None:
    """Write a volume with its geometry as NIfTI-1."""
    volume, kind = in_unit(volume, "mm"), volume.values.dtype
    steps = TO_LPS @ volume.direction
    sign = -1.0 if np.linalg.det(steps) < 0 else 1.0
    origin = TO_LPS @ volume.origin
    head = np.zeros((), FORMS[0].newbyteorder("<"))
    head["size"], head["magic"], head["offset"] = LENGTHS[0], b"n+1", 352
    head["dim"] = (3, *volume.values.shape[::-1], 1, 1, 1, 1)
    head["datatype"], head["bitpix"] = CODES[kind.name], 8 * kind.itemsize
    head["pixdim"] = (sign, *volume.spacing, 0, 0, 0, 0)
    head["slope"], head["units"] = 1, MILLIMETERS if unit_of_space(volume) else 0
    head["qform"] = head["sform"] = SCANNER
    # (b, c, d) of the unit quaternion of a rotation
    from scipy.spatial.transform import Rotation

    b, c, d, a = Rotation.from_matrix(steps * (1, 1, sign)).as_quat()
    head["quatern"] = np.array([b, c, d]) * (-1.0 if a < 0 else 1.0)
    head["qoffset"] = origin
    head["srow"] = np.column_stack([steps * volume.spacing, origin])
    with path.open("wb") as file:
        target: Any = gzip.GzipFile("", "wb", 6, file, mtime=0) if is_packed else file
        target.write(head.tobytes() + bytes(4))
        for plane in volume.values:
            target.write(np.ascontiguousarray(plane, kind.newbyteorder("<")).data)
        if is_packed:
            target.close()


def _header(fields: Any, path: Path, name: str) -> VolumeHeader:
    count = int(fields["dim"][0])
    if not 1 <= count <= 7:
        raise ValueError(f"{path.name} has {count} dimensions; there are 1 to 7")
    size = tuple(int(each) for each in fields["dim"][1 : 1 + count])
    while len(size) > 3 and size[-1] == 1:
        size = size[:-1]
    if len(size) not in (3, 4, 5):
        check_shape(size, name)
    if min(size) < 1:
        raise ValueError(f"{path.name} is empty: {size} voxels; every dimension must be over 0")
    code, shape = int(fields["datatype"]), (*size, 1, 1)
    if code in COMPLEX:
        raise ValueError(
            f"{path.name} has voxels of complex numbers; a volume has one real number per voxel: "
            "extract a component"
        )
    if code not in TYPES and code not in COLORS:
        raise ValueError(f"{path.name} has voxels of the unknown type {code}; convert the volume")
    kind, parts = np.dtype(TYPES.get(code, "uint8")), COLORS.get(code, 1)
    if int(fields["bitpix"]) != 8 * kind.itemsize * parts:
        raise ValueError(f"{path.name} is damaged: bitpix {int(fields['bitpix'])} of type {code}")
    offset = float(fields["offset"])
    if not LENGTHS[0] <= offset < 1 << 40:
        raise ValueError(f"{path.name}: its voxels begin at {offset:g}; correct vox_offset")
    (spacing, origin, direction), note = _place(fields)
    unit, by = UNITS.get(int(fields["units"]) & 7, (UNKNOWN, 1.0))
    spacing, origin = by * spacing, by * origin
    slope, inter = float(fields["slope"]), float(fields["inter"])
    if not math.isfinite(slope) or not math.isfinite(inter):
        note.append(
            f"scl_slope {slope:g} and scl_inter {inter:g} are not a scale: values are as stored"
        )
    known = header(size[:3], kind, name, spacing=spacing, origin=origin, direction=direction)
    order: Literal["<", ">"] = ">" if fields.dtype["dim"].base.byteorder == ">" else "<"
    parts = parts if code in COLORS else shape[4]
    return known._replace(
        dtype=known.dtype.newbyteorder(order),
        times=shape[3],
        parts=parts,
        is_color=code in COLORS or is_color((parts,), known.dtype),
        pixel=f"vector of {kind.name}",
        units="hu" if is_hounsfield(fields["intent"].split(b"\0")[0].decode("latin-1")) else "",
        length=unit,
        note="; ".join(note),
    )


def _place(fields: Any) -> tuple[tuple[Doubles, Doubles, Doubles], list[str]]:
    """Return spacing, origin and direction, LPS; and the choice made, for messages."""
    spacing = np.array([float(str(size)) for size in fields["pixdim"][1:4]])  # 0.65, not 0.64999998
    affine = np.array(fields["srow"], np.float64)
    q, s = int(fields["qform"]), int(fields["sform"])
    length = np.linalg.norm(affine[:, :3], axis=0)
    steps = affine[:, :3] / np.where(length > 0, length, 1)
    is_right_angled = np.allclose(steps.T @ steps, np.eye(3), atol=SAME)
    of_s = (length, TO_LPS @ affine[:, 3], TO_LPS @ steps)
    sign = -1.0 if fields["pixdim"][0] < 0 else 1.0
    quaternion = np.array(fields["quatern"], np.float64)
    # The matrix of a unit quaternion, given without its non-negative real part
    b, c, d = quaternion
    rest = 1 - b * b - c * c - d * d
    if rest < 1e-7:
        b, c, d = quaternion / max(float(np.linalg.norm(quaternion)), 1e-30)
        rest = 0.0
    a = math.sqrt(rest)
    turned = np.array(
        [
            [a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)],
            [2 * (b * c + a * d), a * a + c * c - b * b - d * d, 2 * (c * d - a * b)],
            [2 * (b * d - a * c), 2 * (c * d + a * b), a * a + d * d - b * b - c * c],
        ]
    ) * (1, 1, sign)
    of_q = (spacing, TO_LPS @ np.array(fields["qoffset"], np.float64), TO_LPS @ turned)
    if s > 0 and (q <= 0 or (s == SCANNER and is_right_angled)):
        is_valid = np.isfinite(spacing).all() and (spacing > 0).all()
        if not is_valid or np.allclose(length, spacing, rtol=SAME, atol=0):
            return (spacing, *of_s[1:]), []
        told = [" x ".join(f"{step:.6g}" for step in steps_) for steps_ in (length, spacing)]
        return of_s, [f"voxels are {told[0]} by sform, which is used, and {told[1]} by pixdim"]
    if q <= 0:
        return (spacing, np.zeros(3), np.eye(3)), []
    differs = s > 0 and not all(
        np.allclose(one, other, atol=SAME * spacing.max(), rtol=0)
        for one, other in ((of_s[1], of_q[1]), (of_s[0] * of_s[2], spacing * of_q[2]))
    )
    return of_q, ["sform and qform differ; qform is used, as by ITK"] * differs


def _scaled(values: NDArray[Any], fields: Any, name: str) -> NDArray[Any]:
    """Apply slope and intercept, to floats; unchanged if there is nothing to do."""
    slope, inter = float(fields["slope"]), float(fields["inter"])
    if not math.isfinite(slope) or not math.isfinite(inter):
        return values
    slope = slope or 1.0
    if (slope, inter) == (1, 0) or int(fields["datatype"]) in COLORS:
        return values
    kind = np.dtype(np.float64 if values.dtype.itemsize > 4 else np.float32)
    require_memory(values.size * kind.itemsize, name)
    found = np.empty(values.size, kind)
    for start in range(0, values.size, 1 << 20):
        part = slice(start, start + (1 << 20))
        found[part] = values[part].astype(np.float64) * slope + inter
    return found
