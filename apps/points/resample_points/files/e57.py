"""Read E57 scans (ASTM E2807) through pye57 (the extra `e57`).

All scans of a file are read, each moved by its pose to the file's coordinates.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.progress import report
from resample.reading.limits import check_ratio
from resample.reading.native import damage, lacking
from resample_points.data.cloud import COLORS, Cloud, cloud_of
from resample_points.data.columns import colored_as_scanned
from resample_points.data.parts import STEP, CloudBuilder, storage_for

SIGNATURE = b"ASTM-E57"
PLACES = ("cartesianX", "cartesianY", "cartesianZ")
ANGLES = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
INVALID = ("cartesianInvalidState", "sphericalInvalidState")  # 0: valid
LEVELS = ("colorRed", "colorGreen", "colorBlue")
POINT = 24  # bytes of a position
UNKNOWN = 0.5  # level of points of a scan without colors, where other scans have them


def read_e57(path: Path) -> Cloud:
    """Read all scans of an E57 file; without colors, points are gray by their intensity."""
    try:
        import pye57
        from pye57 import libe57
    except ImportError as error:
        raise lacking(path.name, "pye57", error, "e57") from None
    with path.open("rb") as file:
        if file.read(len(SIGNATURE)) != SIGNATURE:
            raise ValueError("is not an E57 file: it does not begin with ASTM-E57")
    with damage(path):
        image = libe57.ImageFile(str(path), "r")
    try:
        with damage(path):
            nodes = image.root()["data3D"]
            scans = [pye57.ScanHeader(nodes[n]) for n in range(len(nodes))]
            names = {name for scan in scans for name in scan.point_fields}
            count = sum(scan.point_count for scan in scans)
        check_ratio(path.name, path.stat().st_size, count * POINT)
        gathering, read = CloudBuilder(storage_for(count, path.name)), 0
        for scan in scans:
            for fields in _parts(path, libe57, image, scan):
                count_here = len(fields["x"])
                # Add columns that other scans of the file have.
                if names.issuperset(LEVELS) and "red" not in fields:
                    fields |= {name: np.full(count_here, UNKNOWN, np.float32) for name in COLORS[0]}
                if "intensity" in names and "intensity" not in fields:
                    fields["intensity"] = np.zeros(count_here)
                gathering.add(cloud_of(fields, 1.0))
                read += count_here
                report(read, count)
        return colored_as_scanned(gathering.cloud())
    finally:
        image.close()


def _parts(path: Path, libe57: Any, image: Any, scan: Any) -> Iterator[dict[str, NDArray[Any]]]:
    """Yield the columns of a scan's valid points, about `STEP` at a time; colors from 0 to 1."""
    known = (*PLACES, *ANGLES, *INVALID, *LEVELS, "intensity")
    names = [name for name in known if name in scan.point_fields]
    with damage(path):
        values = {name: np.zeros(STEP) for name in names}
        buffers = libe57.VectorSourceDestBuffer()
        for name in names:
            buffers.append(libe57.SourceDestBuffer(image, name, values[name], STEP, True, True))
        reader = scan.points.reader(buffers)
        spans = [_span(libe57, scan, name) for name in LEVELS if name in names]
    while True:
        with damage(path):
            count = reader.read()
            if not count:
                reader.close()
                return
            part = {name: column[:count].copy() for name, column in values.items()}
            fields = _fields(part, scan, spans)
        yield fields


def _fields(
    part: dict[str, NDArray[Any]], scan: Any, spans: list[tuple[float, float]]
) -> dict[str, NDArray[Any]]:
    """Return the columns of valid points by clouds' names."""
    if all(name in part for name in PLACES):
        own = np.stack([part[name] for name in PLACES], axis=1)
    elif all(name in part for name in ANGLES):
        away, azimuth, elevation = (part[name] for name in ANGLES)
        flat = away * np.cos(elevation)
        own = np.stack(
            [flat * np.cos(azimuth), flat * np.sin(azimuth), away * np.sin(elevation)], axis=1
        )
    else:
        raise ValueError(f"a scan has neither {', '.join(PLACES)} nor {', '.join(ANGLES)}")
    valid = np.ones(len(next(iter(part.values()))), np.bool_)
    for name in INVALID:
        valid &= part.get(name, np.zeros(1)) == 0
    place = own[valid] @ scan.rotation_matrix.T + scan.translation
    fields = dict(zip("xyz", place.T, strict=True))
    if len(spans) == len(LEVELS):
        for name, level, (low, high) in zip(COLORS[0], LEVELS, spans, strict=True):
            share = (part[level][valid] - low) / (high - low)
            fields[name] = share.astype(np.float32)
    if "intensity" in part:
        fields["intensity"] = part["intensity"][valid]
    return fields


def _span(libe57: Any, scan: Any, name: str) -> tuple[float, float]:
    """Return the levels of black and white: the scan's limits, or the range of the number."""
    if "colorLimits" in scan.scan_fields:
        limits = scan["colorLimits"]
        low, high = (float(limits[name + end].value()) for end in ("Minimum", "Maximum"))
    else:
        own = libe57.StructureNode(scan.points.prototype())[name]
        is_scaled = hasattr(own, "scaledMinimum")
        ends = ("scaledMinimum", "scaledMaximum") if is_scaled else ("minimum", "maximum")
        low, high = (float(getattr(own, end)()) for end in ends)
    return (low, high) if low < high < 1e6 else (0.0, 1.0)
