"""Options of pictures for two eyes."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from cyclopts import Parameter
from pydantic import Field, model_validator

from resample.command.flags import SIZE, Hyphen, OptionTopic, Shape, Switch
from resample.command.settings import Choices, height_and_width
from resample.console import say
from resample_warp3d.command.choices import Depth, DepthWarping
from resample_warp3d.command.source import SourceCamera

if TYPE_CHECKING:
    from resample_warp3d.depth.encodings import Raw

HALF = ("vr180", "vr180-fisheye")  # layouts of the half sphere ahead
NUMBER = re.compile(r"-?\d*\.?\d+(?:[eE][-+]?\d+)?", re.ASCII)
MILLIMETERS = 20_000  # whole numbers of 16 bits below this are z; a network's fill the range


class PairDepth(Depth):
    """Meaning of the depth's or disparity's numbers for a stereo pair."""

    depth_kind: Annotated[
        Literal["auto", "pair", "z", "ray", "inverse", "disparity", "relative", "relative-z"],
        Field(
            description="z along the camera's axis, ray length, inverse (1 / z), or disparity of a "
            "calibrated pair, where 0, NaN and inf are unknown; or a network's output: relative, "
            "larger is nearer, or relative-z, larger is farther; or pair, the disparity of a "
            "rectified pair in px. auto: pair for floats and with --disparity-scale, z with "
            "--depth-scale, otherwise by the range of whole numbers."
        ),
    ] = "auto"  # type: ignore[assignment]  # two more kinds


class StereoWarping(DepthWarping):
    """How the other eye's picture is made."""

    fill: Annotated[
        bool,
        Field(description="Fill holes that no view shows from the background beside them."),
    ] = True


class Parallax(Choices):
    """Geometry and layout of a stereo pair."""

    heading: ClassVar[str] = "Stereo"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    eyes: Annotated[
        Literal["left", "right", "both"] | None,
        Field(
            description="Distance between the eyes, scene units; or whose picture is made from the "
            "source, which is the other eye's: left, right, or both, with the source between them "
            "and half of the parallax each. [default: right; both for films with depth]"
        ),
    ] = None
    eye_distance: Annotated[
        float | None,
        Field(
            gt=0,
            description="Distance between the eyes, where --eyes says whose pictures are made, "
            "scene units. [default: such that parallax is "
            "at most 1.5 % of the width; for vr180 and panoramas 2 degrees]",
        ),
    ] = None
    zero_plane: Annotated[
        float | None,
        Field(
            gt=0,
            description="Distance of zero parallax, scene units. [default: the median of the "
            "depth; "
            "infinite for vr180 and panoramas]",
        ),
    ] = None
    divergence: Annotated[
        float | None,
        Field(
            gt=0,
            le=50,
            description="Parallax from the farthest to the nearest things, % of the width. "
            "[default: by --eye-distance]",
        ),
    ] = None
    convergence: Annotated[
        float | None,
        Field(
            ge=0,
            le=100,
            description="What lies on the screen: 0, the farthest, to 100, the nearest things. "
            "[default: by --zero-plane]",
        ),
    ] = None
    foreground_scale: Annotated[
        float,
        Hyphen,
        Field(
            ge=-3,
            le=3,
            description="Depth of the foreground beside that of the background: 1 doubles the "
            "relief of the nearest things and flattens far ones, -1 the opposite.",
        ),
    ] = 0.0
    preserve_borders: Annotated[
        bool,
        Switch,
        Field(description="Let parallax fade to none at the left and right border, so that there "
        "is nothing to be filled."),
    ] = False  # fmt: skip
    crop_borders: Annotated[
        bool,
        Switch,
        Field(description="Cut off the left and right borders that not both eyes see."),
    ] = False
    layout: Annotated[
        Literal[
            "one", "side-by-side", "half-side-by-side", "top-bottom", "half-top-bottom", "anaglyph",
            "vr180", "cross-eyed", "half-cross-eyed", "rows", "anaglyph-half-color",
            "anaglyph-gray", "anaglyph-dubois", "rgbd", "half-rgbd", "quilt", "vr180-fisheye",
        ] | None,
        Field(
            description="Output: the new eye's picture alone (one), or both: the left one at the "
            "left (at the right for cross-eyed), on top, in even rows, or in red; half: each "
            "squeezed by 2, together as large as one; anaglyph-dubois: least-squares colors for "
            "red and cyan glasses; vr180: the half sphere ahead of each eye, side by side, by "
            "latitude and longitude, or vr180-fisheye: as equidistant circles; rgbd: the source "
            "and its depth, nearer is lighter; quilt: views from left to right, from the bottom "
            "row up, for light-field displays. [default: one; side-by-side for films "
            "with both eyes, cross-eyed for .jps]"
        ),
    ] = None  # fmt: skip
    quilt: Annotated[
        str,
        Field(pattern=r"^\d{1,2}x\d{1,2}$", description="Columns x rows of a quilt."),
    ] = "8x6"
    size: Annotated[
        str | None,
        Field(
            description=f"{SIZE} Of each eye's picture, for vr180 (a square), panoramas and "
            "quilts. [default: as fine as the source]"
        ),
    ] = None

    source_eye: Annotated[
        Literal["left", "right"] | None,
        Parameter(name="--from", show=False),
        Field(description="Whose picture the source is, as in 0.2: --eyes names the other one."),
    ] = None

    @model_validator(mode="before")
    @classmethod
    def _of_eyes(cls, given: Any) -> Any:
        """Take a number for `eyes` for their distance, and the source's eye for the other one."""
        if isinstance(given, dict) and NUMBER.fullmatch(str(given.get("eyes"))):
            given = {**given, "eye_distance": given["eyes"], "eyes": None}
        if isinstance(given, dict) and given.get("source_eye"):
            if given.get("eyes"):
                raise ValueError("--from and --eyes both say which eye is made; give --eyes")
            given = {**given, "eyes": "left" if given["source_eye"] == "right" else "right"}
        return given

    def is_around(self, eye: SourceCamera) -> bool:
        """Whether eyes have pictures of directions: for vr180 and panoramas."""
        return self.layout in HALF or eye.source_projection == "equirectangular"

    def recognised(
        self, meaning: PairDepth, raw: "Raw", name: str, *, is_around: bool, of_pair: bool
    ) -> PairDepth:
        """Choose a kind of depth in place of auto, by some of the depth; say what is assumed."""
        if meaning.depth_kind != "auto":
            return meaning
        if of_pair or meaning.depth_scale is not None:
            return meaning.model_copy(update={"depth_kind": "pair" if of_pair else "z"})
        chosen: dict[str, object] = {"depth_kind": "relative"}
        numbers = "levels are relative, larger is nearer"
        of_depth = ("eye_distance", "zero_plane", "divergence", "convergence")
        if meaning.baseline is not None:
            raise ValueError(
                "--baseline is that of --depth-kind disparity; --eye-distance is between the eyes"
            )
        if raw.dtype.kind == "f" and (is_around or self.model_fields_set & {*of_depth}):
            chosen, numbers = {"depth_kind": "z"}, "numbers are distances"
        elif raw.dtype.kind == "f":
            chosen, numbers = {"depth_kind": "pair"}, "numbers are the disparity of a pair in px"
        elif raw.dtype.itemsize > 1 and raw.max(initial=0) < MILLIMETERS:
            chosen = {"depth_kind": "z", "depth_scale": 1000.0}
            numbers = "numbers are distances in mm"
        options = " ".join(f"--{key.replace('_', '-')} {one}" for key, one in chosen.items())
        say(f"{Path(name).name}: assumed that its {numbers} ({options})")
        return meaning.model_copy(update=chosen)

    def shape(self) -> Shape | None:
        """Return height and width of each eye's picture, px, if given."""
        if self.size is None:
            return None
        height, width = height_and_width(self.size)
        if self.layout in HALF and width != height:
            raise ValueError(f"--size {self.size}: each eye of vr180 has a square, such as 2048")
        if self.layout not in (*HALF, "quilt") and width != 2 * height:
            raise ValueError(f"--size {self.size}: a panorama is twice as wide as high")
        return height, width

    def check(self, meaning: PairDepth, eye: SourceCamera) -> None:
        """Refuse options that do not go together."""
        if meaning.confidence is not None:
            raise ValueError("--confidence belongs to render, animate and view; leave it out")
        for words, meters in (("divergence", "eye_distance"), ("convergence", "zero_plane")):
            if getattr(self, words) is not None and getattr(self, meters) is not None:
                option = meters.replace("_", "-")
                raise ValueError(f"--{words} and --{option} both say the parallax; give one")
        if self.layout == "one" and self.eyes == "both":
            raise ValueError("--layout one holds one eye's picture; give --eyes left or right")
        if self.preserve_borders and self.crop_borders:
            raise ValueError("--preserve-borders leaves nothing to crop; leave out --crop-borders")
        if self.is_around(eye):
            flat = ("foreground_scale", "preserve_borders", "crop_borders")
            given = [name for name in flat if getattr(self, name)]
            if given or self.layout in ("rgbd", "half-rgbd", "quilt"):
                what = f"--{given[0].replace('_', '-')}" if given else f"--layout {self.layout}"
                raise ValueError(f"{what} is for flat pictures, not for vr180 and panoramas")
            if eye.source_projection == "orthographic":
                raise ValueError("vr180 needs a pinhole, a lens or a panorama")
            if meaning.depth_kind == "pair":
                raise ValueError("vr180 and panoramas need depth, by --depth-kind")
            if (self.zero_plane, self.divergence, self.convergence) != (None, None, None):
                raise ValueError(
                    "--zero-plane, --divergence and --convergence belong to flat pictures; the "
                    "eyes of vr180 and panoramas are parallel"
                )
            self.shape()
            return
        eye.check_pinhole("stereo")
        if self.size is not None and self.layout != "quilt":
            raise ValueError(
                "--size belongs to --layout vr180 or quilt and to panoramas; leave it out"
            )
        if meaning.depth_kind != "pair":
            return
        for name in ("eye_distance", "zero_plane", "divergence", "convergence", "foreground_scale"):
            if getattr(self, name) not in (None, 0.0):
                option = name.replace("_", "-")
                raise ValueError(f"--{option} needs depth, by --depth-kind; a pair has --fraction")

    def for_film(self, *, is_pair: bool) -> "Parallax":
        """Return the options for a film: both eyes, side by side, unless they are given."""
        both = self.eyes is None and self.layout != "one" and not is_pair
        eyes = "both" if both else self.eyes
        usual = "side-by-side" if eyes == "both" else None
        return self.model_copy(update={"eyes": eyes, "layout": self.layout or usual})
