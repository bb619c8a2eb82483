"""Base class of results: save, display in notebooks, convert to 8-bit levels and NumPy arrays.

Code for files and pictures is in higher layers; `resample/__init__.py` registers it with
`register_exporter`, and it is imported on first use.
"""

from collections.abc import Callable, Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any, Literal

from resample.calling import RESULTS, no_attribute

if TYPE_CHECKING:  # `import resample` reads this file: NumPy would take most of the time
    import numpy as np
    from numpy.typing import DTypeLike, NDArray
    from PIL.Image import Image

# 3 values of linear light, or a value of the commands' --background: white, #rrggbb, none...
Behind = Sequence[float] | str | None
ChannelOrder = Literal["rgb", "bgr"]  # of Pillow, Matplotlib and browsers; of OpenCV

_exporters: list[Callable[[], Any]] = []  # one entry; imports the module that exports results


def register_exporter(find: Callable[[], Any]) -> None:
    """Register a function that imports the module which saves and shows results."""
    _exporters[:] = [find]


def results() -> Any:
    """Return the module that saves and shows results."""
    return _exporters[0]()


def array_of(
    values: "NDArray[Any]", dtype: "DTypeLike | None", copy: bool | None
) -> "NDArray[Any]":
    """Return a result's values as NumPy's `__array__` has to: copied if asked, or if needed."""
    import numpy as np

    return np.array(values, dtype=dtype, copy=copy, subok=True)


class Showable:
    """A result that can be saved, shown in a notebook and converted to 8-bit levels.

    Parts that can be pictures are `color` and, where the result has them, `depth`, `first_depth`,
    `coverage`, `value`, `holes`, `magnification` and `confidence`. `np.asarray(result)` and
    `plt.imshow(result)` take the levels of `to_uint8()`.
    """

    __slots__ = ()

    def __getattr__(self, name: str) -> Any:
        """Suggest our names for other libraries' attributes of a result."""
        raise no_attribute(self, name, RESULTS)

    def save(self, path: str | PathLike[str], *, bits: int = 8, background: Behind = None) -> None:
        """Write the picture in the format of the suffix; no partial file is left on failure.

        Parameters
        ----------
        path
            Target: `.png`, `.exr` (linear light, coverage and depth), `.tif` or `.jpg`.
        bits
            8 or 16 per channel of PNG, 8, 16 or 32 of TIFF.
        background
            Background: a color's name, #rrggbb or 3 values of linear light. None keeps the picture
            transparent, which JPEG cannot be; commands default to black.

        Raises
        ------
        ValueError
            The suffix, number of bits or background is invalid, or the result is not a single
            picture.
        OSError
            The file cannot be written.
        """
        results().save(self, path, bits=bits, background=background)

    def to_uint8(
        self, of: str = "color", *, background: Behind = None, order: ChannelOrder = "rgb"
    ) -> "NDArray[np.uint8]":
        """Convert to sRGB levels (H, W, 3), or (H, W, 4) with straight opacity if no background.

        Parameters
        ----------
        of
            Part to show; all but `color` are drawn in false colors, black where unknown.
        background
            Background of the color, as in `save`; None keeps it transparent.
        order
            Order of the channels: `rgb`, or `bgr` (then opacity) for OpenCV, as in
            `cv2.imwrite("a.png", frame.to_uint8(order="bgr"))`.

        Raises
        ------
        ValueError
            There is no such part or order, or the result is not a single picture.
        """
        levels: NDArray[np.uint8] = results().levels_of(
            self, of, background=background, order=order
        )
        return levels

    def __array__(
        self, dtype: "DTypeLike | None" = None, *, copy: bool | None = None
    ) -> "NDArray[Any]":
        """Return the levels of `to_uint8()`: what people see."""
        if copy is False:
            raise ValueError(
                f"the levels of a {type(self).__name__} are computed, which copies; leave "
                "copy=False away"
            )
        return array_of(self.to_uint8(), dtype, None)

    def show(self, of: str = "color", *, background: Behind = None) -> None:
        """Open the picture in the system's viewer; parameters and errors as in `to_uint8`."""
        self.to_image(of, background=background).show()

    def to_image(self, of: str = "color", *, background: Behind = None) -> "Image":
        """Convert to a Pillow image; parameters and errors as in `to_uint8`."""
        image: Image = results().image_of(self, of, background=background)
        return image

    def _repr_png_(self) -> bytes:
        """PNG for notebooks."""
        png: bytes = results().png_of(self)
        return png

    def __repr__(self) -> str:
        """Size and main properties in one line."""
        text: str = results().line_about(self)
        return text
