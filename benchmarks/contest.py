"""What groups of benchmarks are given."""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from benchmarks.measure import child, peak_memory


class AbsentError(LookupError):
    """A program or data set is missing on this machine; the message says which and why."""


@dataclass(frozen=True)
class Options:
    """What to measure and how thoroughly; contains only text and numbers."""

    quick: bool = False
    rounds: int = 7
    data: str | None = None  # parent of the folder `volumes`
    scratch: str = "."  # folder through which processes exchange data
    sides: tuple[int, ...] = (400, 1024)  # px, of pictures of volumes

    @classmethod
    def of(cls, known: Mapping[str, Any]) -> "Options":
        """Restore options from JSON, which has no tuples."""
        return cls(**{**known, "sides": tuple(known.get("sides", cls.sides))})

    @property
    def volumes(self) -> Path:
        """Folder of real volumes."""
        from conftest import DATA

        folder = Path(self.data) if self.data else DATA
        return folder / "volumes" if (folder / "volumes").is_dir() else folder


def idle_memory() -> int:
    """Peak MiB of a fresh process that only imports the library."""
    return int(child("benchmarks.contest")["peak"])


def in_child() -> dict[str, float]:
    """Peak memory of importing the library."""
    import_module("resample.resampler")
    return {"peak": round(peak_memory())}
