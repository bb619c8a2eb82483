"""Groups, datasets and attributes of HDF5 files, which are checked before they are read."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.reading.limits import check_free, check_items, check_unpacked
from resample.reading.native import damage, lacking

SIGNATURE = b"\x89HDF\r\n\x1a\n"
FIRST = (0, 512, 1024, 2048)  # bytes at which it may be


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """Open an HDF5 file for reading."""
    try:
        import h5py
    except ImportError as error:
        raise lacking(path.name, "h5py", error, "hdf5") from None
    with path.open("rb") as raw:
        head = raw.read(FIRST[-1] + len(SIGNATURE))
    if not any(head[first:].startswith(SIGNATURE) for first in FIRST):
        raise ValueError("is not an HDF5 file")
    with damage(path):
        file = h5py.File(path, "r")
    try:
        yield file
    finally:
        file.close()


def names_in(path: Path, group: Any) -> list[str]:
    """Return the names in a group."""
    with damage(path):
        count = len(group)
    check_items(path.name, count, "datasets in a group")
    with damage(path):
        return [str(name) for name in group]


def member(path: Path, group: Any, name: str) -> Any:
    """Return a group or dataset of a group; None if missing."""
    import h5py

    with damage(path):
        link = group.get(name, getlink=True)
    if link is None:
        return None
    if not isinstance(link, h5py.HardLink):
        raise ValueError(f"has {name!r:.80} as a link, which is not followed; give the file itself")
    with damage(path):
        return group[name]


def hard_members(path: Path, group: Any) -> dict[str, Any]:
    """Return groups and datasets of a group by name, without links, which may name other files."""
    import h5py

    found = {}
    for name in names_in(path, group):
        with damage(path):
            if isinstance(group.get(name, getlink=True), h5py.HardLink):
                found[name] = group[name]
    return found


def group_in(path: Path, group: Any, name: str) -> Any:
    """Return a group of a group; None if missing."""
    import h5py

    found = member(path, group, name)
    return found if isinstance(found, h5py.Group) else None


def dataset_in(path: Path, group: Any, name: str) -> Any:
    """Return a dataset of numbers within the limits; None if missing."""
    import h5py

    found = member(path, group, name)
    if not isinstance(found, h5py.Dataset):
        return None
    with damage(path):
        external, is_virtual = found.external, found.is_virtual
        shape, kind, chunk = found.shape, found.dtype, found.chunks
        stored = found.id.get_storage_size()
    if external or is_virtual:
        raise ValueError(f"has {name!r:.80} in other files; give these")
    if shape is None or kind.kind not in "iufb":
        raise ValueError(f"has {name!r:.80} of the type {kind}; numbers can be read")
    check_unpacked(path.name, int(stored), math.prod(shape) * kind.itemsize)
    if chunk:
        check_free(path.name, math.prod(chunk) * kind.itemsize)
    return found


def numbers_of(path: Path, owner: Any, name: str) -> NDArray[np.float64] | None:
    """Return an attribute as numbers (N,); None if missing, or text."""
    with damage(path):
        if owner is None or name not in owner.attrs:
            return None
        values = np.atleast_1d(np.asarray(owner.attrs[name]))
    if values.dtype.kind not in "iufb" or values.ndim != 1 or not len(values):
        return None
    return values.astype(np.float64)
