"""Formats of neuroscience: MGH, MINC, Analyze and pairs of NIfTI."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from resample.reading.limits import check_unpacked
from resample.reading.native import damage, lacking, plain
from resample_formats.groups import SIGNATURE, dataset_in, group_in
from resample_formats.hdf5 import contents
from resample_volume.data.values import require_memory
from resample_volume.files.headers import (
    Check,
    OneOfAll,
    header,
    recording,
)
from resample_volume.files.nifti import TO_LPS
from resample_volume.types import Recording

PACKED = (".mgz", ".gz")
OF_MINC = ("minc-2.0", "image", "0")


@dataclass(frozen=True)
class Neuro(OneOfAll):
    """MGH and MGZ of FreeSurfer, MINC, Analyze 7.5 and pairs of NIfTI; in LPS, mm."""

    space: ClassVar[str] = "lps"
    suffixes: ClassVar[tuple[str, ...]] = (".mgh", ".mgz", ".mnc", ".hdr", ".img")

    def read(self, path: Path, name: str, check: Check) -> Recording:
        try:
            import nibabel
        except ImportError as error:
            raise lacking(path.name, "nibabel", error, "neuro") from None
        is_minc = path.suffix.lower() == ".mnc"
        if is_minc:
            _check_minc(path)
        with damage(path):
            image: Any
            if path.suffix.lower() == ".mgh":  # nibabel would leave the file open
                image = nibabel.MGHImage.from_bytes(path.read_bytes())
            else:
                image = nibabel.load(plain(path), **({} if is_minc else {"mmap": False}))
            shape, matrix = tuple(map(int, image.shape)), np.asarray(image.affine, np.float64)
            kind = np.dtype(image.get_data_dtype())
            slope = getattr(image.dataobj, "slope", 1.0), getattr(image.dataobj, "inter", 0.0)
        if is_minc:  # its axes are z, y, x
            shape, matrix = shape[::-1], matrix[:, [2, 1, 0, 3]]
        while len(shape) > 3 and shape[-1] == 1:
            shape = shape[:-1]
        is_scaled = is_minc or slope not in ((1.0, 0.0), (None, None))
        if is_scaled:
            kind = np.dtype(np.float32 if kind.itemsize <= 2 else np.float64)
        known = header(
            shape[:3],
            kind,
            name,
            origin=TO_LPS @ matrix[:3, 3],
            direction=TO_LPS @ matrix[:3, :3],
        )._replace(times=shape[3] if len(shape) > 3 else 1, length="mm")
        check(known)
        require_memory(known.size, name)
        if path.name.lower().endswith(PACKED):
            check_unpacked(path.name, path.stat().st_size, known.size)
        with damage(path):
            values = np.asarray(image.dataobj)
            values = (values.T if is_minc else values).reshape(*shape[:3], known.times)
        values = values.astype(kind.newbyteorder("="), copy=False)
        return recording(np.ascontiguousarray(values.T), known._replace(dtype=values.dtype))


def _check_minc(path: Path) -> None:
    """Reject MINC-2 files with the image in another file."""
    with path.open("rb") as raw:
        if raw.read(len(SIGNATURE)) != SIGNATURE:
            return
    with contents(path) as file:
        group = file
        for name in OF_MINC:
            group = group and group_in(path, group, name)
        if not group or dataset_in(path, group, "image") is None:
            raise ValueError("is not a MINC file: it has no minc-2.0/image/0/image")
