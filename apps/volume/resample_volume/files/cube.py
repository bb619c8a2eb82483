"""Gaussian's cubes of densities and orbitals: text (gaussian.com/cubegen).

Lengths are in Bohr, or in Å if the numbers of voxels are negative; they are converted to Å. Atoms
are skipped. Values are float32, which holds all digits that Gaussian writes.
"""

from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import BinaryIO, ClassVar

import numpy as np

from resample.reading.limits import check_items, check_size
from resample.types import Doubles
from resample_volume.data.values import require_memory
from resample_volume.files.headers import (
    Check,
    OneOfAll,
    VolumeHeader,
    check_shape,
    header,
    recording,
)
from resample_volume.files.texts import check_length, numbers, whole
from resample_volume.types import Recording

BOHR = 0.529177210903  # Å (CODATA 2018)
LONGEST = 4096  # bytes of a line


@dataclass(frozen=True)
class Cube(OneOfAll):
    """Gaussian's cubes, in Å; several orbitals are channels."""

    suffixes: ClassVar[tuple[str, ...]] = (".cube", ".cub")

    def read(self, path: Path, name: str, check: Check) -> Recording:
        check_size(path.name, path.stat().st_size)
        with path.open("rb") as file:
            known = _header(file, path, name)
            check(known)
            count = known.size // known.dtype.itemsize
            check_length(file, count, path.name)
            require_memory(2 * known.size, name)
            values = numbers(file, count, known.dtype, path.name)
            if file.read(LONGEST).strip():
                raise ValueError(f"{path.name} is damaged: more than its {count} numbers follow")
        every = np.empty((known.parts, *known.shape[::-1]), known.dtype)
        every[...] = values.reshape(*known.shape, known.parts).transpose(3, 2, 1, 0)
        return recording(every, known, channels_first=True)


@np.errstate(all="ignore")  # absurd numbers are rejected, without warnings
def _header(file: BinaryIO, path: Path, name: str) -> VolumeHeader:
    for _ in range(2):
        file.readline(LONGEST)  # titles
    words = _words(file)
    atoms, origin = _counted(words, path, "atoms and the origin")
    parts = whole(path, words[4].decode("latin-1")) if len(words) > 4 else 1
    axes = [_counted(_words(file), path, f"voxels along {axis}") for axis in "xyz"]
    sizes = [size for size, _ in axes]
    check_items(path.name, abs(atoms), "atoms")
    if len({size < 0 for size in sizes}) > 1:
        raise ValueError(
            f"{path.name}: numbers of voxels are {', '.join(map(str, sizes))}; "
            "give all the same sign: positive for Bohr, negative for Å"
        )
    for line in islice(iter(lambda: file.readline(LONGEST), b""), abs(atoms)):
        if len(line.split()) != 5:
            raise ValueError(f"{path.name}: an atom has five numbers, not {line[:60].split()}")
    if atoms < 0:
        # The number of orbitals, and skip their indices
        words = _words(file)
        count = whole(path, words[0].decode("latin-1")) if words else 0
        check_items(path.name, count, "orbitals")
        left = count + 1 - len(words)
        while left > 0:
            words = _words(file)
            if not words:
                raise ValueError(f"{path.name} is cut off: {count} orbitals are not named")
            left -= len(words)
        if left < 0:
            raise ValueError(f"{path.name} is damaged: more than {count} orbitals are named")
        parts = count
    if parts < 1:
        raise ValueError(f"{path.name}: its voxels have {parts} numbers; correct its header")
    shape = tuple(map(abs, sizes))
    check_shape(shape, name)
    scale = 1.0 if sizes[0] < 0 else BOHR  # negative numbers: lengths are Å
    steps = scale * np.array([step for _, step in axes])
    length = np.linalg.norm(steps, axis=1)
    unit = steps / np.where(length > 0, length, 1)[:, np.newaxis]
    known = header(shape, np.float32, name, spacing=length, origin=scale * origin, direction=unit.T)
    pixel = f"{parts} orbitals" if atoms < 0 else ""
    return known._replace(parts=parts, pixel=pixel, length="Å")


def _words(file: BinaryIO) -> list[bytes]:
    return file.readline(LONGEST).split()


def _counted(words: list[bytes], path: Path, what: str) -> tuple[int, Doubles]:
    """Parse an integer, and three other numbers."""
    try:
        place = np.array([float(word) for word in words[1:4]])
        count = int(words[0][:20])
    except (ValueError, IndexError):
        place, count = np.zeros(0), 0
    if len(place) != 3:
        told = b" ".join(words)[:60]
        raise ValueError(
            f"{path.name} is not a Gaussian cube: {what} are a number and three more, not {told!r}"
        )
    return count, place
