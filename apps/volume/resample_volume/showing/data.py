"""The paper's volumes where they are to be had, and what stands in for them, which says so."""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from resample.files.public.sets import place_of
from resample_volume.files.source import generate, open_volume
from resample_volume.types import Volume

SUFFIXES = (".nhdr", ".nrrd", ".mhd", ".mha", ".nii", ".nii.gz")
TITLES = {"engine": "Engine", "lobster": "Lobster", "aneurism": "Aneurism", "skull": "Skull"}
STAND_INS = {"skull": "vis_male", "aneurism": "vessel-tree:size=256"}


class Subject(NamedTuple):
    """What a figure shows."""

    volume: Volume
    name: str  # of the volume; a generated one with its parameters
    title: str  # for captions; says so where the volume stands in for another
    note: str  # what the reader must know, one line; often nothing


@dataclass(frozen=True)
class Shelf:
    """Where volumes are looked for: a folder, and what `files.public.fetch` has downloaded.

    Raises
    ------
    NotADirectoryError
        The folder is none.
    """

    folder: Path | None = None  # holds NAME.nhdr, or another of `SUFFIXES`

    def __post_init__(self) -> None:
        if self.folder is not None and not self.folder.is_dir():
            raise NotADirectoryError(f"{self.folder}: there is no such folder of volumes")

    def find(self, name: str) -> Path | None:
        """File of a volume; None where it is in neither place."""
        places = [place for place in (self.folder, place_of(None)) if place is not None]
        files = [place / f"{name}{suffix}" for place in places for suffix in SUFFIXES]
        return next((file for file in files if file.is_file()), None)

    def subject(self, name: str) -> Subject | None:
        """One of the paper's volumes or what stands in for it; None where there is neither.

        Parameters
        ----------
        name
            One of `TITLES`.

        Raises
        ------
        OSError, ValueError
            The file is there and cannot be read.
        """
        path = self.find(name)
        if path is not None:
            return Subject(open_volume(path), name, TITLES[name], "")
        return self._stand_in(name, STAND_INS[name]) if name in STAND_INS else None

    def _stand_in(self, name: str, other: str) -> Subject | None:
        generated = ":" in other
        path = None if generated else self.find(other)
        if path is None and not generated:
            return None
        volume = generate(other) if path is None else open_volume(path)
        kind = f"the generated {other}" if generated else other
        note = f"{missing(name)}; {kind} stands in for it"
        return Subject(volume, other, f"{other} (for {TITLES[name]})", note)


def missing(name: str) -> str:
    """That a volume is not there, and how to get it."""
    return (
        f"{TITLES[name]} is not there (give --data a folder with {name}.nhdr, or run "
        f"resample-volume fetch {name})"
    )
