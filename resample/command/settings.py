"""Options that mean the same in every application, as the command lines and files give them.

One model serves flags, TOML files and checks. Importing this module imports no numerics: `--help`
stays quick.
"""

import re
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from resample.command.about import About
from resample.console.backgrounds import SPLAT_COLOR, Color, linear_color

if TYPE_CHECKING:
    from resample.files.pictures import Look
    from resample.resampler import Resampler

OF_SAMPLES = ("method", "footprint", "threshold", "kernel", "opacity", "color_by")

# What descriptions begin with.
SIZE = "In px: 400 for a square, 640x480 for width and height."
CALIBRATED = (
    "Lens: fx,fy,cx,cy,k1,k2,p1,p2[,k3...], or a .yml, .xml, .json or .toml file of OpenCV's "
    "calibration"
)
MEMORY = "Memory that the work may take: 2GiB. What is free"
COUNTED = "Opencv counts from the first pixel's center: in"

CAMERA, LIGHT, SETTINGS, LIMITS = (
    "Camera",
    "Light",
    "Settings",
    "Limits",
)  # headings of options that many have
HEADINGS = (  # in the order of a command's help
    *(
        "Input",
        "Source's camera",
        "Several sources",
        "Also in the scene",
        "Target",
        "Look",
        LIGHT,
        CAMERA,
        "Eyes",
    ),
    *(
        "Projection",
        "Method",
        "Picture",
        "Beside the volume",
        "Beside the picture",
        "Page",
        "Workers",
        SETTINGS,
        LIMITS,
    ),
)
Convention = Literal["corner", "opencv"]
Threads = Annotated[
    int | None,
    About.RESOURCE,
    Field(ge=1, description="At most this many; pixels do not depend on it."),
]
MethodsFilter = Annotated[
    str | None, Field(description="Pixel filter, such as gaussian:sigma=0.6. The method's.")
]
Shown = Annotated[
    Literal["composite", "maximum", "minimum", "average", "additive", "xray", "first-hit"],
    Field(
        description="What a pixel shows: light through what lies in front, the largest, least, "
        "mean or sum of the values, an X-ray of computed tomography, or the surface of the iso "
        "value."
    ),
]
Iso = Annotated[
    float | None, Field(allow_inf_nan=False, description="Value whose surface first-hit shows.")
]


def number(given: object) -> object:
    """Number that a word of the command line stands for; pydantic's literals do not convert it."""
    return int(given) if isinstance(given, str) and given.isdecimal() else given


class Choices(BaseModel):
    """What a user chooses. It stays as it was made; names that it does not know are refused."""

    heading: ClassVar[str]  # over these options in a command's help
    about: ClassVar[About]  # of the options that do not say it themselves

    # What checks a model is built when it is first given something: most commands need few.
    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)

    @classmethod
    def usual(cls) -> Self:
        """Choices of which none is given. They need no check, which would have to be built."""
        return cls.model_construct()


class Resampling(Choices):
    """How samples become a picture."""

    heading: ClassVar[str] = "Method"
    about: ClassVar[About] = About.LOOK

    method: Annotated[
        Literal["hybrid", "points", "splats", "paper", "inflate", "ewa"] | None,
        Field(
            description="How: points where samples shrink and splats where they grow (hybrid), or "
            "one of them (splats alone are not antialiased); paper: as published, threshold 1 px; "
            "inflate, ewa: splats antialiased as by Swan 1997 and Zwicker 2001. Hybrid, where "
            "samples are painted at all."
        ),
    ] = None
    footprint: Annotated[
        Literal["exact", "corrected", "small-angle", "affine", "disc"] | None,
        Field(
            description="Model of splats in perspective. Exact, but corrected for paper, and "
            "affine for inflate and ewa."
        ),
    ] = None
    threshold: Annotated[
        float | None,
        Field(ge=0, description="Points are what lies at most this many sub-pixels apart."),
    ] = None
    subpixels: Annotated[
        int | None,
        Field(ge=1, le=32, description="Sub-pixels per side of a pixel. Chosen per region."),
    ] = None
    filter: Annotated[
        str | None, Field(description="Pixel filter, such as gaussian:sigma=0.6. Box.")
    ] = None
    kernel: Annotated[str, Field(description="Reconstruction kernel.")] = "gaussian"
    order: Annotated[
        str | None,
        Field(
            description="Compositing order: every-sample, axis-sheets, or image-sheets:thickness=1."
            " Fields and their projections are gathered along rays:step=1,sharpness=1,quality=best "
            "(or usual, or fast), or take image-sheets, too. Maxima and minima stay within voxels "
            "around a place, but for rays:interpolation=spline."
        ),
    ] = None
    projection: Shown = "composite"
    iso: Iso = None
    opacity: Annotated[
        Literal["exact", "linear"],
        Field(description="Exact transmittance of the field, or classic splatting's product."),
    ] = "exact"
    color_by: Annotated[
        Literal["sample", "primitive"],
        Field(description="What colors mean: what samples look like, or primitive, splats in red."),
    ] = "sample"

    @property
    def is_of_samples(self) -> bool:
        """Whether something is said of how samples are painted, which rays do not paint."""
        own = type(self).model_fields
        return any(getattr(self, name) != own[name].default for name in OF_SAMPLES)

    def resampler(self, *, of_field: bool = False, quality: str = "best") -> "Resampler":
        """Renderer with these choices; fields are gathered along rays unless an order was chosen.

        Parameters
        ----------
        of_field
            Values get their colors after they are reconstructed.
        quality
            Of rays, if no order was chosen.

        Raises
        ------
        ValueError, LookupError
            A plugin is unknown or refuses its parameters.
        """
        from resample import registry
        from resample.painting.choices import Footprint, Opacity, Primitive, Projection
        from resample.resampler import Resampler

        is_of_field = of_field or self.projection != "composite"
        own = f"rays:quality={quality}" if is_of_field else "every-sample"
        return Resampler(
            primitive=Primitive(self.method or Primitive.HYBRID),
            footprint=None if self.footprint is None else Footprint(self.footprint),
            pixel_filter=None if self.filter is None else registry.build("filters", self.filter),
            reconstruction=registry.build("reconstructions", self.kernel),
            order=registry.build("orders", self.order or own),
            threshold=self.threshold,
            subpixels=self.subpixels,
            opacity=Opacity(self.opacity),
            projection=Projection(self.projection),
            iso=self.iso,
            splat_color=SPLAT_COLOR if self.color_by == "primitive" else None,
        )


class PictureFormat(Choices):
    """What kind of picture is written."""

    heading: ClassVar[str] = "Picture"
    about: ClassVar[About] = About.LOOK

    size: Annotated[str, Field(description=SIZE)] = "400"
    background: Annotated[
        str | None,
        Field(
            description="Behind the picture: black, white, #rrggbb or none for transparent. EXR: "
            "none, others: black."
        ),
    ] = None
    bits: Annotated[
        Literal[8, 16, 32],
        BeforeValidator(number),
        Field(description="Per channel: PNG 8 or 16, TIFF also 32."),
    ] = 8
    threads: Threads = None

    def behind(self, suffix: str) -> Color | None:
        """Linear color behind the picture in a file of a suffix; None leaves it transparent."""
        own = "none" if suffix.lower() == ".exr" else "black"
        return linear_color(own if self.background is None else self.background)

    def height_and_width(self) -> tuple[int, int]:
        """Size in px.

        Raises
        ------
        ValueError
            It is not one or two whole numbers above 0, or more than a picture can hold.
        """
        from resample.painting.scenes.plans import check_size

        match = re.fullmatch(r"(\d{1,9})(?:[xX](\d{1,9}))?", self.size.strip(), re.ASCII)
        if match is None:
            raise ValueError(f"size {self.size!r}; give 400 or 640x480")
        width, height = int(match[1]), int(match[2] or match[1])
        check_size(height, width)
        return height, width


class Sharing(Choices):
    """Who does the work."""

    heading: ClassVar[str] = "Workers"
    about: ClassVar[About] = About.RESOURCE

    workers: Annotated[
        int | None,
        Field(
            ge=1,
            le=1024,
            description="Processes of this machine that share the work, with the extra dist; they "
            "share the memory, too. Pixels do not depend on it.",
        ),
    ] = None
    scheduler: Annotated[
        str | None,
        About.TARGET,
        Field(
            description="Address of a scheduler of dask's whose workers do it, such as "
            "tcp://10.0.0.1:8786; they see the same files under the same names."
        ),
    ] = None

    @property
    def is_asked(self) -> bool:
        """Whether others than this process do it."""
        return self.workers is not None or self.scheduler is not None

    @property
    def who(self) -> str:
        """Who does it, for a user's eyes."""
        if self.workers is None:
            return f"the workers of {self.scheduler}"
        return f"{self.workers} {'process' if self.workers == 1 else 'processes'}"


class Serving(Choices):
    """Where a viewer's page is served."""

    heading: ClassVar[str] = "Page"
    about: ClassVar[About] = About.TARGET

    host: Annotated[
        str, Field(description="Address to listen at; others than this machine's are warned about.")
    ] = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535, description="0 takes one that is free.")] = 0
    browser: Annotated[bool, Field(description="Open the page in the browser.")] = True


class Written(Choices):
    """How a picture of any kind is written."""

    heading: ClassVar[str] = "Picture"
    about: ClassVar[About] = About.LOOK

    background: Annotated[
        str | None,
        Field(
            description="Behind the picture: black, white, #rrggbb or none for transparent. None."
        ),
    ] = None
    bits: Annotated[
        Literal[8, 16, 32] | None,
        BeforeValidator(number),
        Field(description="Per channel: PNG 8 or 16, TIFF also 32. As the source where it fits."),
    ] = None

    def look(self) -> "Look":
        """Choices of the writer.

        Raises
        ------
        ValueError
            The background is no color.
        """
        from resample.files.pictures import Look

        behind = None if self.background is None else linear_color(self.background)
        return Look(self.bits, behind)


def height_and_width(size: str) -> tuple[int, int]:
    """Size in px of 400 or 640x480.

    Raises
    ------
    ValueError
        See `PictureFormat.height_and_width`.
    """
    return PictureFormat(size=size).height_and_width()


def method_names(text: str, least: int = 1) -> list[str]:
    """Methods of a list separated by commas.

    A part with = but without a name: before it is a further parameter of the method before it, as
    in `oiio:filter=cubic,opencv-supersample:n=4,kernel=linear`.

    Raises
    ------
    ValueError
        There are fewer than `least`.
    """
    names: list[str] = []
    for part in filter(None, (word.strip() for word in text.split(","))):
        if names and "=" in part and ":" not in part.partition("=")[0]:
            names[-1] += f",{part}"
        else:
            names.append(part)
    if len(names) < least:
        raise ValueError("give methods to compare, such as bilinear,hybrid")
    return list(dict.fromkeys(names))
