"""What results have in common: they can be saved, shown, and handed to others as 8-bit levels.

Results are made far below what knows files and pictures. `resample/__init__.py` registers that
with `register_exporter`; it is imported when a result is first saved or shown.
"""

from collections.abc import Callable, Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # `import resample` reads this file: NumPy would take most of the time
    import numpy as np
    from numpy.typing import NDArray
    from PIL.Image import Image

# 3 values of linear light, or what the commands' --background takes: white, #rrggbb, none...
Behind = Sequence[float] | str | None

_exporters: list[Callable[[], Any]] = []  # one: imports the module that makes pictures of results


def register_exporter(find: Callable[[], Any]) -> None:
    """Let `find` give the module that saves and shows results, when one is first needed."""
    _exporters[:] = [find]


def _results() -> Any:
    return _exporters[0]()


class Showable:
    """A result that can be saved, shown in a notebook, and turned into levels.

    Parts that have a picture are `color` and, as far as the result has them, `depth`,
    `first_depth`, `coverage`, `value`, `holes`, `magnification` and `confidence`.
    """

    __slots__ = ()

    def save(self, path: str | PathLike[str], *, bits: int = 8, background: Behind = None) -> None:
        """Write the picture in the format of its suffix, whole or not at all.

        Parameters
        ----------
        path
            Target: `.png`, `.exr` (linear light, coverage and depth), `.tif` or `.jpg`.
        bits
            8 or 16 per channel of PNG, 8, 16 or 32 of TIFF.
        background
            What is behind the picture: a color's name, #rrggbb or 3 values of linear light. None
            keeps it transparent, which JPEG cannot be; commands take black if nothing is said.

        Raises
        ------
        ValueError
            The suffix, the number of bits or the background is not known, or the result is no one
            picture.
        OSError
            The file cannot be written.
        """
        _results().save(self, path, bits=bits, background=background)

    def to_uint8(self, of: str = "color", *, background: Behind = None) -> "NDArray[np.uint8]":
        """Levels (H, W, 3) of sRGB, or (H, W, 4) with straight opacity where none is behind.

        Parameters
        ----------
        of
            Part that is shown; all but `color` are drawn in false colors, unknown is black.
        background
            What is behind the color, as of `save`; None keeps it transparent.

        Raises
        ------
        ValueError
            There is no such part, or the result is no one picture.
        """
        levels: NDArray[np.uint8] = _results().levels_of(self, of, background=background)
        return levels

    def to_image(self, of: str = "color", *, background: Behind = None) -> "Image":
        """Picture of Pillow's; parameters and errors as of `to_uint8`."""
        image: Image = _results().image_of(self, of, background=background)
        return image

    def _repr_png_(self) -> bytes:
        """PNG that notebooks show."""
        png: bytes = _results().png_of(self)
        return png

    def __repr__(self) -> str:
        """Size, and what is known of it, in one line."""
        text: str = _results().line_about(self)
        return text
