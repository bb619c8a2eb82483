"""Convert labeled arrays of xarray."""

from typing import Any

import numpy as np

from resample.types import Doubles
from resample_volume.data.rectilinear import rectilinear
from resample_volume.exchange.parts import check_whole
from resample_volume.types import Volume

AXES = ("z", "y", "x")


def of_labeled(given: Any, part: Any, name: str) -> Volume:
    """Convert an array of xarray's, or a variable of a data set, with its coordinates."""
    if hasattr(given, "data_vars"):
        given = _variable(given, part)
    else:
        check_whole(part, "an array of xarray's")
    dims = tuple(map(str, given.dims))
    named = {dim.lower(): dim for dim in dims}
    if len(dims) != 3 or (set(AXES) & set(named) and set(named) != set(AXES)):
        raise ValueError(
            f"a volume has the dimensions z, y and x, or three of other names, not "
            f"{', '.join(dims)}; take one of the others, such as .isel(time=0)"
        )
    order = tuple(named[axis] for axis in AXES) if set(named) == set(AXES) else given.dims
    turned = given.transpose(*order)
    values = np.asanyarray(turned.values)
    z, y, x = (_planes(turned, dim, n) for dim, n in zip(order, values.shape, strict=True))
    if 0 in values.shape:
        raise ValueError(f"a volume has voxels in it; got {values.shape}")
    return rectilinear(values, x, y, z, str(given.name or name))


def _variable(given: Any, part: Any) -> Any:
    """Return a data set's variable by name, or the only one."""
    names = [str(each) for each in given.data_vars]
    if part not in names and (part or len(names) != 1):
        listed = ", ".join(names) or "there is none"
        raise ValueError(f"name a variable by part=NAME ({part or 'none'} given): {listed}")
    return given[part or names[0]]


def _planes(given: Any, dim: str, count: int) -> Doubles:
    """Return coordinates along a dimension; indices if it has none."""
    if dim not in given.coords:
        return np.arange(count, dtype=np.float64)
    along = np.asarray(given.coords[dim].values)
    if along.dtype.kind not in "iuf" or not np.isfinite(along).all():
        raise ValueError(f"coordinates along {dim} of {along.dtype}; they must be finite numbers")
    return along.astype(np.float64)
