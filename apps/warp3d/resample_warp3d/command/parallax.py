"""Options of pictures for two eyes."""

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from resample.command.flags import SIZE, OptionTopic
from resample.command.intrinsics import Shape
from resample.command.settings import Choices, height_and_width
from resample.console import say
from resample_warp3d.command.choices import Depth, DepthWarping
from resample_warp3d.command.source import SourceCamera

if TYPE_CHECKING:
    from resample_warp3d.depth.encodings import Raw

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
        float | None,
        Field(
            gt=0,
            description="Distance between the eyes, scene units. [default: such that parallax is "
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
            "[default: by --eyes]",
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
    layout: Annotated[
        Literal[
            "one", "side-by-side", "half-side-by-side", "top-bottom", "half-top-bottom", "anaglyph",
            "vr180", "cross-eyed", "half-cross-eyed", "rows", "anaglyph-half-color",
            "anaglyph-gray", "anaglyph-dubois",
        ],
        Field(
            description="Output: the other eye's picture alone, or both: the left one at the "
            "left (at the right for cross-eyed), on top, in even rows, or in red; half: each "
            "squeezed by 2, together as large as one; anaglyph-dubois: least-squares colors for "
            "red and cyan glasses; vr180: the half sphere ahead of each eye, side by side."
        ),
    ] = "one"  # fmt: skip
    size: Annotated[
        str | None,
        Field(
            description=f"{SIZE} Of each eye's picture, for vr180 (a square) and panoramas. "
            "[default: as fine as the source]"
        ),
    ] = None

    def is_around(self, eye: SourceCamera) -> bool:
        """Whether eyes have pictures of directions: for vr180 and panoramas."""
        return self.layout == "vr180" or eye.source_projection == "equirectangular"

    def recognised(
        self, meaning: PairDepth, raw: "Raw", name: str, *, is_around: bool, of_pair: bool
    ) -> PairDepth:
        """Choose a kind of depth in place of auto, by some of the depth; say what is assumed.

        Parameters
        ----------
        raw
            Numbers (H, W) of the depth, or of the first one of a film.
        name
            Its file.
        is_around
            Whether eyes have pictures of directions.
        of_pair
            Whether the scale of a pair's disparity is given.
        """
        if meaning.depth_kind != "auto":
            return meaning
        if of_pair or meaning.depth_scale is not None:
            return meaning.model_copy(update={"depth_kind": "pair" if of_pair else "z"})
        chosen: dict[str, object] = {"depth_kind": "relative"}
        numbers = "levels are relative, larger is nearer"
        if raw.dtype.kind == "f" and (is_around or self.eyes or self.zero_plane):
            chosen, numbers = {"depth_kind": "z"}, "numbers are distances"
        elif raw.dtype.kind == "f":
            chosen, numbers = {"depth_kind": "pair"}, "numbers are the disparity of a pair in px"
        elif raw.dtype.itemsize > 1 and raw.max(initial=0) < MILLIMETERS:
            chosen = {"depth_kind": "z", "depth_scale": 1000.0}
            numbers = "numbers are distances in mm"
        options = " ".join(f"--{key.replace('_', '-')} {one}" for key, one in chosen.items())
        say(f"{name}: assumed that its {numbers} ({options})")
        return meaning.model_copy(update=chosen)

    def shape(self) -> Shape | None:
        """Return height and width of each eye's picture, px, if given."""
        if self.size is None:
            return None
        height, width = height_and_width(self.size)
        if self.layout == "vr180" and width != height:
            raise ValueError(f"--size {self.size}: each eye of vr180 has a square, such as 2048")
        if self.layout != "vr180" and width != 2 * height:
            raise ValueError(f"--size {self.size}: a panorama is twice as wide as high")
        return height, width

    def check(self, meaning: PairDepth, eye: SourceCamera) -> None:
        """Refuse options that do not go together."""
        for words, meters in (("divergence", "eyes"), ("convergence", "zero_plane")):
            if getattr(self, words) is not None and getattr(self, meters) is not None:
                option = meters.replace("_", "-")
                raise ValueError(f"--{words} and --{option} both say the parallax; give one")
        if self.is_around(eye):
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
        if self.size is not None:
            raise ValueError("--size belongs to --layout vr180 and panoramas; leave it out")
        if meaning.depth_kind != "pair":
            return
        for name in ("eyes", "zero_plane", "divergence", "convergence"):
            if getattr(self, name) is not None:
                option = name.replace("_", "-")
                raise ValueError(f"--{option} needs depth, by --depth-kind; a pair has --fraction")
