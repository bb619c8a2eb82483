"""Contents of files of clouds and 3D Gaussians, for `resample-points info`."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

QUANTILES = (0.01, 0.5, 0.99)


def facts_in(path: Path) -> dict[str, Any]:
    """Return a file's contents, as JSON values."""
    from resample_points.data.columns import MEANINGS, SCANNED
    from resample_points.data.harmonics import COUNTS
    from resample_points.files.gaussians.formats import is_gaussians, read_gaussians
    from resample_points.files.readers import LASER, read_cloud

    if is_gaussians(path):
        gaussians = read_gaussians(path)
        sizes = gaussians.scale.max(axis=1)
        return {
            "kind": "3D Gaussians",
            "count": len(gaussians.opacity),
            "bounds": _bounds(gaussians.position),
            "degree": COUNTS.index(gaussians.harmonics.shape[1]),
            "antialiased": gaussians.is_antialiased,
            "up": gaussians.up,
            "opacity": _quantiles(gaussians.opacity),
            "largest deviation": _quantiles(sizes),
            "thinness": _quantiles(gaussians.scale.min(axis=1) / sizes),
        }
    cloud, ends = read_cloud(path), dict[str, list[float]]()
    for name, values in sorted(cloud.columns.items()):
        known = values[np.isfinite(values)] if values.dtype.kind == "f" else values
        ends[name] = _exact([known.min(), known.max()]) if known.size else []
    number = cloud.columns.get(SCANNED[1], np.zeros(0, np.uint8))
    classes = np.unique(number[np.isfinite(number)], return_counts=True)
    facts = {
        "kind": "points",
        "count": len(cloud.position),
        "bounds": _bounds(cloud.position),
        "normals": bool(len(cloud.normal)),
        "colors": bool(len(cloud.color)),
        "radii": bool(len(cloud.radius)),
        "columns": ends,
        "classes": {
            f"{n:g} {MEANINGS.get(n, '')}".strip(): int(count)
            for n, count in zip(*classes, strict=True)
        },
    }
    if path.suffix.lower() not in LASER:
        return facts
    from resample_points.files.las import coordinate_system_of

    system = coordinate_system_of(path)
    return {**facts, "crs": None if system is None else system.name}


def _bounds(position: NDArray[Any]) -> list[list[float]]:
    """Return the lowest and the highest corner."""
    if not len(position):
        return []
    return [_exact(position.min(axis=0)), _exact(position.max(axis=0))]


def _quantiles(values: NDArray[Any]) -> list[float]:
    """Return the 1 %, 50 % and 99 % quantile."""
    return [float(f"{number:.6g}") for number in np.quantile(values, QUANTILES)]


def _exact(numbers: Any) -> list[float]:
    """Return numbers with all significant digits: 15 for float64, fewer for others."""
    return [float(f"{n:.15g}" if n.dtype == np.float64 else str(n)) for n in numbers]
