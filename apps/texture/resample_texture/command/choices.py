"""Options of the command line: targets, methods and outputs of warps."""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from cyclopts import Parameter
from pydantic import Field

from resample.command.flags import (
    CALIBRATED,
    COUNTED,
    LENS,
    SIZE,
    Coverage,
    Hyphen,
    Inline,
    OptionTopic,
    Stats,
    Switch,
)
from resample.command.settings import Choices, Convention, MethodsFilter, Threads, height_and_width
from resample.files import stores
from resample.messages import numbers_in, parts_of

if TYPE_CHECKING:
    from resample.cameras.calibrations import Calibration
    from resample_texture.arguments import AnySize, Places
    from resample_texture.geometry.mappings import Geometry
    from resample_texture.types import Warped

INTERPOLATIONS = (
    "Interpolation between texels: area-spline, lanczos, spline, catmull-rom, "
    "bilinear, nearest, gaussian."
)
MATRIX = Inline(rule="resample_texture.geometry.matrices:is_file")
PIXELS = re.compile(r"\d{1,9}([xX]\d{1,9})?", re.ASCII)
SHARE = re.compile(r"(\d+|\d*\.\d+|\d+\.)\s*(%|x)?", re.ASCII)
Fit = Literal["contain", "cover", "stretch", "pad"]
Edges = Literal["transparent", "clamp", "wrap", "mirror"]
Edge = Annotated[Edges, Field(description="What lies beyond the picture's edges.")]


Picture = Annotated[
    Path | stores.Address,
    Parameter(
        converter=lambda _kind, words: stores.place_of(words[-1].value),
        n_tokens=1,
        accepts_keys=False,
    ),
]


@dataclass(frozen=True, eq=False)
class PictureTarget:
    """Geometry and size of a warp's target."""

    places: "Geometry | Places"
    shape: tuple[int, int]  # height and width, px
    draws: "Callable[..., Warped] | None" = None  # of a picture and options, if no geometry is

    @cached_property
    def geometry(self) -> "Geometry":
        """Geometry, evaluated for the whole target."""
        from resample_texture.arguments import geometry_of

        return geometry_of(self.places, self.shape, "corner", inverse=False)


Aim = Callable[[tuple[int, int]], PictureTarget]  # from a picture's height and width


def rectified(
    calibration: "Calibration", shape: tuple[int, int], *, inverse: bool
) -> PictureTarget:
    """Return the target (height, width) that removes a lens's distortion, or adds it."""
    from resample_texture.geometry.cameras import places_by_lens

    camera, pinhole, rotation, _ = calibration
    places = places_by_lens(camera, ideal=pinhole, rotation=rotation, inverse=inverse)
    return PictureTarget(places, shape)


class TargetChoices(Choices):
    """Options of a warp's target."""

    heading: ClassVar[str] = "Target"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE


class WarpGeometry(TargetChoices):
    """The target of a warp, given by one of matrix, corners, map, flow and lens."""

    matrix: Annotated[
        str | None,
        MATRIX,
        Hyphen,
        Field(
            description="3 x 3 homography or 2 x 3 affine map from source to target: 9 or 6 "
            "numbers, or a text or .npy file; pixel centers at + 0.5."
        ),
    ] = None
    corners: Annotated[
        str | None,
        Hyphen,
        Field(
            description="x,y of four corners: where the picture's top left, top right, bottom "
            "right and bottom left go; or four points of the source -> four of the target."
        ),
    ] = None
    map: Annotated[
        Path | None,
        OptionTopic.SOURCE,
        Field(
            description="File of the source coordinates of every target pixel: .npy (H, W, 2), "
            ".npz with x and y, or a picture of two channels; pixel centers at + 0.5."
        ),
    ] = None
    flow: Annotated[
        Path | None,
        OptionTopic.SOURCE,
        Field(
            description="Displacement of every source pixel: a .flo file, or a file as for --map."
        ),
    ] = None
    lens: Annotated[
        str | None, LENS, Hyphen, Field(description=f"{CALIBRATED}. Its distortion is removed.")
    ] = None
    convention: Annotated[Convention, Field(description=f"{COUNTED} matrix, corners and map.")] = (
        "corner"
    )
    inverse: Annotated[
        bool,
        Switch,
        Field(
            description="Invert the mapping: the matrix maps target to source; a lens's distortion "
            "is added."
        ),
    ] = False
    size: Annotated[
        str | None,
        Field(description=f"{SIZE} [default: the source's; the map's; or just holds the corners]"),
    ] = None

    def check(self) -> None:
        """Reject a wrong target before any picture is read."""
        self.given()
        self.shape()

    def given(self) -> tuple[str, Any]:
        """Return name and value of the option that was given."""
        names = ("matrix", "corners", "map", "flow", "lens")
        given = [(name, getattr(self, name)) for name in names if getattr(self, name) is not None]
        if len(given) != 1:
            flags = ", ".join(f"--{name}" for name in names)
            found = " and ".join(f"--{name}" for name, _ in given) or "none"
            raise ValueError(f"give one of {flags}, not {found}")
        return given[0]

    def shape(self) -> tuple[int, int] | None:
        """Return height and width of the target, px, if given."""
        return None if self.size is None else height_and_width(self.size)

    def target(self, source_shape: tuple[int, int]) -> PictureTarget:
        """Return geometry and size for a source (height, width)."""
        name, given = self.given()
        if name == "matrix":
            from resample_texture.geometry.matrices import homography, parse_matrix

            convention, matrix = self.convention, parse_matrix(given)
            geometry = homography(matrix, convention=convention, inverse=self.inverse)
            return PictureTarget(geometry, self.shape() or source_shape)
        if name == "lens":
            from resample.cameras.calibrations import read_calibration

            shape, calibration = self.shape() or source_shape, read_calibration(given, None)
            return rectified(calibration, shape, inverse=self.inverse)
        if self.inverse:
            raise ValueError(f"--inverse applies to a matrix or a lens, not to a {name}")
        shift = 0.5 if self.convention == "opencv" else 0.0
        if name == "corners":
            from resample_texture.geometry.matrices import from_corners, page_corners, parse_points

            before, arrow, after = given.partition("->")
            points = parse_points(before) + shift
            source = points if arrow else page_corners(source_shape)
            target = parse_points(after) + shift if arrow else points
            right, bottom = target.max(axis=0)
            bounds = max(1, math.ceil(bottom)), max(1, math.ceil(right))
            return PictureTarget(from_corners(source, target), self.shape() or bounds)
        from resample_texture.geometry.mappings import ForwardMap, places_by_map, read_map

        pairs = read_map(given)
        shape = pairs.shape[0], pairs.shape[1]
        if name == "flow":
            if shape != source_shape:
                raise ValueError(
                    f"{given} is a flow of {shape[1]} x {shape[0]} pixels, the picture "
                    f"has {source_shape[1]} x {source_shape[0]}"
                )
            return PictureTarget(ForwardMap.from_flow(pairs), self.shape() or source_shape)
        if self.shape() not in (None, shape):
            raise ValueError(
                f"{given} is a map of {shape[1]} x {shape[0]} pixels, and so is what it makes; "
                "leave out the size"
            )
        return PictureTarget(places_by_map(pairs, shift), shape)


class PictureFiltering(Choices):
    """Conversion of texels to pixels."""

    heading: ClassVar[str] = "Method"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    method: Annotated[
        str,
        Field(
            description="Method: hybrid, paper, bilinear, opencv-supersample:n=8 ...; "
            "see resample plugins."
        ),
    ] = "hybrid"
    filter: MethodsFilter = None
    interpolation: Annotated[
        str | None,
        Field(description=f"{INTERPOLATIONS} [default: the method's own; area-spline for hybrid]"),
    ] = None
    quality: Annotated[
        float | None,
        Field(
            description="Parts per target px that texels are split into, 1 to 16. [default: 1.5 "
            "for hybrid]"
        ),
    ] = None
    linear: Annotated[bool, Field(description="Average linear light, or encoded values.")] = True
    encoding: Annotated[
        Literal["auto", "srgb", "linear"],
        Field(
            description="How the file encodes light in integers. Auto: as it says by a profile or "
            "mark; else 8 bits are sRGB and 16 bits linear."
        ),
    ] = "auto"
    threads: Threads = None

    @property
    def sampling(self) -> dict[str, Any]:
        """Options of the method, by its own names."""
        return self.model_dump(include={"filter", "interpolation", "quality"})

    def check(self) -> None:
        """Reject unknown names before any work is done."""
        from resample import registry

        for group, name in (
            ("methods", self.method),
            ("filters", self.filter),
            ("interpolations", self.interpolation),
        ):
            if name is not None:
                registry.build(group, name)


class PictureWarping(PictureFiltering):
    """Options of a warp."""

    edge: Edge = "transparent"
    total: Annotated[
        bool,
        Switch,
        Field(description="Values are totals, such as flux: preserve their sum, not their mean."),
    ] = False


class Filling(PictureWarping):
    """Options of a warp that fills its target, so that its edges must not fade."""

    edge: Edge = "clamp"


class Reports(Choices):
    """Files written in addition to a picture."""

    heading: ClassVar[str] = "Further outputs"
    about: ClassVar[OptionTopic] = OptionTopic.TARGET

    coverage: Coverage = None
    stats: Stats = None


class Outputs(Reports):
    """The part of a warp to write, and further files."""

    roi: Annotated[
        str | None,
        OptionTopic.APPEARANCE,
        Field(
            description="Write only this part of the target: left,top,width,height in px. "
            "[default: all of it]"
        ),
    ] = None


def region(text: str | None) -> tuple[int, int, int, int] | None:
    """Read left, top, width and height from a text such as 10,20,300,200."""
    if text is None:
        return None
    match = re.fullmatch(r"\s*(\d+)[,\s]+(\d+)[,\s]+(\d+)[,\s]+(\d+)\s*", text, re.ASCII)
    if match is None:
        raise ValueError(f"roi {text!r}; give left,top,width,height in whole px, such as 0,0,64,64")
    left, top, width, height = (int(number) for number in match.groups())
    return left, top, width, height


class NewSize(TargetChoices):
    """The new size of a picture."""

    size: Annotated[
        str | None,
        Field(
            description="Size in px: 400 for the longer side, 640x480 for width and height; or of "
            "the picture's: 50%, 0.5 or 2x. [default: by --width and --height]"
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
        """Reject a wrong size before any picture is read."""
        self.model_copy(update={"box": None}).target((1, 1))
        self._part()

    def target(self, source_shape: tuple[int, int]) -> PictureTarget:
        """Return the target of a picture (height, width)."""
        from resample_texture.arguments import resized

        size = None if self.size is None else size_of(self.size)
        sides: dict[str, Any] = {"height": self.height, "width": self.width, "fit": self.fit}
        return PictureTarget(*resized(source_shape, size, **sides, box=self._part()))

    def _part(self) -> list[float] | None:
        return None if self.box is None else numbers_in("box", self.box)

    def opened(self, warping: Filling) -> Filling:
        """Return options that leave padding empty, unless an edge mode was given."""
        is_open = self.fit == "pad" and "edge" not in warping.model_fields_set
        return warping.model_copy(update={"edge": "transparent"}) if is_open else warping


class Factor(TargetChoices):
    """The factor by which a picture is scaled."""

    factor: Annotated[
        str, Hyphen, Field(description="For both sides, such as 0.5, or x,y, such as 0.5,0.25.")
    ]

    def check(self) -> None:
        """Reject a wrong factor before any picture is read."""
        self.target((1, 1))

    def target(self, source_shape: tuple[int, int]) -> PictureTarget:
        """Return the target of a picture (height, width)."""
        from resample_texture.geometry.matrices import scaled_shape, scaling

        numbers = numbers_in("factor", self.factor)
        if len(numbers) > 2:
            raise ValueError(f"factor {self.factor!r}; give one, or two: along x and y")
        factor = numbers[0], numbers[-1]
        shape = scaled_shape(source_shape, factor)
        return PictureTarget(scaling(factor), shape)


class Rotation(TargetChoices):
    """The angle by which a picture is rotated."""

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

    def target(self, source_shape: tuple[int, int]) -> PictureTarget:
        """Return the target of a picture (height, width)."""
        from resample_texture.geometry.matrices import turned_shape, turning

        shape = turned_shape(source_shape, self.degrees) if self.expand else source_shape
        return PictureTarget(turning(source_shape, self.degrees, shape), shape)


class Undistortion(TargetChoices):
    """Lens for undistortion, and the pinhole camera to rectify for."""

    lens: Annotated[
        str, LENS, Hyphen, Field(description=f"{CALIBRATED}. Its distortion is removed.")
    ]
    fisheye: Annotated[
        bool, Switch, Field(description="The lens is OpenCV's fisheye: fx,fy,cx,cy,k1,k2,k3,k4.")
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
            "[default: the lens file's, or none]"
        ),
    ] = None
    inverse: Annotated[
        bool,
        Switch,
        Field(description="Invert the mapping: add the distortion instead of removing it."),
    ] = False
    size: Annotated[str | None, Field(description=f"{SIZE} [default: the picture's]")] = None

    def aim(self) -> Aim:
        """Return a function from a picture's height and width to its target."""
        from resample.cameras.calibrations import pinhole_of, read_calibration
        from resample.cameras.models import LensModel
        from resample.cameras.poses import turned_by
        from resample.messages import naming
        from resample_texture.geometry.matrices import parse_matrix

        size = None if self.size is None else height_and_width(self.size)
        calibration = read_calibration(self.lens, LensModel.FISHEYE if self.fisheye else None)
        if self.new_matrix is not None:
            with naming("--new-matrix"):
                try:
                    numbers = [float(one) for one in self.new_matrix.replace(",", " ").split()]
                except ValueError:  # a file
                    numbers = []
                given = numbers if len(numbers) == 4 else parse_matrix(self.new_matrix)
                calibration = calibration._replace(pinhole=pinhole_of(given))
        if self.rectify is not None:
            with naming("--rectify"):
                calibration = calibration._replace(rotation=turned_by(parse_matrix(self.rectify)))
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


class BetweenProjections(TargetChoices):
    """The projections of a picture and of its target."""

    before: Annotated[
        str | None,
        Parameter(name="--from"),
        Field(
            description="Projection of the given picture: equirectangular, "
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
        """Reject unknown projections, and invalid sizes or angles."""
        from resample import registry

        before, after, shape = self.given()
        registry.check("projections", (before,))
        registry.build("projections", after).check(shape)
        self.angles()

    def given(self) -> tuple[str, str, tuple[int, int]]:
        """Return both projections, and height and width of the target, px."""
        if self.before is None or self.after is None or self.size is None:
            options = {"--from": self.before, "--to": self.after, "--size": self.size}
            missing = " and ".join(name for name, value in options.items() if value is None)
            raise ValueError(f"give {missing}, too, such as --to perspective:fov=70 --size 640x480")
        return self.before, self.after, height_and_width(self.size)

    def angles(self) -> tuple[float, float, float]:
        """Return the three angles in degrees."""
        from resample_texture.geometry.projections import rotation

        try:
            right, up, clockwise = (*map(float, parts_of(self.turn)), 0.0)[:3]
            rotation((right, up, clockwise))
        except ValueError:
            complaint = f"turn {self.turn!r}; give degrees right,up or right,up,clockwise, 30,10,0"
            raise ValueError(complaint) from None
        return right, up, clockwise

    def target(self, source_shape: tuple[int, int]) -> PictureTarget:
        """Return the target of a picture (height, width)."""
        from resample import registry
        from resample_texture.everyday import project
        from resample_texture.geometry.matrices import resizing

        before, after, shape = self.given()
        registry.build("projections", before).check(source_shape)
        angles: dict[str, Any] = {"turn": self.angles()}
        draws = partial(project, source=before, target=after, shape=shape, **angles)
        return PictureTarget(resizing(source_shape, shape), shape, draws)
