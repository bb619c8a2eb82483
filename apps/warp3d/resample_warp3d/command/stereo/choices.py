"""Options of stereo pairs."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from resample.command.flags import SIZE, OptionTopic
from resample.command.intrinsics import Shape
from resample.command.settings import Choices, height_and_width
from resample_warp3d.command.choices import Depth
from resample_warp3d.command.source import SourceCamera

LARGEST = 4096  # px of an eye's picture around, unless its size is given


class PairDepth(Depth):
    """Meaning of the depth's or disparity's numbers for a stereo pair."""

    depth_kind: Annotated[
        Literal["pair", "z", "ray", "inverse", "disparity", "relative", "relative-z"],
        Field(
            description="z along the camera's axis, ray length, inverse (1 / z), or disparity of a "
            "calibrated pair, where 0, NaN and inf are unknown; or a network's output: relative, "
            "larger is nearer, or relative-z, larger is farther; or pair, the disparity of a "
            "rectified pair in px."
        ),
    ] = "pair"  # type: ignore[assignment]  # one more kind


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
    layout: Annotated[
        Literal[
            "one", "side-by-side", "half-side-by-side", "top-bottom", "half-top-bottom", "anaglyph",
            "vr180",
        ],
        Field(
            description="Output: the other eye's picture alone, or both: the left one at the "
            "left, on top, or in red; half: each squeezed by 2, together as large as one; vr180: "
            "the half sphere ahead of each eye, side by side."
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

    def shape(self) -> Shape | None:
        """Return height and width of each eye's picture, px, if given.

        Raises
        ------
        ValueError
            They are not those of a half sphere, for vr180, or of a panorama.
        """
        if self.size is None:
            return None
        height, width = height_and_width(self.size)
        if self.layout == "vr180" and width != height:
            raise ValueError(f"--size {self.size}: each eye of vr180 has a square, such as 2048")
        if self.layout != "vr180" and width != 2 * height:
            raise ValueError(f"--size {self.size}: a panorama is twice as wide as high")
        return height, width

    def check(self, meaning: PairDepth, eye: SourceCamera) -> None:
        """Refuse options that do not go together.

        Raises
        ------
        ValueError
            An option does not go with a rectified pair, with a flat picture, with vr180 or with
            a panorama.
        """
        if self.is_around(eye):
            self._check_around(meaning, eye)
            return
        eye.check_pinhole("stereo")
        if self.size is not None:
            raise ValueError("--size belongs to --layout vr180 and panoramas; leave it out")
        if meaning.depth_kind != "pair":
            return
        for name in ("eyes", "zero_plane"):
            if getattr(self, name) is not None:
                option = name.replace("_", "-")
                raise ValueError(f"--{option} needs depth, by --depth-kind; a pair has --fraction")

    def _check_around(self, meaning: PairDepth, eye: SourceCamera) -> None:
        if eye.source_projection == "orthographic":
            raise ValueError("vr180 needs a pinhole, a lens or a panorama")
        if meaning.depth_kind == "pair":
            raise ValueError("vr180 and panoramas need depth, by --depth-kind")
        if self.zero_plane is not None:
            raise ValueError(
                "--zero-plane belongs to flat pictures; the eyes of vr180 and panoramas are "
                "parallel"
            )
        self.shape()
