"""Options of the everyday commands, and the target that they give for a picture."""

import math
import re
from typing import TYPE_CHECKING, Annotated, ClassVar

from cyclopts import Parameter
from pydantic import Field

from resample.command.about import NUMBERS, OptionTopic
from resample.command.flags import Hyphen, Switch
from resample.command.settings import CALIBRATED, SIZE, Choices, height_and_width
from resample.words import numbers_in

if TYPE_CHECKING:
    from resample_texture.command.inputs import Aim, PictureTarget

PIXELS = re.compile(r"\d{1,9}([xX]\d{1,9})?", re.ASCII)
SHARE = re.compile(r"(\d+|\d*\.\d+|\d+\.)\s*(%|x)?", re.ASCII)


class NewSize(Choices):
    """The new size of a picture."""

    heading: ClassVar[str] = "Target"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    size: Annotated[
        str | None,
        Field(
            description="Size in px: 400 for a square, 640x480 for width and height; or of the "
            "picture's: 50%, 0.5 or 2x."
        ),
    ] = None
    width: Annotated[
        int | None, Field(ge=1, description="Width in px, instead of a size; the height follows.")
    ] = None
    height: Annotated[
        int | None, Field(ge=1, description="Height in px, instead of a size; the width follows.")
    ] = None

    def check(self) -> None:
        """Refuse a wrong size before any picture is read."""
        self.shape((1, 1))

    def shape(self, source_shape: tuple[int, int]) -> tuple[int, int]:
        """Return height and width, px, of the result for a picture (height, width).

        Raises
        ------
        ValueError
            No size was given, two were, or it is not a size.
        """
        from resample_texture.geometry.matrices import scaled_shape

        if (self.size is None) == (self.width is None and self.height is None):
            raise ValueError("give a --size, or a --width, a --height or both")
        if self.size is not None:
            share = _share_of(self.size)
            if share is not None:
                return scaled_shape(source_shape, (share, share))
            if PIXELS.fullmatch(self.size.strip()) is None:
                raise ValueError(f"size {self.size!r}; give 400, 640x480, 50%, 0.5 or 2x")
            return height_and_width(self.size)
        height, width = source_shape
        down, across = (self.height or 0) / height, (self.width or 0) / width
        return _side(self.height, height * across), _side(self.width, width * down)

    def target(self, source_shape: tuple[int, int]) -> "PictureTarget":
        """Return the target of a picture (height, width)."""
        from resample_texture.command.inputs import PictureTarget
        from resample_texture.geometry.matrices import resizing

        shape = self.shape(source_shape)
        return PictureTarget(resizing(source_shape, shape), shape)


class Factor(Choices):
    """The factor by which a picture is scaled."""

    heading: ClassVar[str] = "Target"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    factor: Annotated[
        str, Hyphen, Field(description="For both sides, such as 0.5, or x,y, such as 0.5,0.25.")
    ]

    def check(self) -> None:
        """Refuse a wrong factor before any picture is read."""
        self.target((1, 1))

    def pair(self) -> tuple[float, float]:
        """Factors along x and y.

        Raises
        ------
        ValueError
            These are not one or two numbers.
        """
        numbers = numbers_in("factor", self.factor)
        if len(numbers) > 2:
            raise ValueError(f"factor {self.factor!r}; give one, or two: along x and y")
        return numbers[0], numbers[-1]

    def target(self, source_shape: tuple[int, int]) -> "PictureTarget":
        """Return the target of a picture (height, width)."""
        from resample_texture.command.inputs import PictureTarget
        from resample_texture.geometry.matrices import scaled_shape, scaling

        factor = self.pair()
        shape = scaled_shape(source_shape, factor)
        return PictureTarget(scaling(factor), shape)


class Rotation(Choices):
    """The angle by which a picture is rotated."""

    heading: ClassVar[str] = "Target"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    degrees: Annotated[
        float,
        Hyphen,
        Field(allow_inf_nan=False, description="Counterclockwise; negative: clockwise."),
    ]
    expand: Annotated[
        bool,
        Parameter(negative="--keep-size"),
        Field(description="Enlarge the result to hold the whole picture, or keep the size."),
    ] = True

    def target(self, source_shape: tuple[int, int]) -> "PictureTarget":
        """Return the target of a picture (height, width)."""
        from resample_texture.command.inputs import PictureTarget
        from resample_texture.geometry.matrices import turned_shape, turning

        shape = turned_shape(source_shape, self.degrees) if self.expand else source_shape
        return PictureTarget(turning(source_shape, self.degrees, shape), shape)


class Undistortion(Choices):
    """The lens whose distortion is removed, and the pinhole camera to rectify for."""

    heading: ClassVar[str] = "Target"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    lens: Annotated[
        str, NUMBERS, Hyphen, Field(description=f"{CALIBRATED}. Its distortion is removed.")
    ]
    fisheye: Annotated[
        bool,
        Switch,
        Field(description="The lens is OpenCV's fisheye: fx,fy,cx,cy,k1,k2,k3,k4."),
    ] = False
    new_matrix: Annotated[
        str | None,
        NUMBERS,
        Hyphen,
        Field(
            description="Pinhole camera to rectify for: fx,fy,cx,cy, 9 numbers or a file. Default: "
            "the lens file's, or the lens's own matrix."
        ),
    ] = None
    rectify: Annotated[
        str | None,
        NUMBERS,
        Hyphen,
        Field(
            description="Rotation from the camera's axes to the pinhole's: 9 numbers or a file. "
            "Default: the lens file's, or none."
        ),
    ] = None
    inverse: Annotated[
        bool,
        Switch,
        Field(description="Invert the mapping: add the distortion instead of removing it."),
    ] = False
    size: Annotated[str | None, Field(description=f"{SIZE} Default: the picture's.")] = None

    def aim(self) -> "Aim":
        """Return a function from a picture's height and width to its target.

        Raises
        ------
        ValueError, OSError
            The lens, matrix, rotation or size is invalid.
        """
        from resample_texture.command.inputs import calibrated, rectified

        size = None if self.size is None else height_and_width(self.size)
        calibration = calibrated(self.lens, self.new_matrix, self.rectify, fisheye=self.fisheye)
        return lambda shape: rectified(calibration, size or shape, inverse=self.inverse)


def _share_of(size: str) -> float | None:
    """Return the factor that 50%, 0.5 or 2x stands for; None for a size in px."""
    match = SHARE.fullmatch(size.strip())
    if match is None or (match[2] is None and "." not in match[1]):
        return None
    return float(match[1]) / (100.0 if match[2] == "%" else 1.0)


def _side(given: int | None, following: float) -> int:
    """Return a side, px: as given, or else in proportion to the other."""
    return max(1, math.floor(following + 0.5)) if given is None else given
