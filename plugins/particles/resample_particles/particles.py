"""Particles of simulations: masses that a kernel spreads over a smoothing length."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.types import Doubles
from resample_particles.smoothing import found_smoothing
from resample_points.data.cloud import FARTHEST, Cloud

MASSES = ("mass", "masses", "m")  # names of columns
LENGTHS = ("smoothing", "h", "hsml", "smoothing_length")


@dataclass(frozen=True, eq=False)
class Particles:
    """N particles of a simulation.

    Parameters
    ----------
    position
        (N, 3) scene units.
    mass
        (N,), or one for all.
    smoothing
        (N,) or one for all: smoothing lengths h, scene units, twice the standard deviation of a
        kernel along an axis. Cubic splines reach as far as 1.826 h, Wendland's C2 1.936 h and
        Gaussians 2.044 h. 0 is a point. None: found from 48 neighbours.
    quantities
        (N,) each, by name.
    units
        Texts by name: of `length` and `mass`, and of quantities.
    box
        (3,) size of a periodic box with its lowest corner at 0, or one for a cube; None: there is
        none.

    Raises
    ------
    ValueError
        There are no particles, arrays do not fit each other, or a number is not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_particles import Particles, column_density
    >>> place = np.random.default_rng(1).uniform(size=(500, 3))
    >>> column = column_density(Particles(place, 2.0, box=1.0), "z", size=(40, 40))
    >>> round(float(column.value.mean()), 2)  # 1000 on an area of 1
    1000.0
    """

    position: Doubles
    mass: Doubles = field(default_factory=lambda: np.ones(1))
    smoothing: Doubles | None = None
    quantities: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    box: Doubles | None = None

    def __post_init__(self) -> None:
        place = np.asarray(self.position)
        if place.ndim != 2 or place.shape[1] != 3 or place.dtype.kind not in "iuf":
            raise ValueError(f"positions of particles have the shape {place.shape}; give (N, 3)")
        count = len(place)
        if not count:
            raise ValueError("there are no particles")
        named = {"position": np.asarray(place, np.float64)}
        named["mass"] = _column("mass", self.mass, count)
        if self.smoothing is not None:
            named["smoothing"] = _lengths(self.smoothing, count)
        if self.box is not None:
            named["box"] = _box(self.box)
        for name, values in named.items():
            _check_finite(name, values)
            object.__setattr__(self, name, values)
        held = {name: _quantity(name, part, count) for name, part in self.quantities.items()}
        object.__setattr__(self, "quantities", held)

    def __len__(self) -> int:
        return len(self.position)

    def smoothed(self) -> "Particles":
        """Return the particles with smoothing lengths, estimated if missing."""
        if self.smoothing is not None:
            return self
        return replace(self, smoothing=found_smoothing(self.position, self.box))

    def some(self, which: NDArray[Any]) -> "Particles":
        """Return some of the particles by mask or indices, without a box."""
        parts = {name: part[which] for name, part in self.quantities.items()}
        length = None if self.smoothing is None else self.smoothing[which]
        return replace(
            self,
            position=self.position[which],
            mass=self.mass[which],
            smoothing=length,
            quantities=parts,
            box=None,
        )

    def quantity(self, name: str) -> tuple[str, NDArray[Any]]:
        """Return a quantity by its name, in which letters' case and an ending s do not count.

        Raises
        ------
        LookupError
            There is none.
        """
        for known, values in self.quantities.items():
            if is_named(name, known):
                return known, values
        known = ", ".join(self.quantities) or "none"
        raise LookupError(f"there is no quantity {name!r}; known: {known}")


def is_named(wanted: str, known: str) -> bool:
    """Whether a name is meant, whatever the case of letters, underscores and an ending s."""
    return _plain(wanted) == _plain(known)


def _plain(name: str) -> str:
    return name.casefold().replace("_", "").removesuffix("s").removesuffix("e")


def _column(name: str, given: ArrayLike, count: int) -> Doubles:
    values = np.asarray(given)
    if values.dtype.kind not in "iuf" or values.shape not in ((), (1,), (count,)):
        raise ValueError(
            f"{name} of particles has the shape {values.shape}; give ({count},) or a number"
        )
    return np.broadcast_to(values.astype(np.float64), (count,))


def _lengths(given: ArrayLike, count: int) -> Doubles:
    values = _column("smoothing", given, count)
    if (values < 0).any():
        raise ValueError("a smoothing length is below 0; give 0 for points")
    return values


def _check_finite(name: str, values: Doubles) -> None:
    if not np.isfinite(values).all():
        raise ValueError(f"{name} of particles holds numbers that are not finite")
    if abs(values).max() > FARTHEST and name != "mass":
        raise ValueError(
            f"{name} of particles reaches {abs(values).max():g}; {FARTHEST:g} is the limit"
        )


def _quantity(name: str, given: ArrayLike, count: int) -> NDArray[Any]:
    values = np.asarray(given)
    if values.dtype.kind not in "iufb" or values.shape != (count,):
        raise ValueError(f"quantity {name!r} has the shape {values.shape}; give ({count},)")
    return values


def _box(given: ArrayLike) -> Doubles:
    box = np.asarray(given, np.float64)
    if box.shape not in ((), (1,), (3,)) or not (box > 0).all():
        raise ValueError(f"a box of {box.tolist()!r:.80}; give its size along x, y, z, above 0")
    return np.broadcast_to(box, (3,)).copy()


def particles_of(cloud: Cloud) -> Particles:
    """Return the points of a file of columns as particles; each is 1 where no masses are given.

    Columns called mass, and smoothing, h or hsml, are these; others are quantities.
    """
    columns = dict(cloud.columns)
    mass = _taken(columns, MASSES)
    length = _taken(columns, LENGTHS)
    units = {} if mass is not None else {"mass": "particles"}
    return Particles(
        np.asarray(cloud.position, np.float64),
        np.ones(1) if mass is None else mass,
        length,
        columns,
        units,
    )


def _taken(columns: dict[str, NDArray[Any]], names: tuple[str, ...]) -> NDArray[Any] | None:
    """Remove the first column of these names, in any case, and return it."""
    for name in list(columns):
        if name.casefold() in names:
            return columns.pop(name)
    return None
