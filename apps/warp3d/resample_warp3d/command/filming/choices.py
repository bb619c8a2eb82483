"""Options of films of depth images."""

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from resample.command.flags import OptionTopic, Resume, Switch
from resample.command.settings import Choices

if TYPE_CHECKING:
    from resample.files.films import FilmCoding, StereoMarks

CLOCK = re.compile(r"(?:(?:(\d+):)?(\d+):)?(\d+\.?\d*|\.\d+)", re.ASCII)
BITS = re.compile(r"(\d+(?:\.\d+)?)([kM]?)", re.ASCII)
MEAN, SPREAD = "0.485,0.456,0.406", "0.229,0.224,0.225"  # of ImageNet, as most networks take them
SHORTER = 518  # px of a picture's shorter side, of Depth Anything
UNITS = {"": 1, "k": 1000, "M": 1_000_000}


class FilmInput(Choices):
    """How films of depth images are read."""

    heading: ClassVar[str] = "Input"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    temporal: Annotated[
        Literal["auto", "none"],
        Field(
            description="Relative depth of films: auto aligns the scale and shift of each map "
            "with those before it, from cut to cut, unless they agree already; none takes one "
            "range for all."
        ),
    ] = "auto"
    fps: Annotated[
        float | None,
        Field(description="Frames per second. [default: those of the film, or 24]"),
    ] = None


class FilmFormat(Choices):
    """Which part of a film is taken, and how the new one is encoded."""

    heading: ClassVar[str] = "Films"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    start: Annotated[
        str | None,
        Field(description="Time of the first picture, seconds or H:MM:SS. [default: the first]"),
    ] = None
    end: Annotated[
        str | None,
        Field(description="Time of the end, as for --start. [default: the film's]"),
    ] = None
    codec: Annotated[
        Literal["h264", "hevc", "av1"], Field(description="Codec of .mp4, .mov and .mkv.")
    ] = "h264"
    crf: Annotated[
        int,
        Field(ge=0, le=63, description="Constant quality: less is better and larger."),
    ] = 18
    bitrate: Annotated[
        str | None, Field(description="Bits per second, such as 20M, in place of --crf.")
    ] = None
    pixel_format: Annotated[
        Literal[
            "yuv420p", "yuv422p", "yuv444p", "yuv420p10le", "yuv422p10le", "yuv444p10le"
        ],
        Field(description="Colors per 2 x 2 pixels (420: one, 444: four), and 10 bits (10le)."),
    ] = "yuv420p"  # fmt: skip
    name_layout: Annotated[
        bool,
        Switch,
        Field(description="Append the layout to the file's name as players read it: a film side by "
        "side becomes film_LRF_Full_SBS.mp4."),
    ] = False  # fmt: skip
    resume: Resume = False

    def times(self) -> tuple[float, float]:
        """Return start and end, s."""
        found = []
        for name, usual in (("start", 0.0), ("end", math.inf)):
            text = getattr(self, name)
            clock = None if text is None else CLOCK.fullmatch(text)
            if text is not None and clock is None:
                raise ValueError(f"--{name} {text!r}; give seconds, or a time such as 1:02:03.5")
            hours, minutes, seconds = (float(part or 0) for part in clock.groups()) if clock else (
                0.0, 0.0, usual
            )  # fmt: skip
            found.append(3600 * hours + 60 * minutes + seconds)
        if found[0] >= found[1]:
            raise ValueError(f"--end {self.end} is not after --start {self.start or 0}")
        return found[0], found[1]

    def coding(self, marks: "StereoMarks") -> "FilmCoding":
        """Return how pictures are encoded."""
        from resample.files.films import FilmCoding

        if self.codec == "av1" and not self.pixel_format.startswith("yuv420p"):
            raise ValueError(f"av1 has no {self.pixel_format}; take yuv420p or yuv420p10le")
        number = None if self.bitrate is None else BITS.fullmatch(self.bitrate)
        if self.bitrate is not None and (number is None or float(number[1]) <= 0.0):
            raise ValueError(f"--bitrate {self.bitrate!r}; give bits per second, such as 20M")
        rate = None if number is None else round(float(number[1]) * UNITS[number[2]])
        tags = {} if marks.matroska is None else {"stereo_mode": marks.matroska}
        return FilmCoding(self.codec, self.crf, rate, self.pixel_format, tags, marks.packing)


class Estimating(Choices):
    """Estimation of depth by a network."""

    heading: ClassVar[str] = "Input"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    depth_model: Annotated[
        Path | None,
        OptionTopic.SOURCE,
        Field(
            description="Network in ONNX that estimates depth from single pictures, such as Depth "
            "Anything; in place of a depth file. Needs the extra depth (onnxruntime)."
        ),
    ] = None
    model_size: Annotated[
        int | None,
        Field(
            ge=14,
            le=4096,
            description="Shorter side of the network's pictures, px. [default: the file's, or "
            f"{SHORTER}]",
        ),
    ] = None
    model_mean: Annotated[
        str | None,
        Field(
            description="Levels 0..1 of red, green and blue that the network takes for 0. "
            f"[default: the file's, or {MEAN}]"
        ),
    ] = None
    model_std: Annotated[
        str | None,
        Field(
            description=f"Levels by which they are then divided. [default: the file's, or {SPREAD}]"
        ),
    ] = None
    model_batch: Annotated[
        int, OptionTopic.RESOURCE, Field(ge=1, le=64, description="Pictures at a time, of films.")
    ] = 4


class Batch(Choices):
    """Several photos, one by one."""

    heading: ClassVar[str] = "Several sources"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    batch: Annotated[
        bool,
        Switch,
        Field(
            description="A folder or pattern holds photos of any sizes and films, which are made "
            "one by one, and no film. [default: if sizes differ]"
        ),
    ] = False
    recursive: Annotated[
        bool, OptionTopic.SOURCE, Switch, Field(description="With --batch, folders in it, too.")
    ] = False
    skip_errors: Annotated[
        bool, Switch, Field(description="With --batch, go on after a photo that fails.")
    ] = False
