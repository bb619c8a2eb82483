"""Options of the command line for warps and films."""

import math
import re
from dataclasses import is_dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from resample.command.flags import (
    LENS,
    Coverage,
    Hyphen,
    Inline,
    OptionTopic,
    Resume,
    Shape,
    Stats,
    Switch,
    check_intrinsics,
    with_intrinsics,
)
from resample.command.settings import (
    Choices,
    MethodsFilter,
    Threads,
)

if TYPE_CHECKING:
    from resample.cameras.models import Camera
    from resample.files.films import FilmCoding, StereoMarks
    from resample_warp3d.depth.encodings import DepthEncoding
    from resample_warp3d.types import Method
    from resample_warp3d.views.multi_source import Joining

RELATIVE = ("relative", "relative-z")
Refine = Literal["auto", "none", "snap", "sharpen", "shift", "complete", "densify"]
UNMIXED = ("mcmillan", "mcmillan-zbuffer", "opencv")  # give each pixel the color of one sample
CLOCK = re.compile(r"(?:(?:(\d+):)?(\d+):)?(\d+\.?\d*|\.\d+)", re.ASCII)
BITS = re.compile(r"(\d+(?:\.\d+)?)([kM]?)", re.ASCII)
MEAN, SPREAD = "0.485,0.456,0.406", "0.229,0.224,0.225"  # of ImageNet, as most networks take them
SHORTER = 518  # px of a picture's shorter side, of Depth Anything
UNITS = {"": 1, "k": 1000, "M": 1_000_000}


class Depth(Choices):
    """Meaning of the depth file's numbers."""

    heading: ClassVar[str] = "Input"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    depth_kind: Annotated[
        Literal["z", "ray", "inverse", "disparity", "relative", "relative-z"],
        Field(
            description="z along the camera's axis, ray length, inverse (1 / z), or disparity of a "
            "calibrated pair, where 0, NaN and inf are unknown; or a network's output: relative, "
            "larger is nearer, or relative-z, larger is farther."
        ),
    ] = "z"
    depth_scale: Annotated[
        float | None,
        Field(
            description="File values per unit: 1000 for mm, 5000 for TUM. Not for floats. "
            "[default: 1 for floats; integers need one]"
        ),
    ] = None
    near: Annotated[
        float | None,
        Field(
            description="Inverse depth: z at the largest value. Relative depth: least z. "
            "[default: 1 "
            "for relative depth]"
        ),
    ] = None
    far: Annotated[
        float | None,
        Field(
            description="Inverse depth: z at 0; may be inf. Relative depth: largest z. [default: "
            "10 "
            "times --near for relative depth]"
        ),
    ] = None
    baseline: Annotated[
        float | None,
        Field(
            description="Disparity: distance between the two cameras, scene units. "
            "[default: none; disparity needs one]"
        ),
    ] = None
    focal: Annotated[
        float | None,
        Field(description="Disparity: focal length in px. [default: from the intrinsics]"),
    ] = None
    depth_intrinsics: Annotated[
        str | None,
        LENS,
        Hyphen,
        Field(
            description="fx,fy,cx,cy[,skew] of a separate depth camera, px of the depth, or a "
            "file as for --intrinsics; its depth is reprojected to the picture's camera."
        ),
    ] = None
    depth_pose: Annotated[
        str | None,
        OptionTopic.SOURCE,
        Field(
            description="Pose of the depth camera: file or file:frame, as for --pose. [default: "
            "the picture's]"
        ),
    ] = None
    confidence: Annotated[
        Path | None,
        OptionTopic.SOURCE,
        Field(
            description="Confidence of the depth, a picture or .npy: where low, depth is unknown."
        ),
    ] = None
    least_confidence: Annotated[
        float | None,
        Field(description="Smaller confidence is low. [default: half of the largest]"),
    ] = None
    doffs: Annotated[
        float,
        Hyphen,
        Field(description="Disparity: principal point of the right view minus the left's, px."),
    ] = 0.0

    def check(self) -> None:
        """Refuse wrong options before any file is read."""
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
        if self.least_confidence is not None and self.confidence is None:
            raise ValueError("--least-confidence belongs to --confidence; give both")
        if self.depth_pose is not None and self.depth_intrinsics is None:
            raise ValueError("--depth-pose belongs to --depth-intrinsics; give both")
        if self.depth_intrinsics is not None:
            check_intrinsics("depth-intrinsics", self.depth_intrinsics)

    @property
    def scale_of_z(self) -> float | None:
        """File values per unit, if they are z."""
        return self.depth_scale if self.depth_kind == "z" else None

    def range(self) -> tuple[float, float]:
        """Return the range of z that relative depth is mapped to."""
        from resample_warp3d.depth import encodings

        near = encodings.NEAR if self.near is None else self.near
        return near, encodings.FAR * near if self.far is None else self.far

    def _relative(self) -> "DepthEncoding":
        from resample_warp3d.depth.encodings import RelativeDepth

        return RelativeDepth(*self.range(), self.depth_kind == "relative-z")

    @property
    def is_relative(self) -> bool:
        """Whether the numbers have an unknown scale."""
        return self.depth_kind in RELATIVE

    def camera(self, camera: "Camera", shape: Shape, stored: Shape) -> "Camera":
        """Return the depth's camera: its own, or the picture's at the depth's size."""
        from resample.cameras.files import read_pose

        if self.depth_intrinsics is None:
            return camera if shape == stored else camera.resized(shape, stored)
        pose = camera.world_to_camera if self.depth_pose is None else read_pose(self.depth_pose)
        own = with_intrinsics("depth-intrinsics", self.depth_intrinsics, "corner")
        return own.sized(*stored).moved(pose)

    def encoding(self, camera: "Camera") -> "DepthEncoding":
        """Return the encoding of the numbers, for a picture of the camera."""
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


class DepthWarping(Choices):
    """How pictures are warped."""

    heading: ClassVar[str] = "Method"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    method: Annotated[
        str,
        Field(description="Method: hybrid, paper, mesh, mcmillan ...; see resample plugins."),
    ] = "hybrid"
    filter: MethodsFilter = None
    noise: Annotated[
        float | None,
        Field(
            ge=0,
            description="Relative noise of the depth, 0.002 for 0.2 %. [default: estimated from "
            "the depth]",
        ),
    ] = None
    refine: Annotated[
        Refine,
        Field(
            description="Repair of depth that does not fit the picture: snap moves edges to color "
            "edges, sharpen hardens soft edges, shift moves the map by whole pixels. "
            "All of them also fill gaps; complete "
            "does this alone, densify for sparse maps; auto chooses."
        ),
    ] = "auto"
    fill: Annotated[
        bool,
        Switch,
        Field(description="Fill holes that no view shows from the background beside them."),
    ] = False
    fill_by: Annotated[
        Literal["picture", "layer"],
        Field(
            description="Source of --fill: each rendered picture, or a background layer behind "
            "silhouettes that is made once per source, the same in all frames of a film."
        ),
    ] = "picture"
    unmixed: Annotated[
        bool,
        Switch,
        Field(description="Colors are labels: never mix them."),
    ] = False
    threads: Threads = None

    @property
    def has_layer(self) -> bool:
        """Whether sources get a background layer behind their silhouettes."""
        return self.fill_by == "layer"

    def built(self) -> "Method":
        """Return the method."""
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
            raise ValueError("filling mixes colors; leave out one of --unmixed and --fill")
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
    """Options of combining several views."""

    heading: ClassVar[str] = "Several sources"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    blend: Annotated[
        Literal["feathered", "confident", "best"],
        Field(
            description="Of several views: feathered, weighted by sampling and angle, fading "
            "toward a view's border; confident, weighted by sampling only; best, one view per "
            "pixel."
        ),
    ] = "feathered"
    match_colors: Annotated[
        Literal["gain", "gain-bias", "none"],
        Field(
            description="Correction that makes several views equally bright, keeping their mean."
        ),
    ] = "gain"
    match_depths: Annotated[
        Literal["scale", "none"],
        Field(
            description="Correction that aligns the depths of several views, keeping their mean."
        ),
    ] = "scale"
    match_poses: Annotated[
        Literal["refined", "none"],
        Field(
            description="Movement of several views, in which their colors and depths agree, "
            "keeping the mean of their poses."
        ),
    ] = "refined"
    votes: Annotated[
        Literal["majority", "none"],
        Field(description="Drop samples that as many views contradict as confirm."),
    ] = "majority"
    plain: Annotated[
        bool,
        Switch,
        Field(description="Combine several views without corrections or votes: --blend confident."),
    ] = False

    def joining(self, *, unmixed: bool) -> "Joining":
        """Return the options; labels are not blended."""
        from resample_warp3d.views.multi_source import PLAIN, Joining

        chosen = (
            PLAIN
            if self.plain
            else Joining(
                self.blend, self.match_colors, self.match_depths, self.votes, self.match_poses
            )
        )
        return replace(chosen, blend="best", colors="none") if unmixed else chosen


class Showing(Choices):
    """Which result of a warp is written."""

    heading: ClassVar[str] = "Picture"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    show: Annotated[
        Literal["picture", "holes", "depth", "coverage", "magnification", "confidence"],
        Field(
            description="Result to write: the picture; the picture with its holes in the colors "
            "of --holes; or, in false color, depth, covered share of each pixel, magnification "
            "(px per px of the source), or confidence."
        ),
    ] = "picture"

    @property
    def is_plain(self) -> bool:
        """Whether the picture itself is written."""
        return self.show == "picture"

    def check(self, *, unmixed: bool) -> None:
        """Refuse false colors of labels."""
        if unmixed and not self.is_plain:
            raise ValueError(
                f"--show {self.show} is in false colors; leave out --show or --unmixed"
            )


class Extras(Choices):
    """Files to write beside the picture."""

    heading: ClassVar[str] = "Further outputs"
    about: ClassVar[OptionTopic] = OptionTopic.TARGET

    holes: Annotated[
        Path | None,
        Field(
            description="Also write the holes by their cause (.png): magenta hidden behind "
            "something, gray outside the source, blue without depth, yellow a crack that was "
            "filled."
        ),
    ] = None
    coverage: Coverage = None
    depth_output: Annotated[
        Path | None,
        Field(
            description="Also write depth z: .exr and .npy in scene units; .png in 16 bits "
            "(values per unit: the depth scale, or 1000). For a film a folder, or "
            "a name with * for the frame's number, such as depth/*.exr."
        ),
    ] = None
    export: Annotated[
        Path | None,
        Field(description="Also write the source as a colored mesh or points (.ply, .glb)."),
    ] = None
    export_as: Annotated[
        Literal["mesh", "points"], OptionTopic.APPEARANCE, Field(description="Geometry to export.")
    ] = "mesh"
    stats: Stats = None

    def paths(self) -> list[Path | None]:
        """Return all files to write."""
        return [self.holes, self.coverage, self.depth_output, self.export, self.stats]


class Travel(Choices):
    """Camera path of an animation."""

    heading: ClassVar[str] = "Camera"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    path: Annotated[
        str,
        Inline(("sway", "orbit", "dolly")),
        Field(
            description="Camera path: sway, left and right around the scene; orbit, in a circle; "
            "dolly, forward and back; or a file of poses: TUM, Open3D, NeRF, COLMAP or .toml."
        ),
    ] = "sway"
    amount: Annotated[
        float | None,
        Field(
            gt=0,
            description="Size of the path, relative to the near distance. [default: 0.1; 0.3 for "
            "dolly]",
        ),
    ] = None
    frames: Annotated[
        int | None,
        Field(
            description="Number of frames. [default: 48; one per pose of a file, or per picture of "
            "a film]"
        ),
    ] = None


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
