"""Views of files that are read once, and pictures encoded as files."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from resample.command.settings import height_and_width
from resample.progress import Cancel
from resample.scene import LITTLE
from resample.view.views import Painter, Settings, Size, controls_of

if TYPE_CHECKING:
    from PIL.Image import Image


class SavingPainter(Painter, Protocol):
    """Interface of painters that write files as the command does."""

    def save(self, settings: Settings, size: Size, path: Path) -> None:
        """Write the picture of these options."""


@dataclass
class FileView:
    """What pages show of files that a painter reads once, see `resample.view.views.Viewable`.

    `first`: painter that keeps what it has read; pages start from copies of it. `describe`:
    function that returns the facts for a page; called once. `refuse`: function that rejects invalid
    options. `kinds`: settings of the kinds of pictures to compile kernels for in advance.
    `left_out`: options of the command that a page does not offer. `little`: function that returns
    the painter of these kinds; None: one of the files.
    """

    first: SavingPainter
    describe: Callable[[], dict[str, Any]]
    refuse: Callable[[Settings], object]
    kinds: Sequence[Settings] = ()
    left_out: Sequence[str] = ()
    little: Callable[[], Painter] | None = None

    @cached_property
    def about(self) -> dict[str, Any]:
        """Facts for the page, with controls for the options of its command."""
        told = self.describe()
        return {"controls": controls_of(told["command"], self.left_out), **told}

    def check(self, settings: Settings | None = None) -> None:
        """Read and prepare the files, and reject invalid options."""
        _ = self.about
        if settings is not None:
            self.refuse(settings)

    def painter(self) -> SavingPainter:
        """Painter for a page that has been opened."""
        return copy(self.first)

    def warm(self) -> Iterator[None]:
        """Compile kernels by small pictures, see `resample.view.views.Warming`."""
        painter = self.painter() if self.little is None else self.little()
        for kind in self.kinds:
            painter.paint(kind, (LITTLE, LITTLE), quick=False, cancel=Cancel())
            yield

    def save(self, settings: Settings, size: Size, suffix: str) -> bytes:
        """File that the command would write."""
        return file_of(partial(self.painter().save, settings, size), suffix)


def picture_function(
    view_of: Callable[[Path], FileView],
) -> "Callable[[str | Path, Settings], Image]":
    """Return the function that makes the picture of a file without a page."""

    def picture(path: str | Path, settings: Settings) -> "Image":
        """Return the picture that the command of a page makes with these options.

        Parameters
        ----------
        path
            File that the command takes.
        settings
            Options by name, as in settings files: `{"camera": "40,20,1.5", "up": "y"}`.

        Returns
        -------
        A Pillow image of 8 bits per channel.

        Raises
        ------
        ValueError, LookupError, OSError
            As the command does.
        """
        view = view_of(Path(path))
        height, width = height_and_width(str(settings.get("size", 400)))
        view.refuse(settings)
        return image_of(view.first, settings, (width, height))

    return picture


def image_of(painter: SavingPainter, settings: Settings, size: Size) -> "Image":
    """Pillow image, 8 bits per channel, of the PNG that the command would write."""
    from PIL import Image

    return Image.fromarray(levels_in(file_of(partial(painter.save, settings, size), ".png")))


@contextmanager
def path_file(name: str, text: str) -> Iterator[Path]:
    """File of a film's path, with the text that a page wrote, until the end of the block."""
    with TemporaryDirectory(prefix="film-") as folder:
        path = Path(folder) / name
        path.write_text(text, encoding="utf-8")
        yield path


def file_of(write: Callable[[Path], object], suffix: str) -> bytes:
    """Content of the file that a function writes to a path with a suffix."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"picture{suffix}"
        write(path)
        return path.read_bytes()


def levels_in(png: bytes) -> NDArray[np.uint8]:
    """8-bit levels of a PNG as a page shows them."""
    import cv2

    stored: Any = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED)
    if stored.ndim == 3:
        stored = stored[..., [2, 1, 0, 3][: stored.shape[2]]]
    return shown(stored)


def shown(stored: NDArray[np.uint8] | NDArray[np.uint16]) -> NDArray[np.uint8]:
    """8-bit levels (H, W, 3 or 4) as a page shows them.

    `stored`: (H, W) or (H, W, C): gray, gray and opacity, RGB, or RGB and opacity.
    """
    levels = stored if stored.dtype == np.uint8 else (stored >> 8).astype(np.uint8)
    if levels.ndim == 2:
        levels = levels[..., np.newaxis]
    if levels.shape[2] < 3:
        levels = levels[..., [0, 0, 0, 1][: 2 + levels.shape[2]]]
    return np.ascontiguousarray(levels, np.uint8)
