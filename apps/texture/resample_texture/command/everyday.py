"""Everyday commands: resize, scale, rotate, undistort."""

import re
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from cyclopts import Parameter
from pydantic import Field

from resample.command import flags
from resample.command.flags import CALIBRATED, LENS, SIZE, Hyphen, OptionTopic, Switch
from resample.command.settings import Choices, Written, height_and_width
from resample.messages import numbers_in, parts_of
from resample_texture.command.choices import (
    MATRIX,
    Besides,
    Filling,
    Picture,
    PictureFiltering,
    PictureWarping,
    Reports,
)

if TYPE_CHECKING:
    from resample_texture.arguments import AnySize
    from resample_texture.command.rendering import Aim, PictureTarget

PIXELS = re.compile(r"\d{1,9}([xX]\d{1,9})?", re.ASCII)
SHARE = re.compile(r"(\d+|\d*\.\d+|\d+\.)\s*(%|x)?", re.ASCII)
Fit = Literal["contain", "cover", "stretch", "pad"]


class NewSize(Choices):
    """The new size of a picture."""

    heading: ClassVar[str] = "Target"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    size: Annotated[
        str | None,
        Field(
            description="Size in px: 400 for the longer side, 640x480 for width and height; or of "
            "the picture's: 50%, 0.5 or 2x. [default: that of --width and --height]"
        ),
    ] = None
    fit: Annotated[
        Fit | None,
        Field(
            description="How the picture is filled: contain, as large as the size holds; cover, "
            "all of the size, and the rest is cut off; stretch; pad, contained and filled up with "
            "transparency or --background. [default: contain for one number, stretch for two]"
        ),
    ] = None
    width: Annotated[
        int | None,
        Field(
            ge=1, description="Width in px, instead of a size. [default: follows from the height]"
        ),
    ] = None
    height: Annotated[
        int | None,
        Field(
            ge=1, description="Height in px, instead of a size. [default: follows from the width]"
        ),
    ] = None

    box: Annotated[
        str | None,
        Hyphen,
        Field(
            description="Part of the picture to take: left,top,right,bottom in px. [default: all "
            "of it]"
        ),
    ] = None

    def check(self) -> None:
        """Refuse a wrong size before any picture is read."""
        self.model_copy(update={"box": None}).target((1, 1))
        self._part()

    def target(self, source_shape: tuple[int, int]) -> "PictureTarget":
        """Return the target of a picture (height, width)."""
        from resample_texture.arguments import resized
        from resample_texture.command.rendering import PictureTarget

        size = None if self.size is None else size_of(self.size)
        sides: dict[str, Any] = {"height": self.height, "width": self.width, "fit": self.fit}
        return PictureTarget(*resized(source_shape, size, **sides, box=self._part()))

    def _part(self) -> list[float] | None:
        return None if self.box is None else numbers_in("box", self.box)

    def opened(self, warping: Filling) -> Filling:
        """Return options with which padding shows nothing, unless an edge mode was given."""
        is_open = self.fit == "pad" and "edge" not in warping.model_fields_set
        return warping.model_copy(update={"edge": "transparent"}) if is_open else warping


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

        Raises ValueError: these are not one or two numbers.
        """
        numbers = numbers_in("factor", self.factor)
        if len(numbers) > 2:
            raise ValueError(f"factor {self.factor!r}; give one, or two: along x and y")
        return numbers[0], numbers[-1]

    def target(self, source_shape: tuple[int, int]) -> "PictureTarget":
        """Return the target of a picture (height, width)."""
        from resample_texture.command.rendering import PictureTarget
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
        from resample_texture.command.rendering import PictureTarget
        from resample_texture.geometry.matrices import turned_shape, turning

        shape = turned_shape(source_shape, self.degrees) if self.expand else source_shape
        return PictureTarget(turning(source_shape, self.degrees, shape), shape)


class Undistortion(Choices):
    """The lens whose distortion is removed, and the pinhole camera to rectify for."""

    heading: ClassVar[str] = "Target"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    lens: Annotated[
        str, LENS, Hyphen, Field(description=f"{CALIBRATED}. Its distortion is removed.")
    ]
    fisheye: Annotated[
        bool,
        Switch,
        Field(description="The lens is OpenCV's fisheye: fx,fy,cx,cy,k1,k2,k3,k4."),
    ] = False
    new_matrix: Annotated[
        str | None,
        MATRIX,
        Hyphen,
        Field(
            description="Pinhole camera to rectify for: fx,fy,cx,cy, 9 numbers or a file. "
            "[default: "
            "the lens file's, or the lens's own matrix]"
        ),
    ] = None
    rectify: Annotated[
        str | None,
        MATRIX,
        Hyphen,
        Field(
            description="Rotation from the camera's axes to the pinhole's: 9 numbers or a file. "
            "[default: that of the lens file, or none]"
        ),
    ] = None
    inverse: Annotated[
        bool,
        Switch,
        Field(description="Invert the mapping: add the distortion instead of removing it."),
    ] = False
    size: Annotated[str | None, Field(description=f"{SIZE} [default: the picture's]")] = None

    def aim(self) -> "Aim":
        """Return a function from a picture's height and width to its target.

        Raises ValueError, OSError: the lens, matrix, rotation or size is invalid.
        """
        from resample_texture.command.rendering import calibrated, rectified

        size = None if self.size is None else height_and_width(self.size)
        calibration = calibrated(self.lens, self.new_matrix, self.rectify, fisheye=self.fisheye)
        return lambda shape: rectified(calibration, size or shape, inverse=self.inverse)


def size_of(text: str) -> "AnySize":
    """Read a size: 400, 640x480, 50%, 0.5 or 2x."""
    share = SHARE.fullmatch(text.strip())
    if share is not None and (share[2] is not None or "." in share[1]):
        return float(share[1]) / (100.0 if share[2] == "%" else 1.0)
    if PIXELS.fullmatch(text.strip()) is None:
        raise ValueError(f"size {text!r}; give 400, 640x480, 50%, 0.5 or 2x")
    height, width = height_and_width(text)
    return (height, width) if "x" in text.lower() else height


Files = Annotated[
    list[Picture],
    Parameter(
        help="Pictures, files of several pages, films, folders or quoted patterns such as "
        '"photos/*.jpg", followed by the output unless --output names it.'
    ),
]
Output = Annotated[
    flags.OptionalOutput,
    Parameter(
        help="Written to: .png, .tif, .exr, .webp, .avif or .jpg; for several a folder, or a "
        'quoted pattern such as "small/*.webp"; for pages and frames .tif, .gif, .webp, .apng or '
        ".mp4. [default: the last of the files]"
    ),
]

WRITTEN, BESIDES = Written.usual(), Besides.usual()
NEW_SIZE, WARPING, FILLING = NewSize.usual(), PictureWarping.usual(), Filling.usual()


def resize(
    files: Files,
    /,
    *,
    output: Output = None,
    new: Annotated[NewSize, flags.Flat] = NEW_SIZE,
    warping: Annotated[Filling, flags.Flat] = FILLING,
    written: Annotated[Written, flags.Flat] = WRITTEN,
    besides: Annotated[Besides, flags.Flat] = BESIDES,
) -> None:
    """Resize pictures; each fills its target exactly, or keeps its aspect by --fit.

    For example:

        resample-texture resize sample:bricks small.png --size 100
        resample-texture resize sample:bricks half.jpg --size 50%
        resample-texture resize sample:test-card wide.png --size 640x360 --fit cover
    """
    from resample_texture.command.jobs import warp_all

    new.check()
    warping = new.opened(warping)
    warp_all(files, output, new.target, warping=warping, written=written, besides=besides)


def scale(
    files: Files,
    /,
    *,
    output: Output = None,
    by: Annotated[Factor, flags.Flat],
    warping: Annotated[Filling, flags.Flat] = FILLING,
    written: Annotated[Written, flags.Flat] = WRITTEN,
    besides: Annotated[Besides, flags.Flat] = BESIDES,
) -> None:
    """Scale pictures by an exact factor; their sizes are rounded to whole px.

    For example:

        resample-texture scale sample:bricks half.png --factor 0.5
        resample-texture scale sample:bricks narrow.png --factor 0.5,1
        resample-texture scale sample:test-card large.png --factor 2 --filter lanczos
    """
    from resample_texture.command.jobs import warp_all

    by.check()
    warp_all(files, output, by.target, warping=warping, written=written, besides=besides)


def rotate(
    files: Files,
    /,
    *,
    output: Output = None,
    turn: Annotated[Rotation, flags.Flat],
    warping: Annotated[PictureWarping, flags.Flat] = WARPING,
    written: Annotated[Written, flags.Flat] = WRITTEN,
    besides: Annotated[Besides, flags.Flat] = BESIDES,
) -> None:
    """Rotate pictures about their center; multiples of 90 degrees copy pixels.

    For example:

        resample-texture rotate sample:bricks turned.png --degrees 30
        resample-texture rotate sample:bricks upright.png --degrees 90
        resample-texture rotate sample:bricks level.png --degrees -1.5 --keep-size
    """
    from resample_texture.command.jobs import warp_all

    warp_all(files, output, turn.target, warping=warping, written=written, besides=besides)


def undistort(
    files: Files,
    /,
    *,
    output: Output = None,
    out_of: Annotated[Undistortion, flags.Flat],
    warping: Annotated[PictureWarping, flags.Flat] = WARPING,
    written: Annotated[Written, flags.Flat] = WRITTEN,
    besides: Annotated[Besides, flags.Flat] = BESIDES,
) -> None:
    r"""Remove a lens's distortion from pictures and rectify them, or add it.

    For example:

        resample-texture undistort sample:bricks a.png \
            --lens 400,400,256,256,-0.2,0,0,0
        resample-texture undistort sample:bricks b.png --inverse \
            --lens 400,400,256,256,-0.2,0,0,0
        resample-texture undistort sample:bricks c.png --fisheye \
            --lens 300,300,256,256,0,0,0,0
    """
    from resample_texture.command.jobs import warp_all

    aim = out_of.aim()
    warp_all(files, output, aim, warping=warping, written=written, besides=besides)


class BetweenProjections(Choices):
    """The projections of a picture and of its target."""

    heading: ClassVar[str] = "Target"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    before: Annotated[
        str | None,
        Parameter(name="--from"),
        Field(
            description="What is given: the picture's projection, equirectangular, "
            "cubemap:layout=row, fisheye:fov=180,model=equidistant, stereographic, cylindrical, "
            "perspective:fov=90. [default: none; must be given]"
        ),
    ] = None
    after: Annotated[
        str | None,
        Parameter(name="--to"),
        Field(
            description="Projection of the target, as for --from. [default: none; must be given]"
        ),
    ] = None
    size: Annotated[str | None, Field(description=f"{SIZE} [default: none; must be given]")] = None
    turn: Annotated[
        str,
        Hyphen,
        Field(description="Turn the view right, up and clockwise by degrees: 30,10 or 30,10,5."),
    ] = "0,0,0"

    def check(self) -> None:
        """Refuse unknown projections, and a size or angles that are none."""
        from resample import registry

        before, after, shape = self.given()
        registry.check("projections", (before,))
        registry.build("projections", after).check(shape)
        self.angles()

    def given(self) -> tuple[str, str, tuple[int, int]]:
        """Return both projections, and height and width of the target, px.

        Raises ValueError: one is missing, or the size is none.
        """
        if self.before is None or self.after is None or self.size is None:
            options = {"--from": self.before, "--to": self.after, "--size": self.size}
            missing = " and ".join(name for name, value in options.items() if value is None)
            raise ValueError(f"give {missing}, too, such as --to perspective:fov=70 --size 640x480")
        return self.before, self.after, height_and_width(self.size)

    def angles(self) -> tuple[float, float, float]:
        """Return the angles in degrees.

        Raises ValueError: these are not two or three finite numbers.
        """
        from resample_texture.geometry.projections import rotation

        try:
            right, up, clockwise = (*map(float, parts_of(self.turn)), 0.0)[:3]
            rotation((right, up, clockwise))
        except ValueError:
            complaint = f"turn {self.turn!r}; give degrees right,up or right,up,clockwise, 30,10,0"
            raise ValueError(complaint) from None
        return right, up, clockwise

    def target(self, source_shape: tuple[int, int]) -> "PictureTarget":
        """Return the target of a picture (height, width)."""
        from resample import registry
        from resample_texture.command.rendering import PictureTarget
        from resample_texture.everyday import project
        from resample_texture.geometry.matrices import resizing

        before, after, shape = self.given()
        registry.build("projections", before).check(source_shape)
        angles: dict[str, Any] = {"turn": self.angles()}
        draws = partial(project, source=before, target=after, shape=shape, **angles)
        return PictureTarget(resizing(source_shape, shape), shape, draws)


PROJECTING = BetweenProjections.usual()
FILTERING, REPORTS = PictureFiltering.usual(), Reports.usual()


def project(
    files: Files,
    /,
    *,
    output: Output = None,
    projecting: Annotated[BetweenProjections, flags.Flat] = PROJECTING,
    filtering: Annotated[PictureFiltering, flags.Flat] = FILTERING,
    written: Annotated[Written, flags.Flat] = WRITTEN,
    reports: Annotated[Reports, flags.Flat] = REPORTS,
) -> None:
    r"""Show pictures of one projection in another, without seams: panoramas, cube maps, fisheyes.

    For example:

        resample-texture project sample:bricks a.png --size 400 \
            --from perspective:fov=90 --to fisheye:fov=90
        resample-texture project sample:bricks b.png --size 640x480 --turn 30,10 \
            --from fisheye:fov=180 --to perspective:fov=70
        resample-texture project sample:bricks c.png --size 400x200 \
            --from stereographic --to equirectangular
    """
    from resample_texture.command.jobs import warp_all

    projecting.check()
    warping = PictureWarping(**dict(filtering))
    besides = Besides(**dict(reports))
    warp_all(files, output, projecting.target, warping=warping, written=written, besides=besides)
