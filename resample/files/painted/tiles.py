"""Windows of a picture as files, for several processes that write them and one that joins them."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from resample.files.writing import replacing
from resample.painting.scenes.plans import Window
from resample.reading.arrays import read_npz
from resample.types import Film

NAME = "window-{}-{}-{}-{}.npz"


def keep_tile(folder: Path, window: Window, film: Film, facts: Mapping[str, int]) -> None:
    """Write a window of a picture atomically.

    Parameters
    ----------
    window
        Window in px of the whole picture.
    """
    parts: dict[str, Any] = film._asdict() | {f"of_{name}": n for name, n in facts.items()}
    with replacing(folder / NAME.format(*window)) as temporary, temporary.open("wb") as file:
        np.savez(file, **parts)


def kept_tile(folder: Path, window: Window) -> tuple[Film, dict[str, int]] | None:
    """Read a window and its numbers; None if it was not written."""
    path = folder / NAME.format(*window)
    if not path.is_file():
        return None
    parts = read_npz(path)
    film = Film(*(parts[name] for name in Film._fields))
    return film, {name[3:]: int(part) for name, part in parts.items() if name.startswith("of_")}
