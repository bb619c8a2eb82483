"""Options shared by all applications, on command lines and in settings files.

One model defines flags, TOML keys and checks. This module imports no numerics, so that `--help` is
fast.
"""

import inspect
import json
import logging
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial, wraps
from pathlib import Path, PurePath
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Literal,
    NoReturn,
    Self,
    get_args,
    get_origin,
    get_type_hints,
)

from cyclopts import App, ArgumentCollection, Parameter
from cyclopts.argument import Argument
from cyclopts.config import Dict
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    TypeAdapter,
    ValidationError,
    model_validator,
)

from resample import memory as memories
from resample.calling import REMEDIES, answer, choice_meant
from resample.command.flags import (
    LIMITS,
    MEMORY,
    SETTINGS,
    SIZE,
    SQUARE,
    USUAL_SIZE,
    Marks,
    OptionTopic,
    Switch,
    about,
    marks_of,
    model_in,
    name_of,
    under,
)
from resample.command.stopping import at_most
from resample.console import SPLAT_COLOR, Color, background_in
from resample.files.metadata.tags import SUFFIXES as PICTURES
from resample.files.metadata.tags import settings_in, stating
from resample.files.writing import check_targets, replacing
from resample.messages import naming, one_line
from resample.reading.limits import raised
from resample.reading.texts import text_of, toml_of

Command = Callable[..., Any]
Settings = dict[str, Any]

COMMAND = "command"  # the key that names the command
LOG = logging.getLogger("resample")
OWN = ("settings", "settings-trusted", "save-settings")
# Options that all commands have: type, default, what they are about, heading and help.
COMMON: dict[str, tuple[Any, object, OptionTopic, str, str]] = {
    "settings": (
        *(Path | None, None, OptionTopic.TRUST, SETTINGS),
        "Read the look from a .toml, or from a PNG or EXR that this command made; options on "
        "the command line take precedence.",
    ),
    "settings_trusted": (
        *(Path | None, None, OptionTopic.TRUST, SETTINGS),
        "Like --settings, for a .toml that you wrote yourself: it may also set inputs, "
        "outputs and resources.",
    ),
    "save_settings": (
        *(Path | None, None, OptionTopic.TRUST, SETTINGS),
        "Also write the look, without inputs and outputs (.toml).",
    ),
    "memory": (
        *(str | None, None, OptionTopic.RESOURCE, LIMITS),
        f"{MEMORY}. [default: all free memory]",
    ),
    "limit": (
        *(str | None, None, OptionTopic.TRUST, LIMITS),
        "Limits on untrusted files: unpacked=8GiB,ratio=5000; of text, tree, depth, items, "
        "unpacked, ratio. [default: far above what ordinary files need]",
    ),
    "allow_outside": (
        *(bool, False, OptionTopic.TRUST, LIMITS),
        "Allow files to refer to files outside their folder.",
    ),
}


def with_settings(app: App) -> None:
    """Add the common options to every command of an application that has options.

    They are `--settings`, `--settings-trusted`, `--save-settings`, `--memory`, `--limit` and
    `--allow-outside`.
    """
    app.config = (partial(_take, app.name[0]),)
    named = (inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    for name in app:
        command = None if name.startswith("-") else app[name].default_command
        # The signature tells: to assemble all commands as the parser does takes 0.1 s.
        parts = inspect.signature(command).parameters.values() if command is not None else ()
        if command and any(part.kind in named and part.name != "output" for part in parts):
            app[name].default_command = keeping_settings(f"{app.name[0]} {name}", command)


def options_of(command: App) -> dict[str, Argument]:
    """Options of a command by name without hyphens; positional arguments are left out."""
    return _options(command.assemble_argument_collection())


def schema_of(name: str, command: App) -> dict[str, Any]:
    """JSON schema of a command's settings; any file may set entries with `about` = `look`."""
    properties: dict[str, Any] = {COMMAND: {"const": name}}
    assert command.default_command is not None
    marks = marks_of(command.default_command)
    for key, argument in options_of(command).items():
        mark = marks[key]
        if mark is OptionTopic.TRUST:
            continue
        adapter: TypeAdapter[Any] = TypeAdapter(argument.field_info.annotation)
        described = adapter.json_schema()
        described["about"] = mark.value if isinstance(mark, OptionTopic) else "look, or source"
        default = argument.field_info.default
        if default not in (None, inspect.Parameter.empty):
            described["default"] = adapter.dump_python(default, mode="json")
        if argument.parameter.help:
            described["description"] = argument.parameter.help
        properties[key] = described
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": name,
        "type": "object",
        "properties": properties,
        "additionalProperties": False,
    }


def read_settings(
    path: Path,
    name: str,
    options: Mapping[str, Argument],
    marks: Marks,
    *,
    is_trusted: bool = False,
) -> Settings:
    """Read options of a command from a file and convert their types.

    Options that are not about the look are left out with a warning.
    """
    is_picture = path.suffix.lower() in PICTURES
    if is_picture and is_trusted:
        raise ValueError(f"{path} is a picture; trust a .toml that you wrote yourself")
    text = settings_in(path) if is_picture else text_of(path)
    left_out: list[str] = []
    with naming(str(path)):
        content = toml_of(text)
        owner = content.pop(COMMAND, name)
        if owner != name:
            raise ValueError(f"these are settings of {owner!r:.60}; give some of {name!r}")
        for key, value in list(content.items()):
            if key not in options:
                from resample.command.usage_errors import meant

                near = meant(key, options)
                hint = f"did you mean {near}?" if near else "--help lists what there is"
                raise ValueError(f"there is no option {key!r:.60}; {hint}")
            if not _may_say(about(marks.get(key), value), is_trusted=is_trusted):
                left_out.append(key)
                del content[key]
                continue
            adapter: TypeAdapter[Any] = TypeAdapter(options[key].field_info.annotation)
            with naming(key):
                adapter.validate_json(json.dumps(value, default=_refuse_time), strict=True)
    if left_out:
        instead = "" if is_picture else ", or trust your own file by --settings-trusted"
        why = "as settings only set a picture's look, not inputs, outputs, resources or trust"
        remedy = f"give these on the command line{instead}"
        LOG.warning("%s: %s left out, %s; %s", path, ", ".join(left_out), why, remedy)
    return content


def appearance_settings(settings: Settings, marks: Marks) -> Settings:
    """Select the settings that affect the look: these are saved in files."""
    return {key: value for key, value in settings.items() if _may_say(about(marks.get(key), value))}


def _may_say(subject: OptionTopic | None, *, is_trusted: bool = False) -> bool:
    """Whether a file may set an option of this category."""
    if is_trusted:
        return subject is not None and subject is not OptionTopic.TRUST
    return subject is OptionTopic.APPEARANCE


def as_toml(name: str, settings: Settings) -> str:
    """Format settings as the text of a file."""
    lines = [f"{key} = {_toml(value)}" for key, value in {COMMAND: name, **settings}.items()]
    return "\n".join(lines) + "\n"


def _options(arguments: ArgumentCollection) -> dict[str, Argument]:
    names = ((next(iter(argument.names), ""), argument) for argument in arguments)
    return {name[2:]: argument for name, argument in names if name.startswith("--")}


def _take(
    application: str,
    app: App,
    commands: tuple[str, ...],
    given: ArgumentCollection,
) -> None:
    """Add options from the file given by `--settings` that the command line leaves open."""
    named = {one.field_info.name: one.tokens for one in given if one.tokens}
    named = {key: named[key] for key in ("settings", "settings_trusted") if key in named}
    if not named:  # told without the names of all options, which take 10 ms
        return
    if len(named) > 1:
        raise ValueError("give one of --settings and --settings-trusted, not both")
    ((key, tokens),) = named.items()
    path = Path(tokens[-1].value)
    known = {key: option for key, option in _options(given).items() if key not in OWN}
    assert app.default_command is not None
    content: Settings = read_settings(
        path,
        " ".join([application, *commands]),
        known,
        marks_of(app.default_command),
        is_trusted=key == "settings_trusted",
    )
    for one in reversed(commands):
        content = {one: content}
    Dict(content, source=str(path))(app, commands, given)


def _refuse_time(value: object) -> NoReturn:
    """Reject a value that TOML has and JSON lacks."""
    raise ValueError(f"no option takes a date or time (got {value})")


def keeping_settings(name: str, command: Command) -> Command:
    """Wrap a command so that it reads and saves settings, within limits."""
    signature = inspect.signature(command)

    @wraps(command)
    def run(
        *inputs: Any,
        settings: Path | None = None,
        settings_trusted: Path | None = None,
        save_settings: Path | None = None,
        memory: str | None = None,
        limit: str | None = None,
        allow_outside: bool = False,
        **options: Any,
    ) -> Any:
        marks = marks_of(command)
        chosen = dict(_chosen(command, signature, options))
        text = as_toml(name, appearance_settings(chosen, marks))
        with (
            memories.allowing(memory),
            at_most(chosen.get("threads")),
            raised(limit, allow_outside=allow_outside),
            stating(text),
        ):
            if save_settings is None:
                return command(*inputs, **options)
            check_targets(save_settings, settings or settings_trusted, options.get("output"))
            result = command(*inputs, **options)
        with replacing(save_settings) as temporary:
            temporary.write_bytes(text.encode())
        if read := [key for key in chosen if about(marks[key], chosen[key]) is OptionTopic.SOURCE]:
            why = "not saved, as settings do not name inputs; give these again"
            LOG.warning("%s: %s %s", save_settings, ", ".join(read), why)
        return result

    _sign(run, command, signature)
    vars(run)["called"] = name  # of the program with the command; its package may be another
    return run


def _sign(run: Command, command: Command, signature: inspect.Signature) -> None:
    """Give a wrapper the options of its command and the common ones."""
    hints = get_type_hints(command, include_extras=True)
    kinds, models = dict(hints), {name: model_in(kind) for name, kind in hints.items()}
    for name, model in models.items():
        if model is not None and issubclass(model, Choices):
            kinds[name] = Annotated[hints[name], under(model.heading)]
    given = [part.replace(annotation=kinds[name]) for name, part in signature.parameters.items()]
    known = {
        field for model in models.values() if model is not None for field in model.model_fields
    }
    more = []
    for key, (plain, usual, topic, heading, text) in COMMON.items():
        if key in known:  # the command's own `--memory`
            continue
        switch = (Switch,) if plain is bool else ()
        kinds[key] = Annotated[plain, topic, *switch, under(heading), Parameter(help=text)]
        kind = inspect.Parameter.KEYWORD_ONLY
        more.append(inspect.Parameter(key, kind, default=usual, annotation=kinds[key]))
    run.__annotations__ = kinds
    vars(run)["__signature__"] = signature.replace(parameters=[*given, *more])


def _chosen(
    command: Command, signature: inspect.Signature, options: Settings
) -> Iterator[tuple[str, Any]]:
    """Options that differ from the command's defaults, by name, as TOML values."""
    hints = get_type_hints(command, include_extras=True)
    for name, value in options.items():
        default = signature.parameters[name].default
        values, usual, metadata = {name: value}, {name: default}, {name: get_args(hints[name])[1:]}
        if isinstance(value, BaseModel):  # given options, also if equal to the default
            fields = type(value).model_fields
            values = {
                field: getattr(value, field) for field in fields if field in value.model_fields_set
            }
            # Defaults that the command's own default does not replace.
            usual = {name: info.default for name, info in fields.items()}
            usual = {key: own for key, own in usual.items() if getattr(default, key, own) == own}
            metadata = {field: tuple(info.metadata) for field, info in fields.items()}
        for field, chosen in values.items():
            if chosen is not None and chosen != usual.get(field):
                yield name_of(field, metadata[field]), chosen


def _toml(value: object) -> str:
    if isinstance(value, str | Path):
        return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(_toml, value))}]"
    return str(value).lower()


if TYPE_CHECKING:
    from resample.files.formats import WriteOptions
    from resample.resampler import Resampler

OF_SAMPLES = ("method", "footprint", "threshold", "kernel", "opacity", "color_by")

Convention = Literal["corner", "opencv"]
Threads = Annotated[
    int | None,
    OptionTopic.RESOURCE,
    Field(
        ge=1,
        description="Number of threads at most; pixels do not depend on it. [default: all cores]",
    ),
]
Background = Annotated[
    str | None,
    Field(
        description="Background: black, white, #rrggbb or none for transparent. [default: none; "
        "black for .jpg]"
    ),
]
MethodsFilter = Annotated[
    str | None,
    Field(
        description="Pixel filter, such as gaussian:sigma=0.6. [default: the method's own: "
        "the mean over a pixel's area for hybrid]"
    ),
]
Shown = Annotated[
    Literal[
        "composite", "maximum", "minimum", "average", "additive", "xray", "first-hit", "attenuated"
    ],
    Field(
        description="Value of a pixel: composited light; the maximum, minimum, mean or sum of "
        "the values; an X-ray as in computed tomography; the surface at the iso value "
        "(first-hit); or the maximum of values that are dimmed by those in front (attenuated)."
    ),
]
Iso = Annotated[
    float | None,
    Field(
        allow_inf_nan=False,
        description="Value of the surface that first-hit shows. [default: none; first-hit needs "
        "one]",
    ),
]
Attenuation = Annotated[
    float,
    Field(
        ge=0,
        allow_inf_nan=False,
        description="How much a voxel of the brightest value dims voxels behind it, of the "
        "projection attenuated.",
    ),
]


def _choices_in(annotation: Any) -> tuple[Any, ...]:
    """Return the values of a Literal or an optional one; empty for other types."""
    parts = get_args(annotation)
    if all(isinstance(part, str | int) for part in parts):
        return parts
    return next((found for part in parts if (found := _choices_in(part))), ())


def number(given: object) -> object:
    """Convert a word of the command line to a number; pydantic does not convert for literals."""
    return int(given) if isinstance(given, str) and given.isdecimal() else given


def no_share(given: object) -> object:
    """Explain how to set opacity, if a share is given instead of a way to sum samples."""
    if str(given)[:1] in "0123456789.":
        raise ValueError("transfer gray:opacity=0.2 says how opaque voxels are")
    return given


class Choices(BaseModel):
    """Immutable choices of a user; unknown names are rejected."""

    heading: ClassVar[str]  # heading of these options in the help
    about: ClassVar[OptionTopic]  # category of options that state none themselves

    # Validators are built on first use: most commands need few of them.
    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)

    @model_validator(mode="before")
    @classmethod
    def _understood(cls, given: Any) -> Any:
        """Return the options with other libraries' names of choices translated."""
        if not isinstance(given, dict):
            return given
        known = {}
        for name, value in given.items():
            field = cls.model_fields.get(name)
            choices = () if field is None else _choices_in(field.annotation)
            known[name] = value
            if isinstance(value, str) and choices and value not in choices:
                known[name] = choice_meant(value, choices)
        return known

    @classmethod
    def usual(cls) -> Self:
        """Choices with all defaults, without validation, which takes time to build."""
        return cls.model_construct()


class Resampling(Choices):
    """Options of rendering samples."""

    heading: ClassVar[str] = "Method"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    method: Literal["hybrid", "points", "splats", "paper", "inflate", "ewa"] | None = Field(
        default=None,
        description="Method: paper, as published, points up to 1 px and splats above; hybrid, "
        "exact splats on as many sub-pixels as they need; splats, one ray per pixel; points, "
        "only these; inflate or ewa, splats antialiased as by Swan 1997 and Zwicker 2001. "
        "[default: hybrid; none where rays are cast]",
    )
    footprint: Literal["exact", "corrected", "affine", "equation", "projected"] | None = Field(
        default=None,
        description="Model of splats in perspective: exact, or of the paper: corrected, "
        "equation (without its table), projected (around the projected center) and affine "
        "(the projection linearized). [default: exact; corrected for paper]",
    )
    threshold: float | None = Field(
        default=None,
        ge=0,
        description="Paint samples as points up to this spacing in sub-pixels, and others as "
        "the paper's splats. [default: 1 px for paper; none for hybrid and splats]",
    )
    subpixels: int | None = Field(
        default=None,
        ge=1,
        le=32,
        description="Sub-pixels per side of a pixel. [default: as many as each region needs]",
    )
    filter: str | None = Field(
        default=None, description="Pixel filter, such as gaussian:sigma=0.6. [default: box]"
    )
    kernel: str = Field(
        default="gaussian",
        description="Kernel around every sample: gaussian or bspline, or with a "
        "width: bspline:radius=2.",
    )
    order: str | None = Field(
        default=None,
        description="Compositing order: every-sample; axis-sheets and image-sheets:thickness=1 "
        "of hybrid-resample-comparisons. Fields and their projections are cast along "
        "rays:step=1,sharpness=1,quality=best (or usual, or fast). Maxima and minima stay "
        "within the range of the voxels around, except with rays:interpolation=spline.",
    )
    projection: Shown = "composite"
    iso: Iso = None
    attenuation: Attenuation = 0.05
    opacity: Annotated[Literal["exact", "linear"], BeforeValidator(no_share)] = Field(
        default="exact",
        description="Exact transmittance of the field, or the product of classic splatting.",
    )
    color_by: Literal["sample", "primitive"] = Field(
        default="sample",
        description="Source of colors: the samples, or the primitive, with splats in red.",
    )

    @property
    def is_of_samples(self) -> bool:
        """Whether an option concerns painted samples, which rays do not use."""
        own = type(self).model_fields
        return any(getattr(self, name) != own[name].default for name in OF_SAMPLES)

    def resampler(self, *, of_field: bool = False, quality: str = "best") -> "Resampler":
        """Renderer with these choices; fields are cast along rays unless an order was chosen.

        `of_field`: whether values are colored after reconstruction. `quality`: quality of rays, if
        no order was chosen. Raises ValueError, LookupError: a plugin is unknown or rejects its
        parameters.
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
            attenuation=self.attenuation,
            splat_color=SPLAT_COLOR if self.color_by == "primitive" else None,
        )


class PictureFormat(Choices):
    """Format of the picture to write."""

    heading: ClassVar[str] = "Picture"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    size: str = Field(default="400", description=SQUARE)
    background: str | None = Field(
        default=None,
        description="Background: black, white, #rrggbb or none for transparent. [default: none "
        "for .exr, otherwise black]",
    )
    bits: Annotated[Literal[8, 16, 32], BeforeValidator(number)] = Field(
        default=8, description="Bits per channel: PNG 8 or 16, TIFF also 32."
    )
    threads: Threads = None

    def behind(self, suffix: str) -> Color | None:
        """Linear background color for a file with this suffix; None leaves it transparent."""
        own = "none" if suffix.lower() == ".exr" else "black"
        return background_in(suffix, self.background, own)

    def height_and_width(self) -> tuple[int, int]:
        """Size in px.

        Raises ValueError: it is not one or two positive integers, or exceeds the largest picture.
        """
        from resample.messages import check_size

        match = re.fullmatch(r"(\d{1,9})(?:[xX](\d{1,9}))?", self.size.strip(), re.ASCII)
        if match is None:
            raise ValueError(f"size {self.size!r}; give 400 or 640x480")
        width, height = int(match[1]), int(match[2] or match[1])
        check_size(height, width)
        return height, width


class FrameFormat(Choices):
    """Size, background and bits of a rendered frame, as PNG or EXR."""

    heading: ClassVar[str] = "Picture"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    size: str = Field(default=USUAL_SIZE, description=SIZE)
    background: Background = None
    bits: Annotated[Literal[8, 16], BeforeValidator(number)] = Field(
        default=8, description="Bits per channel: 8 or 16 (PNG)."
    )

    def height_and_width(self) -> tuple[int, int]:
        """Size in px.

        Raises ValueError: the size or the background is invalid.
        """
        self.behind()
        return height_and_width(self.size)

    def behind(self, suffix: str = "") -> Color | None:
        """Linear color behind the picture, in a file with this suffix; None: transparent."""
        return background_in(suffix, self.background)


class Sharing(Choices):
    """Workers of a command: local processes or a dask cluster."""

    heading: ClassVar[str] = "Workers"
    about: ClassVar[OptionTopic] = OptionTopic.RESOURCE

    workers: int | None = Field(
        default=None,
        ge=1,
        le=1024,
        description="Local processes that share the work and the memory; needs the extra dist. "
        "Pixels do not depend on it. [default: none; this process works alone]",
    )
    scheduler: Annotated[str | None, OptionTopic.TARGET] = Field(
        default=None,
        description="Address of a dask scheduler with workers for the work, such as "
        "tcp://10.0.0.1:8786; they must see the same files under the same names.",
    )

    @property
    def has_workers(self) -> bool:
        """Whether the work goes to other processes."""
        return self.workers is not None or self.scheduler is not None

    @property
    def description(self) -> str:
        """Describe the workers to the user."""
        if self.workers is None:
            return f"the workers of {self.scheduler}"
        return f"{self.workers} {'process' if self.workers == 1 else 'processes'}"


class Serving(Choices):
    """Address of a viewer's page."""

    heading: ClassVar[str] = "Page"
    about: ClassVar[OptionTopic] = OptionTopic.TARGET

    host: str = Field(
        default="127.0.0.1",
        description="Address to listen at; warns if other machines can reach it.",
    )
    port: int = Field(default=0, ge=0, le=65535, description="Port to listen at; 0: any free port.")
    browser: bool = Field(default=True, description="Open the page in the browser.")


class Written(Choices):
    """Format of a written picture of any kind."""

    heading: ClassVar[str] = "Picture"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    background: Background = None
    bits: Annotated[Literal[8, 16, 32] | None, BeforeValidator(number)] = Field(
        default=None,
        description="Bits per channel: PNG 8 or 16, TIFF also 32. [default: as in the source]",
    )

    profile: Literal["keep", "srgb"] = Field(
        default="keep",
        description="Colors: keep the source's ICC profile, or convert them to sRGB.",
    )

    file_quality: str | None = Field(
        default=None,
        description="Of .jpg, .webp and .avif: 1 to 100, or lossless for .webp. [default: 95 "
        "for .jpg, 90 for .webp, 85 for .avif]",
    )

    def options(self, suffix: str = "") -> "WriteOptions":
        """Options of the writer of pictures with a suffix.

        Raises ValueError: the file cannot have the background, or the quality is unknown.
        """
        from resample.files.formats import NO_LOSS, WriteOptions

        behind = None if self.background is None else background_in(suffix, self.background)
        quality: int | str | None = self.file_quality
        if isinstance(quality, str) and quality != NO_LOSS:
            if not re.fullmatch(r"\d{1,3}", quality, re.ASCII) or not 1 <= int(quality) <= 100:
                raise ValueError(f"--file-quality {quality!r}; give 1 to 100, or {NO_LOSS}")
            quality = int(quality)
        return WriteOptions(self.bits, behind, quality=quality, in_srgb=self.profile == "srgb")


def option_of(model: type[Choices], field: str) -> str:
    """Name of the option for a field of a model."""
    return name_of(field, model.model_fields[field].metadata)


def chosen(settings: Mapping[str, Any], models: Sequence[type[Choices]]) -> list[Any]:
    """Create models of options from settings by the options' names.

    Values are as on the command line, or Python's: several numbers as a sequence, a path, one
    value of a repeatable option without a list.

    Raises TypeError: the option is unknown; it names similar ones. Raises ValueError: a value
    is not allowed.
    """
    parts: list[dict[str, Any]] = [{} for _ in models]
    fields = {
        option_of(model, field): (n, field)
        for n, model in reversed(list(enumerate(models)))
        for field in model.model_fields
    }
    fields |= {field: (n, field) for n, field in fields.values()}
    for key, value in settings.items():
        if key not in fields:
            raise ValueError(f"there is no option {key!r:.60}{answer(key, list(fields), REMEDIES)}")
        home, field = fields[key]
        is_several = get_origin(models[home].model_fields[field].annotation) is tuple
        parts[home][field] = as_on_a_command_line(value, is_several)
    try:
        return [model(**part) for model, part in zip(models, parts, strict=True)]
    except ValidationError as error:
        raise ValueError(one_line(error)) from None


def as_on_a_command_line(value: Any, is_several: bool = False) -> Any:
    """Return a value as a command would get it; `is_several`: it may be given repeatedly."""
    if isinstance(value, PurePath):
        value = str(value)
    if is_several and isinstance(value, str):
        return (value,)
    if is_several or not (isinstance(value, list | tuple) or hasattr(value, "tolist")):
        return value
    found = value.tolist() if hasattr(value, "tolist") else value
    if not isinstance(found, list | tuple):
        return found
    return ",".join(one if isinstance(one, str) else f"{one!r}" for one in found)


def height_and_width(size: str) -> tuple[int, int]:
    """Parse a size in px, 400 or 640x480."""
    return PictureFormat(size=size).height_and_width()
