"""Views of files that are read once, and pictures of them without a page."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Protocol

from resample.view.files import file_of, levels_in
from resample.view.views import Painter, Settings, Size
from resample.watching import Cancel

if TYPE_CHECKING:
    from PIL.Image import Image

LITTLE = 16  # px per side of pictures that compile kernels


class SavingPainter(Painter, Protocol):
    """Interface of painters that write files as the command does."""

    def save(self, settings: Settings, size: Size, path: Path) -> None:
        """Write the picture of these options."""


@dataclass
class FileView:
    """What pages show of files that a painter reads once, see `resample.view.views.Viewable`.

    Parameters
    ----------
    first
        Painter that keeps what it has read; pages start from copies of it.
    describe
        Function that returns the facts for a page; called once.
    refuse
        Function that rejects invalid options.
    kinds
        Options of the kinds of pictures whose kernels are compiled in advance.
    """

    first: SavingPainter
    describe: Callable[[], dict[str, Any]]
    refuse: Callable[[Settings], object]
    kinds: Sequence[Settings] = ()

    @cached_property
    def about(self) -> dict[str, Any]:
        """Facts for the page."""
        return self.describe()

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
        painter = self.painter()
        for kind in self.kinds:
            settings = {**self.about["settings"], **kind}
            painter.paint(settings, (LITTLE, LITTLE), quick=False, cancel=Cancel())
            yield

    def save(self, settings: Settings, size: Size, suffix: str) -> bytes:
        """File that the command would write."""
        return file_of(partial(self.painter().save, settings, size), suffix)


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
