"""Passes over the cells that meet a band, batch by batch, in the order of the source.

Visibility takes several passes: find the nearest cells, the next ones, and what these leave. The
application plays `placed` for the source, which is projected again in every pass, `take` for every
kind of pass, and `skips` for passes that do not need all members.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import inner_kernel
from resample.engine.roles import plays, role

Source = Any  # bundles of the application's, whose classes select what the roles do
Pass = Any
Batch = Any


@role
def placed(source: Source, member: int, batch: Batch) -> int:
    """Place the cells of a member of the source in a batch; return the number of runs."""
    raise NotImplementedError


@role
def skips(look: Pass, source: Source, member: int, nth: int) -> bool:
    """Whether a pass needs nothing of a member, the `nth` that meets the band."""
    raise NotImplementedError


@plays(skips, object)
def _skips_none(look: Pass, source: Source, member: int, nth: int) -> bool:  # noqa: ARG001
    return False


@role
def take(look: Pass, source: Source, member: int, nth: int, run: int, batch: Batch) -> None:
    """Process a run of the cells of a batch."""
    raise NotImplementedError


@inner_kernel
def walk(look: Pass, source: Source, members: NDArray[np.int32], batch: Batch) -> None:
    """Run a pass over all members of a source that meet a band."""
    # Project only members that the pass needs.
    for nth in range(members.size):
        member = members[nth]
        if not skips(look, source, member, nth):
            for run in range(placed(source, member, batch)):
                take(look, source, member, nth, run, batch)
