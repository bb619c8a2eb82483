"""Cache on disk of a store's statistics, for later commands.

It is a hidden file beside the store or, if that is not writable, in the user's cache. The state of
the store's files on the disk or server tells whether it is still valid (`states`).
"""

import logging
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from resample.files.cached import load_arrays, store_arrays
from resample.files.stores.addresses import Address, Place
from resample.memory.mapped import folder
from resample_volume.data.bricks import Bricks
from resample_volume.data.scanning import BrickStats, are_few, step_of
from resample_volume.files.stores.states import Portion, State, state_of_files, state_of_server

LEAST = 1 << 23  # voxels; a pass over fewer takes less than a second
FORM = 2  # of the cache files
LOG = logging.getLogger("resample")


@dataclass(frozen=True, eq=False)
class StoredStatistics:
    """Cached statistics of a part of an array, such as one time and channel."""

    store: Place  # folder, zip file or address
    portion: Portion

    def load(self, bricks: Bricks) -> BrickStats | None:
        """Load the statistics of an earlier command; None if missing, or the store has changed."""
        if bricks.size < LEAST:
            return None
        for path in self._paths(bricks):
            held = load_arrays(path, *BrickStats._fields, "state")
            found = None if held is None else _statistics(held, bricks)
            if held is not None and found is not None and str(held["state"]) == self._mark:
                LOG.debug("%s: statistics loaded from %s", self.store.name, path)
                return found
        return None

    def keep(self, bricks: Bricks, found: BrickStats, state: str | None) -> None:
        """Write statistics of a store in a state, if wanted and possible."""
        if state is None or bricks.size < LEAST:
            return
        codes = np.zeros(0, np.int64) if found.codes is None else found.codes
        parts: dict[str, Any] = found._replace(codes=codes)._asdict() | {"state": state}
        any(store_arrays(path, parts) for path in self._paths(bricks))

    def state(self) -> str | None:
        """Return the state of the store; None if just written, as changes may go unnoticed."""
        return self._mark if self._state is not None and self._state.is_settled else None

    @cached_property
    def _state(self) -> State | None:
        """State at the first call."""
        if isinstance(self.store, Address):
            return state_of_server(self.portion)
        return state_of_files(self.store, self.portion.array.path)

    @property
    def _mark(self) -> str | None:
        return None if self._state is None else self._state.mark

    def _paths(self, bricks: Bricks) -> list[Path]:
        """Return the possible cache files, the best first."""
        replaced = [np.asarray(part).tolist() for part in bricks.replaced or ()]
        which = (self.portion.array.path, self.portion.at)
        what = (FORM, *which, bricks.shape, str(bricks.dtype), bricks.side, replaced)
        beside = sha256(repr(what).encode()).hexdigest()[:10]
        place = self.store.identity if isinstance(self.store, Address) else str(self.store)
        whole = sha256(repr((place, what)).encode()).hexdigest()[:20]
        own = folder() / "surveys" / f"{whole}.npz"
        if isinstance(self.store, Address):
            return [own]
        return [self.store.with_name(f".{self.store.name}.survey-{beside}.npz"), own]


def _statistics(held: dict[str, Any], bricks: Bricks) -> BrickStats | None:
    """Return the statistics of a file, if they are of this kind of volume."""
    step = step_of(bricks.size)
    z, y, x = bricks.shape
    shapes = {
        "least": bricks.count,
        "greatest": bricks.count,
        "some": tuple(-(-size // step) for size in bricks.shape),
        "border": (2 * (y * x + z * x + z * y),),
    }
    types = {"some": bricks.dtype, "border": bricks.dtype}
    if held["beyond"].ndim != 1 or held["beyond"].dtype != bricks.dtype:
        return None
    for name, shape in shapes.items():
        if held[name].shape != shape or held[name].dtype != types.get(name, np.float64):
            return None
    codes = held["codes"] if held["codes"].size else None
    if int(held["codes"].sum()) != (bricks.size if are_few(bricks.dtype) else 0):
        return None
    ends, counts = (held["least"], held["greatest"]), (int(held["infinite"]), int(held["missing"]))
    return BrickStats(*ends, *counts, held["some"], held["border"], held["beyond"], codes)
