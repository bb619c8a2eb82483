"""Data types of the volume application: arrays with shapes and units."""

from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from resample.calling import constructed
from resample.types import Doubles

VOXEL, UNKNOWN = "voxel", "unknown"  # scene units of files without spacing, or without unit
ASSUMED = {
    VOXEL: "no spacing is stated; voxels of 1 x 1 x 1 are assumed (--spacing sets it)",
    UNKNOWN: "no unit of length is stated (--spacing states it, such as 1x1x1.4mm)",
}
Part = str | tuple[str, ...]  # name of an array or a field; yt's have two words


@constructed()
class Volume(NamedTuple):
    """A scalar field on a regular lattice.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_volume import as_volume
    >>> volume = as_volume(np.zeros((4, 5, 6), np.int16))
    >>> volume = volume._replace(spacing=np.array([0.5, 0.5, 2.0]), units="mm")  # x, y, z
    >>> volume.values.shape, volume.spacing.tolist()
    ((4, 5, 6), [0.5, 0.5, 2.0])
    """

    # (Z, Y, X) uint8/16, int8/16/32, float32/64; NaN is "no value here". Where a caller asked for
    # values that stay in their file, these are `data.values.Bricks` instead.
    values: NDArray[Any]
    spacing: Doubles = np.ones(3)  # (3,) x, y, z; scene units between neighbours, > 0
    origin: Doubles = np.zeros(3)  # (3,) x, y, z; scene position of values[0, 0, 0]
    direction: Doubles = np.eye(3)  # (3, 3) columns are the unit steps of x, y, z; may mirror
    name: str = "volume"  # for titles and messages
    units: str = ""  # of the values: hu, hu+1024 (as stored), none of these; empty: not told
    colors: NDArray[Any] | None = None  # (Z, Y, X, 3 or 4) of voxels, see `recordings.in_color`
    note: str = ""  # how a file's values were changed, for messages
    space: str = ""  # lps: a patient's, in mm; x, y and z point to left, back and head
    thickness: float = 0.0  # scene units that opacities refer to; 0: cube root of a voxel's volume
    scale: str = ""  # scale of the values, see `classification.scales`; empty: linear, as measured
    length: str = ""  # scene unit: mm, µm, ... of `resample.lengths`; or one of `ASSUMED`

    def __repr__(self) -> str:
        """Size, type and spacing in one line."""
        z, y, x = self.values.shape[:3]
        gaps = " × ".join(f"{gap:.4g}" for gap in self.spacing)
        unit = f" {self.length}" * bool(self.length and self.length not in ASSUMED)
        return f"Volume({x} × {y} × {z} {self.values.dtype}, spacing {gaps}{unit})"


class Recorded(Protocol):
    """Values (T, C, Z, Y, X) that stay in their file; as arrays, as far as recordings need it."""

    @property
    def shape(self) -> tuple[Any, ...]: ...
    @property
    def dtype(self) -> np.dtype[Any]: ...
    def swapaxes(self, first: int, second: int, /) -> "Recorded": ...
    def __getitem__(self, chosen: Any, /) -> Any: ...


@runtime_checkable
class Chunked(Recorded, Protocol):
    """Values in chunks; a time and a channel of them is a volume of bricks."""

    def only(self, number: int) -> "Chunked": ...  # one index of the second axis
    def stacked_along_z(self) -> Any: ...  # bricks of all volumes, where the second has length 1


class ChannelLook(NamedTuple):
    """Look of a channel, as its file has it."""

    label: str = ""
    color: str = ""  # #rrggbb
    window: tuple[float, float] | None = None  # values that are dark and bright
    is_active: bool = True  # whether it is shown


class Recording(NamedTuple):
    """All content of a file: volumes of one lattice, for several times or channels."""

    values: NDArray[Any] | Recorded  # (T, C, Z, Y, X), each volume as `Volume` has it
    spacing: Doubles  # (3,) x, y, z; as in `Volume`, and so on
    origin: Doubles  # (3,)
    direction: Doubles  # (3, 3)
    name: str
    units: str = ""
    is_color: bool = False  # whether channels are red, green, blue and perhaps opacity
    note: str = ""
    space: str = ""
    thickness: float = 0.0
    length: str = ""
    looks: tuple[ChannelLook, ...] = ()  # of its channels, if the file has some


class Picked(NamedTuple):
    """A picked voxel."""

    voxel: tuple[int, int, int]  # index into the values: z, y, x
    value: float  # data units
    position: Doubles  # (3,) scene units
