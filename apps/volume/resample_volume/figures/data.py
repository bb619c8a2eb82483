"""The paper's volumes if available, otherwise named substitutes."""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from resample.files.public.sets import place_of
from resample_volume.files.source import generate, open_volume
from resample_volume.types import Volume

SUFFIXES = (".nhdr", ".nrrd", ".mhd", ".mha", ".nii", ".nii.gz")
TITLES = {"engine": "Engine", "lobster": "Lobster", "aneurism": "Aneurism", "skull": "Skull"}
STAND_INS = {"skull": "vis_male", "aneurism": "vessel-tree:size=256"}


class FigureVolume(NamedTuple):
    """The volume of a figure."""

    volume: Volume
    name: str  # of the volume; a generated one with its parameters
    title: str  # for captions; names the volume that this one replaces, if any
    note: str  # one-line note for the reader; often empty


@dataclass(frozen=True)
class VolumeFolder:
    """Where volumes are searched: a folder, and the downloads of `files.public.fetch`.

    Raises
    ------
    NotADirectoryError
        There is no such folder.
    """

    folder: Path | None = None  # holds NAME.nhdr, or another of `SUFFIXES`

    def __post_init__(self) -> None:
        if self.folder is not None and not self.folder.is_dir():
            raise NotADirectoryError(f"{self.folder}: there is no such folder of volumes")

    def find(self, name: str) -> Path | None:
        """Return the file of a volume; None if it is in neither place."""
        places = [place for place in (self.folder, place_of(None)) if place is not None]
        files = [place / f"{name}{suffix}" for place in places for suffix in SUFFIXES]
        return next((file for file in files if file.is_file()), None)

    def subject(self, name: str) -> FigureVolume | None:
        """Return one of the paper's volumes or its substitute; None if there is neither."""
        path = self.find(name)
        if path is not None:
            return FigureVolume(open_volume(path), name, TITLES[name], "")
        return self._stand_in(name, STAND_INS[name]) if name in STAND_INS else None

    def _stand_in(self, name: str, other: str) -> FigureVolume | None:
        generated = ":" in other
        path = None if generated else self.find(other)
        if path is None and not generated:
            return None
        volume = generate(other) if path is None else open_volume(path)
        kind = f"the generated {other}" if generated else other
        note = f"{missing(name)}; {kind} stands in for it"
        return FigureVolume(volume, other, f"{other} (for {TITLES[name]})", note)


def missing(name: str) -> str:
    """Return the message that a volume is missing, and how to get it."""
    return (
        f"{TITLES[name]} is not there (give --data a folder with {name}.nhdr, or run "
        f"resample-volume fetch {name})"
    )
