"""Read particles: columns of points, and HDF5 of SWIFT, GADGET and AREPO kind, and of Phantom.

Lengths and masses are physical: factors of a and h are multiplied in. A snapshot may have several
files, `snap.0.hdf5` and so on; give any of them.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.reading.limits import check_file, check_items, neighbour
from resample.reading.native import damage
from resample.types import Doubles
from resample_formats.groups import (
    dataset_in,
    group_in,
    member,
    names_in,
    numbers_of,
    opened,
)
from resample_particles.particles import Particles, is_named, particles_of
from resample_particles.smoothing import KERNELS
from resample_points.files.readers import SNAPSHOTS, read_cloud, suffixes

TYPES = {"gas": 0, "dark": 1, "stars": 4}
MOST_TYPE = 6
LONGEST = 200  # characters of a text
PLACES, MASSES = ("Coordinates",), ("Masses", "Mass", "DynamicalMasses", "SubgridMasses")
LENGTHS = ("SmoothingLengths", "SmoothingLength")
BESIDE = 0.01  # of a periodic box, by which particles may have left it
SPHERE = 2.5  # reach of a cell's kernel, in radii of a sphere of its volume
KNOWN_LENGTHS = {"au": 1.495979e13, "pc": 3.085678e18, "kpc": 3.085678e21, "Mpc": 3.085678e24}
SUN = 1.98841e33  # g
# Powers of a and h in files that do not say them: GADGET's.
POWERS = {
    "Coordinates": (1.0, -1.0),
    "Masses": (0.0, -1.0),
    "SmoothingLength": (1.0, -1.0),
    "Density": (-3.0, 2.0),
    "Volume": (3.0, -3.0),
    "Velocities": (0.5, 0.0),
}
SAID = (  # attributes of datasets with powers of a and h: SWIFT's, AREPO's, EAGLE's
    ("a-scale exponent", "h-scale exponent"),
    ("a_scaling", "h_scaling"),
    ("aexp-scale-exponent", "h-scale-exponent"),
)
TO_CGS = "Conversion factor to CGS (not including cosmological corrections)"
CGS = "Expression for physical CGS units"


@dataclass(frozen=True)
class Snapshot:
    """What the header of a snapshot says."""

    path: Path
    a: float
    h: float
    is_swift: bool
    length: str  # units of lengths and masses
    mass: str

    @classmethod
    def of(cls, path: Path, file: Any) -> "Snapshot":
        """Read a header."""
        header = group_in(path, file, "Header")
        h = number_of(path, header, "HubbleParam") or 1.0
        a = number_of(path, header, "Scale-factor")
        if a is None:
            a = 1.0 / (1.0 + (number_of(path, header, "Redshift") or 0.0))
        if not (0 < a < np.inf and 0 < h < np.inf):
            raise ValueError(f"has a scale factor of {a:g} and a Hubble parameter of {h:g}")
        swift = group_in(path, file, "Units")
        length = number_of(path, swift, "Unit length in cgs (U_L)")
        mass = number_of(path, swift, "Unit mass in cgs (U_M)")
        is_swift = length is not None
        for owner in (header, group_in(path, file, "Parameters")):
            length = length or number_of(path, owner, "UnitLength_in_cm")
            mass = mass or number_of(path, owner, "UnitMass_in_g")
        return cls(path, a, 1.0 if is_swift else h, is_swift, length_unit(length), mass_unit(mass))

    def factor(self, dataset: Any, name: str) -> float:
        """Return the factor that makes a dataset physical."""
        powers = POWERS.get(name, (0.0, 0.0)) if not self.is_swift else (0.0, 0.0)
        for of_a, of_h in SAID:
            said = number_of(self.path, dataset, of_a)
            if said is not None:
                powers = (said, number_of(self.path, dataset, of_h) or 0.0)
                break
        if number_of(self.path, dataset, "Value stored as physical"):
            powers = (0.0, 0.0)
        with np.errstate(all="ignore"):
            factor = np.float64(self.a) ** powers[0] * np.float64(self.h) ** powers[1]
        if not 0 < factor < np.inf:
            raise ValueError(f"has {name!r:.80} with the powers {powers} of a and h")
        return float(factor)

    def read(self, group: Any, name: str, shape: tuple[int, ...]) -> Doubles:
        """Read a dataset in physical units; one without factors keeps its type."""
        values: NDArray[Any] = array_in(self.path, group, name, shape)
        factor = self.factor(dataset_in(self.path, group, name), name)
        return values if factor == 1.0 else values * factor


def length_unit(size: float | None) -> str:
    """Return the name of a unit of length, cm; empty if it is not known."""
    if size is None:
        return ""
    for name, known in KNOWN_LENGTHS.items():
        if abs(size / known - 1.0) < 1e-3:
            return name
    return "cm" if size == 1.0 else f"({size:.5g} cm)"


def mass_unit(size: float | None) -> str:
    """Return the name of a unit of mass, g; empty if it is not known."""
    if size is None:
        return ""
    if size == 1.0:
        return "g"
    power = np.log10(size / SUN) if size > 0 else np.nan
    if abs(power - round(power, 0)) < 1e-3:
        return "Msun" if round(power) == 0 else f"10^{round(power)} Msun"
    return f"({size:.5g} g)"


def read_particles(
    path: str | Path, kind: str | int = "gas", *, quantities: Sequence[str] | None = None
) -> Particles:
    r"""Read particles of a simulation.

    Parameters
    ----------
    path
        `.hdf5`, `.h5`: a snapshot of SWIFT, GADGET, AREPO or Phantom (extra `hdf5`); one
        file stands for all; lengths and masses become physical, by the factors of a and h.
        Or points with columns, as `read_cloud` takes them: `.csv`, `.npz` and others, with columns
        mass and h or smoothing.
    kind
        Type of the particles of a snapshot: `gas`, `dark`, `stars`, or 0 to 6.
    quantities
        Names of quantities to keep. Default: all.

    Raises
    ------
    ValueError
        The format is unknown, the particles are missing, or a number is not finite.
    OSError
        The file is missing or damaged.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from resample_particles import read_particles
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder) / "gas.csv"
    ...     _ = path.write_text("x,y,z,mass,h,temperature\n0,0,1,2,0.1,300\n1,0,0,2,0.2,400\n")
    ...     gas = read_particles(path)
    >>> gas.mass.tolist(), gas.smoothing.tolist(), list(gas.quantities)
    ([2.0, 2.0], [0.1, 0.2], ['temperature'])
    """
    source = Path(path)
    check_file(path)
    try:
        if source.suffix.lower() in SNAPSHOTS:
            with np.errstate(all="ignore"):  # numbers that become infinite are refused
                return read_snapshot(source, kind, quantities)
        if source.suffix.lower() not in (known := suffixes()):
            raise ValueError(f"particles are read from {', '.join((*SNAPSHOTS[:2], *known))}")
        return particles_of(read_cloud(source))
    except ValueError as error:
        text = str(error)
        raise ValueError(text if source.name in text else f"{source.name}: {text}") from None


def type_of(kind: str | int) -> int:
    """Return the number of a type of particles: gas, dark, stars, or a number."""
    if str(kind) in TYPES:
        return TYPES[str(kind)]
    if str(kind).isdecimal() and int(str(kind)[:3]) <= MOST_TYPE:
        return int(kind)
    raise ValueError(f"particles of type {kind!r:.40}; give {', '.join(TYPES)} or 0 to {MOST_TYPE}")


def kinds_in(path: Path) -> list[str]:
    """Return the types of particles that a file has; none for files of other groups."""
    names = {number: kind for kind, number in TYPES.items()}
    with opened(path) as file:
        numbers = [n for n in range(MOST_TYPE + 1) if _has_type(path, file, n)]
    return [names.get(n, str(n)) for n in numbers]


def _has_type(path: Path, file: Any, number: int) -> bool:
    group = group_in(path, file, f"PartType{number}")
    place = None if group is None else dataset_in(path, group, PLACES[0])
    return place is not None and bool(place.shape) and place.shape[0] > 0


def read_snapshot(
    path: Path, kind: str | int = "gas", quantities: Sequence[str] | None = None
) -> Particles:
    """Read particles of a type; `quantities`: those to keep, None all."""
    number = type_of(kind)
    with opened(path) as file:
        files = _files(path, file)
        if group_in(path, file, "particles") is not None:
            return _phantom(path, file, number, quantities)
        if member(path, file, PLACES[0]) is not None:
            place = array_in(path, file, PLACES[0])
            return Particles(place, np.ones(1), units={"mass": "particles"})
    parts = []
    for each in files:
        check_file(each)
        with opened(each) as file:
            part = _part(each, file, number, quantities)
            parts += [] if part is None else [part]
    if not parts:
        raise ValueError(f"has no particles of type {kind}")
    return parts[0] if len(parts) == 1 else _joined(parts)


def _files(path: Path, file: Any) -> list[Path]:
    """Return the files of a snapshot."""
    header = group_in(path, file, "Header")
    count = number_of(path, header, "NumFilesPerSnapshot") or 1
    if not count > 1:
        return [path]
    check_items(path.name, int(min(count, 1e9)), "files")
    found = re.fullmatch(r"(.*\.)(\d+)(\.[^.]+)", path.name)
    if found is None:
        raise ValueError(f"is one of {count:g} files; give one that is called so, as snap.0.hdf5")
    return [neighbour(path, f"{found[1]}{n}{found[3]}") for n in range(int(count))]


def _part(path: Path, file: Any, number: int, quantities: Sequence[str] | None) -> Particles | None:
    """Read particles of a file; None if it has none of the type."""
    snapshot, group = Snapshot.of(path, file), group_in(path, file, f"PartType{number}")
    header = group_in(path, file, "Header")
    place = None if group is None else dataset_in(path, group, PLACES[0])
    if place is None or not place.shape or not place.shape[0]:
        return None
    count = place.shape[0]
    position = snapshot.read(group, PLACES[0], (count, 3))
    names = names_in(path, group)
    mass = next((snapshot.read(group, n, (count,)) for n in MASSES if n in names), None)
    if mass is None:
        mass = _table_mass(snapshot, header, number)
    length = _smoothing(snapshot, group, names, count, mass)
    held, units = _quantities(snapshot, group, quantities, count)
    units |= {"length": snapshot.length, "mass": snapshot.mass}
    box = numbers_of(path, header, "BoxSize")
    if box is not None:
        factor = snapshot.factor(group[PLACES[0]], PLACES[0])
        box = _periodic(box * factor, position)
    return Particles(position, mass, length, held, units, box)


def _periodic(box: Doubles, position: Doubles) -> Doubles | None:
    """Return a box that holds all particles; others are not periodic, as for isolated galaxies."""
    if len(box) not in (1, 3) or not (box > 0).all():
        return None
    beyond = (position < -BESIDE * box) | (position > (1.0 + BESIDE) * box)
    return None if beyond.any() else box


def _table_mass(snapshot: Snapshot, header: Any, number: int) -> Doubles:
    """Return the mass of all particles of a type from the header."""
    table = numbers_of(snapshot.path, header, "MassTable")
    if table is None or number >= len(table) or not table[number] > 0:
        raise ValueError(f"has no masses of PartType{number}, nor one in its MassTable")
    return np.array([table[number] / snapshot.h])


def _smoothing(
    snapshot: Snapshot, group: Any, names: list[str], count: int, mass: Doubles
) -> Doubles | None:
    """Return smoothing lengths: SWIFT's, of GADGET's reach, or of AREPO's cells; None: unknown."""
    name = next((name for name in LENGTHS if name in names), None)
    if name is not None:
        length = snapshot.read(group, name, (count,))
        return length if snapshot.is_swift else length / KERNELS["cubic"].gamma
    if "Volume" in names:
        volume = snapshot.read(group, "Volume", (count,))
    elif "Density" in names:
        density = snapshot.read(group, "Density", (count,)).astype(np.float64)
        if not (density > 0).all():
            raise ValueError("has densities that are not above 0, from which cells get their sizes")
        volume = mass / density
    else:
        return None
    return np.asarray(SPHERE * np.cbrt(0.75 / np.pi * volume) / KERNELS["cubic"].gamma)


def _quantities(
    snapshot: Snapshot, group: Any, wanted: Sequence[str] | None, count: int
) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    """Return the quantities of particles, and their units; of vectors each part, as `.x`."""
    held, units = dict[str, NDArray[Any]](), dict[str, str]()
    for name in _wanted(snapshot.path, group, wanted):
        try:
            dataset = dataset_in(snapshot.path, group, name)
        except ValueError:
            if wanted is None:
                continue
            raise
        if dataset is None or dataset.shape not in ((count,), (count, 3)):
            continue
        values, unit = snapshot.read(group, name, dataset.shape), ""
        found = re.fullmatch(r".*\[([^\]]*)\]\s*", text_of(snapshot.path, dataset, CGS), re.DOTALL)
        per = number_of(snapshot.path, dataset, TO_CGS)
        if found is not None and per is not None and 0 < per < np.inf:
            values, unit = values * per, found[1].strip()[:40]
        parts = (
            {name: values} if values.ndim == 1 else dict(zip(_parts(name), values.T, strict=True))
        )
        held |= parts
        units |= dict.fromkeys(parts, unit)
    return held, units


def _wanted(path: Path, group: Any, wanted: Sequence[str] | None) -> list[str]:
    """Return the names of wanted datasets, for None all; each that is asked for must be there."""
    names = names_in(path, group)
    if wanted is None:
        return [name for name in names if name not in PLACES]
    for ask in wanted:
        if not any(_asks(ask, name) for name in names):
            raise ValueError(f"has no quantity {ask!r:.80}; known: {', '.join(names):.500}")
    return [name for name in names if any(_asks(ask, name) for ask in wanted)]


def _parts(name: str) -> list[str]:
    return [f"{name}.{axis}" for axis in "xyz"]


def _asks(wanted: str, name: str) -> bool:
    return any(is_named(wanted, known) for known in (name, *_parts(name)))


def _joined(parts: list[Particles]) -> Particles:
    """Join the particles of several files."""
    shared = [name for name in parts[0].quantities if all(name in p.quantities for p in parts)]

    def whole(of: Callable[[Particles], Any]) -> Any:
        return np.concatenate([of(part) for part in parts])

    lengths = None if any(p.smoothing is None for p in parts) else whole(lambda p: p.smoothing)
    held = {name: np.concatenate([part.quantities[name] for part in parts]) for name in shared}
    first = parts[0]
    box = None if any(p.box is None for p in parts) else first.box
    return Particles(
        whole(lambda p: p.position), whole(lambda p: p.mass), lengths, held, first.units, box
    )


PHANTOM = {0: 1, 1: 7, 2: 5, 3: 6, 4: 4}  # Phantom's types: gas, dark matter, bulge and disk, stars


def _phantom(path: Path, file: Any, number: int, quantities: Sequence[str] | None) -> Particles:
    """Read Phantom's particles; kernels reach 2 h, and particles with h <= 0 are accreted."""
    group, header = group_in(path, file, "particles"), group_in(path, file, "header")
    place = array_in(path, group, "xyz")
    count = len(place) if place is not None and place.ndim else 0
    length, kind = (array_in(path, group, name, (count,)) for name in ("h", "itype"))
    masses = None if header is None else array_in(path, header, "massoftype")
    own = PHANTOM.get(number, -1)
    if length is None or kind is None or masses is None or not own <= masses.size:
        raise ValueError("has no h, itype and massoftype, which Phantom writes")
    kept = (length > 0) & (kind == own)
    if not kept.any():
        raise ValueError(f"has no particles of type {number}")
    held = {}
    for name in names_in(path, group):
        part = dataset_in(path, group, name)
        is_wanted = quantities is None or any(is_named(each, name) for each in quantities)
        if is_wanted and part is not None and part.shape == (count,):
            held[name] = array_in(path, group, name)[kept]
    mass = masses.ravel()[own - 1 : own].astype(np.float64)
    return Particles(place[kept], mass, 2.0 * length[kept] / KERNELS["cubic"].gamma, held)


def array_in(path: Path, group: Any, name: str, shape: tuple[int, ...] | None = None) -> Any:
    """Return an array of a group; None if there is none.

    `shape`: what it must have, where None stands for any number.
    """
    found = dataset_in(path, group, name)
    if found is None:
        return None
    if shape is not None and found.shape != shape:
        raise ValueError(f"has {name!r:.80} of the shape {found.shape}; it must be {shape}")
    with damage(path):
        values: NDArray[Any] = found[()]
    return values


def number_of(path: Path, owner: Any, name: str) -> float | None:
    """Return an attribute as one number; None if missing."""
    values = numbers_of(path, owner, name)
    return None if values is None else float(values[0])


def text_of(path: Path, owner: Any, name: str) -> str:
    """Return an attribute as text; empty if missing."""
    with damage(path):
        if name not in owner.attrs:
            return ""
        value = owner.attrs[name]
    value = value.item() if isinstance(value, np.ndarray) and value.size == 1 else value
    text = value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
    return text[:LONGEST]
