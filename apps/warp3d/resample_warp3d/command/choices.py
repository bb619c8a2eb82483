"""What the command line lets a user choose about a warp; no numerics in here."""

from dataclasses import is_dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from resample.command.about import NUMBERS, About, words
from resample.command.flags import Hyphen, Stats, Switch
from resample.command.settings import (
    Choices,
    MethodsFilter,
    Threads,
)
from resample_warp3d.command.cameras.intrinsics import Shape, check_intrinsics, with_intrinsics
from resample_warp3d.command.cameras.source import SourceCamera

if TYPE_CHECKING:
    from resample.cameras.models import Camera
    from resample_warp3d.depth.encodings import Encoding
    from resample_warp3d.types import Method
    from resample_warp3d.views.together import Joining

RELATIVE = ("relative", "relative-z")
Refine = Literal["auto", "none", "snap", "sharpen", "complete"]
UNMIXED = ("mcmillan", "mcmillan-zbuffer", "opencv")  # give each pixel the color of one sample


class Depth(Choices):
    """What the numbers of the depth file mean."""

    heading: ClassVar[str] = "Input"
    about: ClassVar[About] = About.LOOK

    depth_kind: Annotated[
        Literal["z", "ray", "inverse", "disparity", "relative", "relative-z"],
        Field(
            description="Z along the camera's axis, length of the ray, 1 / z, or disparity of a "
            "calibrated pair, where 0, NaN and inf are unknown; or what networks tell: relative, "
            "larger is nearer, or relative-z, larger is farther."
        ),
    ] = "z"
    depth_scale: Annotated[
        float | None,
        Field(description="Numbers per unit: 1000 for mm, 5000 for TUM. Floats need none."),
    ] = None
    near: Annotated[
        float | None, Field(description="Inverse depth: z at the largest number. Relative: 1.")
    ] = None
    far: Annotated[
        float | None, Field(description="Inverse depth: z at 0; may be inf. Relative: 10.")
    ] = None
    baseline: Annotated[
        float | None, Field(description="Disparity: distance of the two eyes, scene units.")
    ] = None
    focal: Annotated[
        float | None, Field(description="Disparity: focal length in px. That of the intrinsics.")
    ] = None
    depth_intrinsics: Annotated[
        str | None,
        NUMBERS,
        Hyphen,
        Field(
            description="fx,fy,cx,cy[,skew] of a depth camera of its own, px of the depth, or a "
            "file as of --intrinsics; what it saw is brought to the picture's camera."
        ),
    ] = None
    depth_pose: Annotated[
        str | None,
        About.SOURCE,
        Field(description="And its pose: file or file:frame, as of --pose. The picture's."),
    ] = None
    doffs: Annotated[
        float,
        Hyphen,
        Field(description="Disparity: principal point of the right view minus the left's, px."),
    ] = 0.0

    def check(self) -> None:
        """Refuse what can be seen to be wrong without the files."""
        if self.depth_kind == "disparity" and self.baseline is None:
            raise ValueError("disparity needs --baseline; without one, see the command stereo")
        of_kinds = {
            ("inverse", *RELATIVE): ("near", "far"),
            ("disparity",): ("baseline", "focal", "doffs"),
        }
        for kinds, names in of_kinds.items():
            given = [name for name in names if getattr(self, name) not in (None, 0.0)]
            if given and self.depth_kind not in kinds:
                raise ValueError(f"--{given[0]} belongs to --depth-kind {' or '.join(kinds)}")
        if self.is_relative and self.depth_scale is not None:
            raise ValueError("relative depth has no scale; --near and --far say its range")
        if self.is_relative:
            self._relative()
        if self.depth_pose is not None and self.depth_intrinsics is None:
            raise ValueError("--depth-pose belongs to --depth-intrinsics; give both")
        if self.depth_intrinsics is not None:
            check_intrinsics("depth-intrinsics", self.depth_intrinsics)

    @property
    def scale_of_z(self) -> float | None:
        """Numbers per unit, if they are z."""
        return self.depth_scale if self.depth_kind == "z" else None

    def range(self) -> tuple[float, float]:
        """Z that relative depth is taken to lie between."""
        from resample_warp3d.depth import encodings

        near = encodings.NEAR if self.near is None else self.near
        return near, encodings.FAR * near if self.far is None else self.far

    def _relative(self) -> "Encoding":
        from resample_warp3d.depth.encodings import RelativeDepth

        return RelativeDepth(*self.range(), self.depth_kind == "relative-z")

    @property
    def is_relative(self) -> bool:
        """Whether the numbers have an unknown scale."""
        return self.depth_kind in RELATIVE

    def camera(self, camera: "Camera", shape: Shape, stored: Shape) -> "Camera":
        """Camera that took the depth: its own, or the picture's at the depth's size.

        Parameters
        ----------
        camera, shape
            Of the picture.
        stored
            Height and width of the depth.

        Raises
        ------
        ValueError, LookupError, OSError
            The numbers are no camera's, or a file cannot be read.
        """
        from resample.cameras.files import read_pose

        if self.depth_intrinsics is None:
            return camera if shape == stored else camera.resized(shape, stored)
        pose = camera.world_to_camera if self.depth_pose is None else read_pose(self.depth_pose)
        own = with_intrinsics("depth-intrinsics", self.depth_intrinsics, "corner")
        return own.sized(*stored).moved(pose)

    def encoding(self, camera: "Camera") -> "Encoding":
        """Meaning of the numbers, for a picture of the camera.

        Raises
        ------
        ValueError
            A number is out of range.
        """
        from resample_warp3d.depth import encodings

        if self.depth_kind == "ray":
            return encodings.RayLength(camera, self.depth_scale)
        if self.depth_kind == "inverse":
            return encodings.InverseDepth(self.depth_scale, self.near, self.far)
        if self.depth_kind == "disparity":
            focal = abs(float(camera.matrix[0, 0])) if self.focal is None else self.focal
            return encodings.Disparity(focal, self.baseline or 0.0, self.depth_scale, self.doffs)
        if self.is_relative:
            return self._relative()
        return encodings.PlanarDepth(self.depth_scale)


class PairDepth(Depth):
    """What the numbers are that tell how far things are from two eyes."""

    depth_kind: Annotated[
        Literal["pair", "z", "ray", "inverse", "disparity", "relative", "relative-z"],
        Field(description="As of render; or pair, px between the pictures of a rectified pair."),
    ] = "pair"  # type: ignore[assignment]  # and one more


class Parallax(Choices):
    """How two eyes see a picture of any depth."""

    heading: ClassVar[str] = "Stereo"
    about: ClassVar[About] = About.LOOK

    eyes: Annotated[
        float | None,
        Field(
            gt=0,
            description="Distance of the eyes, scene units. So that parallax is at most 1.5 % of "
            "the width.",
        ),
    ] = None
    zero_plane: Annotated[
        float | None,
        Field(gt=0, description="Distance of what stays in the screen, scene units. The middle."),
    ] = None
    layout: Annotated[
        Literal["one", "side-by-side", "top-bottom", "anaglyph"],
        Field(
            description="What is written: the other eye's picture alone, or both: the left one at "
            "the left, on top, or in red."
        ),
    ] = "one"

    def check(self, meaning: PairDepth, eye: SourceCamera) -> None:
        """Refuse what says nothing about a rectified pair, and pictures that have none.

        Raises
        ------
        ValueError
            There is such a choice.
        """
        eye.check_pinhole("stereo")
        if meaning.depth_kind != "pair":
            return
        for name in ("eyes", "zero_plane"):
            if getattr(self, name) is not None:
                option = name.replace("_", "-")
                raise ValueError(f"--{option} needs depth, by --depth-kind; a pair has --fraction")


class Warping(Choices):
    """How pictures are warped."""

    heading: ClassVar[str] = "Method"
    about: ClassVar[About] = About.LOOK

    method: Annotated[
        str,
        Field(description="Method: hybrid, paper, mesh, mcmillan ...; see resample plugins."),
    ] = "hybrid"
    filter: MethodsFilter = None
    noise: Annotated[
        float | None,
        Field(ge=0, description="Of the depth, relative (0.002 for 0.2 %). It is measured."),
    ] = None
    refine: Annotated[
        Refine,
        Field(
            description="What is done about depth that does not fit the picture: snap moves edges "
            "to those of color, sharpen makes soft ones hard, both fill gaps, complete does that "
            "alone; auto finds out."
        ),
    ] = "auto"
    fill: Annotated[
        bool,
        Switch,
        Field(description="Make up what no view shows, from the background beside it."),
    ] = False
    fill_by: Annotated[
        Literal["picture", "layer"],
        Field(
            description="What --fill makes it up from: each picture, or a layer behind silhouettes "
            "that the source gets once, so that films do not flicker."
        ),
    ] = "picture"
    unmixed: Annotated[
        bool,
        Switch,
        Field(description="Colors are names or numbers, which are not mixed."),
    ] = False
    threads: Threads = None

    @property
    def has_layer(self) -> bool:
        """Whether sources get a layer behind their silhouettes."""
        return self.fill_by == "layer"

    def built(self) -> "Method":
        """The method.

        Raises
        ------
        ValueError, LookupError
            It is unknown, refuses its parameters, or cannot do what else is asked for.
        """
        from resample import registry

        method: Method = registry.build("warps", self.method)
        if self.has_layer and not self.fill:
            raise ValueError("--fill-by layer belongs to --fill; give both")
        if self.filter is not None:
            from resample_warp3d.methods.filtering import check_method

            registry.build("filters", self.filter)
            check_method(method)
        if not self.unmixed:
            return method
        if self.fill:
            raise ValueError("what is filled is mixed; leave out one of --unmixed and --fill")
        if self.filter is not None:
            raise ValueError("a filter mixes colors; leave out one of --unmixed and --filter")
        if is_dataclass(method) and hasattr(method, "labels"):
            return replace(method, labels=True)
        if self.method.partition(":")[0] not in UNMIXED:
            raise ValueError(
                f"{self.method} mixes colors; for labels take hybrid or {' or '.join(UNMIXED)}"
            )
        return method


class Joint(Choices):
    """How several views become one."""

    heading: ClassVar[str] = "Several sources"
    about: ClassVar[About] = About.LOOK

    blend: Annotated[
        Literal["feathered", "confident", "best"],
        Field(
            description="Of several views: feathered, by sampling and angle, fading out toward a "
            "view's border; confident, by sampling alone; best, one view for each pixel."
        ),
    ] = "feathered"
    match_colors: Annotated[
        Literal["gain", "gain-bias", "none"],
        Field(description="What makes several views equally bright. Their mean stays."),
    ] = "gain"
    match_depths: Annotated[
        Literal["scale", "none"],
        Field(description="What makes depths of several views meet. Their mean stays."),
    ] = "scale"
    votes: Annotated[
        Literal["majority", "none"],
        Field(description="Leave out what as many views look through as see."),
    ] = "majority"
    plain: Annotated[
        bool,
        Switch,
        Field(description="Take several views as they are: confident, and none of the others."),
    ] = False

    def joining(self, *, unmixed: bool) -> "Joining":
        """The choices; names are not blended."""
        from resample_warp3d.views.together import PLAIN, Joining

        chosen = (
            PLAIN
            if self.plain
            else Joining(self.blend, self.match_colors, self.match_depths, self.votes)
        )
        return replace(chosen, blend="best", colors="none") if unmixed else chosen


class Showing(Choices):
    """What of a warped picture is written."""

    heading: ClassVar[str] = "Picture"
    about: ClassVar[About] = About.LOOK

    show: Annotated[
        Literal["picture", "holes", "depth", "coverage", "magnification", "confidence"],
        Field(
            description="What of the new picture is written: itself; with its holes in the colors "
            "of --holes; or, as false colors, its depth, the share of pixels that is covered, px "
            "per px of the source, or how far it can be trusted."
        ),
    ] = "picture"

    @property
    def is_plain(self) -> bool:
        """Whether the picture itself is written."""
        return self.show == "picture"

    def check(self, *, unmixed: bool) -> None:
        """Refuse colors of names."""
        if unmixed and not self.is_plain:
            raise ValueError(f"--show {self.show} is in colors; leave out it or --unmixed")

    def check_still(self) -> None:
        """Refuse what films do not show."""
        if not self.is_plain:
            raise ValueError(f"--show {self.show} is made of a picture, not of a film")


class Extras(Choices):
    """What is written beside the picture."""

    heading: ClassVar[str] = "Further outputs"
    about: ClassVar[About] = About.TARGET

    holes: Annotated[
        Path | None,
        Field(
            description="What no view shows and why (.png): magenta hidden behind something, gray "
            "outside the source, blue without depth, yellow a crack that was filled."
        ),
    ] = None
    coverage: Annotated[
        Path | None,
        Field(description="Also write the share of each pixel that is covered (.png, .tif, .exr)."),
    ] = None
    depth_output: Annotated[
        Path | None,
        Field(
            description="Depth z: .exr and .npy in scene units; .png in 16 bits, of the depth "
            "scale, or 1000 per unit. Of a film as of animate."
        ),
    ] = None
    export: Annotated[
        Path | None, Field(description="The source as a colored mesh or points (.ply, .glb).")
    ] = None
    export_as: Annotated[
        Literal["mesh", "points"], About.LOOK, Field(description="What is exported.")
    ] = "mesh"
    stats: Stats = None

    def paths(self) -> list[Path | None]:
        """All files that are asked for."""
        return [self.holes, self.coverage, self.depth_output, self.export, self.stats]


class Travel(Choices):
    """How the camera of an animation moves."""

    heading: ClassVar[str] = "Camera"
    about: ClassVar[About] = About.LOOK

    path: Annotated[
        str,
        words("sway", "orbit", "dolly"),
        Field(
            description="Camera path: sway, left and right around the scene; orbit, in a circle; "
            "dolly, forward and back; or a file of poses, as in render."
        ),
    ] = "sway"
    amount: Annotated[
        float | None,
        Field(
            gt=0,
            description="How far, as a share of the distance of what is near. 0.1; dolly 0.3.",
        ),
    ] = None
    frames: Annotated[
        int | None, Field(description="Number of frames. Default: 48; one per pose of a file.")
    ] = None
