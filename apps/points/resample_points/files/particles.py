"""Read particles of simulations, from snapshots or columns."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from resample.reading.limits import check_file
from resample_points.data.particles import Particles, particles_of
from resample_points.files.readers import read_cloud, suffixes
from resample_points.files.snapshots import read_snapshot

SUFFIXES = (".hdf5", ".h5", ".he5")


def read_particles(
    path: str | Path, kind: str | int = "gas", *, quantities: Sequence[str] | None = None
) -> Particles:
    r"""Read particles of a simulation.

    Parameters
    ----------
    path
        `.hdf5`, `.h5`: a snapshot of SWIFT, GADGET, AREPO or Phantom (extra `hdf5`), of which one
        file may stand for all; lengths and masses become physical, by the factors of a and h.
        Or points with columns, as `read_cloud` takes them: `.csv`, `.npz` and others, with columns
        mass and h or smoothing.
    kind
        Type of the particles of a snapshot: `gas`, `dark`, `stars`, or 0 to 6.
    quantities
        Names of quantities to keep. Default: all.

    Raises
    ------
    ValueError
        The format is unknown, there are no such particles, or a number of them is not finite.
    OSError
        The file is missing or damaged.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from resample_points import read_particles
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
        if is_snapshot(source):
            with np.errstate(all="ignore"):  # numbers that become infinite are refused
                return read_snapshot(source, kind, quantities)
        if source.suffix.lower() not in (known := suffixes()):
            raise ValueError(f"particles are read from {', '.join((*SUFFIXES[:2], *known))}")
        return particles_of(read_cloud(source))
    except ValueError as error:
        text = str(error)
        raise ValueError(text if source.name in text else f"{source.name}: {text}") from None


def is_snapshot(path: Path) -> bool:
    """Whether a file is a snapshot of a simulation, by its suffix."""
    return path.suffix.lower() in SUFFIXES
