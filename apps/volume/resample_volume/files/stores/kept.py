"""What a first pass over a store has found, kept for later commands.

It lies in a hidden file beside the store or, where nothing may be written there, in the user's
cache. The names, sizes and times of the store's files tell whether it still holds.
"""

import logging
import os
import time
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from resample.files.writing import replacing
from resample.reading.arrays import read_npz
from resample_volume.voxels.bricks import Bricks, Glance, are_few, step_of

LEAST = 1 << 23  # voxels; of fewer a pass takes less than a second
FOLDER_VARIABLE = "HYBRID_RESAMPLE_CACHE"
RECENT = 2.0  # seconds, within which a file may change without a new time
FORM = 1  # of the files that are kept
LOG = logging.getLogger("resample")


@dataclass(frozen=True)
class Kept:
    """Findings about one time and channel of an array."""

    store: Path  # folder or zip file
    array: str  # where in the store it is
    at: tuple[tuple[str, int], ...]  # time and channel

    def load(self, bricks: Bricks) -> Glance | None:
        """What an earlier command has found; None if nothing, or the store has changed."""
        if bricks.size < LEAST:
            return None
        state = self._state()
        for path in self._paths(bricks):
            with suppress(ValueError, OSError, LookupError):
                names = (*Glance._fields, "state")
                held = read_npz(path, *names)
                found = _glance(held, bricks)
                if found is not None and str(held["state"]) == state:
                    LOG.debug("%s: what was found in it is taken from %s", self.store, path)
                    return found
        return None

    def keep(self, bricks: Bricks, found: Glance, state: str | None) -> None:
        """Write down what was found of a store in a state, if it is to be kept and can be."""
        if state is None or bricks.size < LEAST:
            return
        codes = np.zeros(0, np.int64) if found.codes is None else found.codes
        parts: dict[str, Any] = found._replace(codes=codes)._asdict() | {"state": state}
        for path in self._paths(bricks):
            with suppress(OSError):
                path.parent.mkdir(parents=True, exist_ok=True)
                with replacing(path) as temporary, temporary.open("wb") as file:
                    np.savez(file, **parts)
                return

    def state(self) -> str | None:
        """State of the store; None where it has just been written, so that it may change unseen."""
        return self._state(time.time() - RECENT)

    def _state(self, before: float | None = None) -> str | None:
        """Fingerprint of names, sizes and times of files, if none is newer than a time."""
        digest, newest = sha256(), 0.0
        with suppress(OSError):
            for path in _files(self.store, self.array):
                known, name = os.stat(path), os.path.relpath(path, self.store)
                newest = max(newest, known.st_mtime)
                digest.update(f"{name}\0{known.st_size}\0{known.st_mtime_ns}\0".encode())
            return digest.hexdigest() if before is None or newest < before else None
        return None

    def _paths(self, bricks: Bricks) -> list[Path]:
        """Files that may hold what was found, the best place first."""
        import pooch

        replaced = [np.asarray(part).tolist() for part in bricks.replaced or ()]
        what = (FORM, self.array, self.at, bricks.shape, str(bricks.dtype), bricks.side, replaced)
        beside = sha256(repr(what).encode()).hexdigest()[:10]
        whole = sha256(repr((str(self.store), what)).encode()).hexdigest()[:20]
        cache = Path(os.environ.get(FOLDER_VARIABLE) or pooch.os_cache("hybrid-resample"))
        return [
            self.store.with_name(f".{self.store.name}.survey-{beside}.npz"),
            cache / "surveys" / f"{whole}.npz",
        ]


def _files(store: Path, array: str) -> list[str]:
    """Files of an array, in their order; a zip file is one."""
    if store.is_file():
        return [str(store)]
    found = []
    for folder, folders, names in os.walk(store / array):
        folders.sort()
        found += [os.path.join(folder, name) for name in sorted(names)]
    return found


def _glance(held: dict[str, Any], bricks: Bricks) -> Glance | None:
    """Findings of a file, if they are of such a volume."""
    step = step_of(bricks.size)
    z, y, x = bricks.shape
    shapes = {
        "least": bricks.count,
        "greatest": bricks.count,
        "some": tuple(-(-size // step) for size in bricks.shape),
        "rim": (2 * (y * x + z * x + z * y),),
    }
    types = {"some": bricks.dtype, "rim": bricks.dtype}
    if held["beyond"].ndim != 1 or held["beyond"].dtype != bricks.dtype:
        return None
    for name, shape in shapes.items():
        if held[name].shape != shape or held[name].dtype != types.get(name, np.float64):
            return None
    codes = held["codes"] if held["codes"].size else None
    if int(held["codes"].sum()) != (bricks.size if are_few(bricks.dtype) else 0):
        return None
    ends, counts = (held["least"], held["greatest"]), (int(held["infinite"]), int(held["missing"]))
    return Glance(*ends, *counts, held["some"], held["rim"], held["beyond"], codes)
