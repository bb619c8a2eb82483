"""The volume application's data: arrays with shapes and units, no behaviour."""

from typing import Any, NamedTuple

from numpy.typing import NDArray

from resample.types import Doubles


class Volume(NamedTuple):
    """A scalar field on a regular lattice."""

    values: NDArray[Any]  # (Z, Y, X) uint8/16, int8/16/32, float32/64; NaN is "no value here"
    spacing: Doubles  # (3,) x, y, z; scene units between neighbours, > 0
    origin: Doubles  # (3,) x, y, z; scene position of values[0, 0, 0]
    direction: Doubles  # (3, 3) columns are the unit steps of x, y, z; may mirror
    name: str  # for titles and messages
    units: str = ""  # of the values: hu, hu+1024 (as stored), none of these; empty: not told
    space: str = ""  # lps: a patient's, in mm, whose left, back and head x, y and z point to
