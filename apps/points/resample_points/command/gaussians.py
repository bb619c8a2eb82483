"""Render, film and convert 3D Gaussians for the command line."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from cyclopts import Parameter
from pydantic import Field

from resample.command.flags import OptionTopic, Several
from resample.command.settings import Choices, FrameFormat
from resample_points.command.choices import Aimed, CloudOptions, Crop

if TYPE_CHECKING:
    from resample.command.session import Session
    from resample.files.animations import Shots
    from resample.files.saving import DepthSlab
    from resample.types import Doubles
    from resample_points.data.cloud import Cloud
    from resample_points.data.gaussians import Gaussians
    from resample_points.painting.gaussians import GaussianStyle, StoredGaussians
    from resample_points.scenes import Shape

SHARED = ("also", "crop", "threads")  # options of clouds that Gaussians have, too
BYTES = 280  # per Gaussian in memory, with a picture's data of it
FEW = 100_000  # most Gaussians of previews
SHARE = 0.8  # share of the free memory that projected Gaussians may take


LeastOpacity = Annotated[
    float, Field(ge=0, le=1, description="Leave out Gaussians of less opacity.")
]
Largest = Annotated[
    float | None,
    Field(description="Leave out Gaussians of larger standard deviations, scene units."),
]


class GaussianOptions(Choices):
    """Look of 3D Gaussians."""

    heading: ClassVar[str] = "3D Gaussians"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    appearance: Annotated[
        Literal["trained", "bare", "affine"],
        Parameter(name="--look"),
        Field(
            description="How Gaussians appear: trained, as wide as in training and exact on every "
            "ray; bare, as in the file; affine, as usual renderers draw them."
        ),
    ] = "trained"
    order: Annotated[
        Literal["depth", "distance", "rays"] | None,
        Field(
            description="Compositing order: depth pops when the camera turns, distance when it "
            "moves; rays sorts each ray. [default: depth; distance for panoramas, lenses]"
        ),
    ] = None
    trained_focal: Annotated[
        str | None,
        OptionTopic.SOURCE,
        Field(
            description="Focal length of the pictures of training, px; or their cameras: "
            "cameras.json, transforms.json or a folder of COLMAP. [default: of cameras beside the "
            "scene; or estimated from its smallest Gaussians]"
        ),
    ] = None
    subpixels: Annotated[
        int | None,
        Field(
            ge=1,
            le=8,
            description="Sub-pixels per side of a pixel. [default: more, the thinner the "
            "Gaussians]",
        ),
    ] = None
    nearest: Annotated[
        float | None,
        Field(
            description="Depth before which nothing is shown, scene units. [default: 0.02 of the "
            "radius of half the scene; 0 with --look bare]"
        ),
    ] = None
    least_opacity: LeastOpacity = 0.0
    largest: Largest = None

    eyes: Annotated[
        float | None,
        Field(
            gt=0,
            description="Distance between the eyes, scene units: both their pictures, side by side "
            "and each of the size. [default: one picture]",
        ),
    ] = None

    deep: Annotated[
        int | None,
        Field(
            ge=1,
            le=1024,
            description="Write a deep .exr with this many slabs of depth instead of one layer.",
        ),
    ] = None

    def check(self) -> None:
        """Reject invalid options before any work is done."""
        self.style()
        if self.deep is not None and (self.eyes is not None or self.order not in (None, "depth")):
            raise ValueError("--deep is for one picture in the order of depth; leave others out")

    def style(self) -> "GaussianStyle":
        """Return the style for `render_gaussians`."""
        from resample_points.painting.gaussians import GaussianStyle

        focal = None if self.trained_focal is None else focal_of(self.trained_focal)
        return GaussianStyle(self.appearance, self.order, focal, self.subpixels, self.nearest)


def focal_of(text: str) -> float:
    """Focal length, px, from a number or the median of a file of cameras."""
    import numpy as np

    from resample.cameras.files import read_shots

    try:
        return float(text)
    except ValueError:
        pass
    shots = [shot.camera.fx for shot in read_shots(text) if shot.camera is not None]
    if not shots:
        raise ValueError(f"{text} has poses without intrinsics; give --trained-focal in px")
    return float(np.median(shots))


@dataclass(frozen=True)
class GaussianPictures:
    """Gaussians, ready to be rendered with the options of a command."""

    gaussians: "Gaussians | StoredGaussians"
    options: GaussianOptions
    threads: int | None = None

    @cached_property
    def fewer(self) -> "GaussianPictures":
        """The largest and most opaque Gaussians, in one color each; for previews."""
        import numpy as np

        from resample_points.data.gaussians import Gaussians, some_gaussians

        scene = self.gaussians
        if not isinstance(scene, Gaussians) or len(scene.opacity) <= FEW:
            return self
        area = scene.scale.prod(axis=1) / np.maximum(scene.scale.min(axis=1), np.float32(1e-30))
        largest = np.argpartition(-area * scene.opacity, FEW)[:FEW]
        none = np.zeros((len(scene.opacity), 0, 3), np.int16)
        few = some_gaussians(scene._replace(harmonics=none), np.sort(largest))
        return replace(self, gaussians=few)

    @cached_property
    def framing(self) -> "Cloud":
        """Points that cameras frame."""
        from resample_points.painting.gaussians import shown_part

        return shown_part(self.gaussians)

    @property
    def count(self) -> int:
        """Number of Gaussians."""
        from resample_points.painting.gaussians import StoredGaussians

        scene = self.gaussians
        return scene.file.count if isinstance(scene, StoredGaussians) else len(scene.opacity)

    def print(self) -> str:
        """Fingerprint of the visible scene."""
        from resample.files.animations import fingerprint
        from resample_points.painting.gaussians import StoredGaussians

        scene = self.gaussians
        if isinstance(scene, StoredGaussians):
            return fingerprint(*scene.file.shape_of(slice(None)))
        return fingerprint(*scene[:6])

    @property
    def up(self) -> str:
        """The scene's axis up; files that do not state it have y down, as photographs."""
        from resample_points.data.gaussians import DOWN

        return self.gaussians.up or DOWN

    def upright(self, aim: Aimed) -> Aimed:
        """Return cameras with the scene's own axis up, unless another is given."""
        return aim if "up" in aim.model_fields_set else aim.model_copy(update={"up": self.up})

    def picture(self, camera: Any, shape: "Shape", background: Any = None) -> Any:
        """Render a frame, or the frames of both eyes beside each other."""
        import numpy as np

        from resample.cameras.models import Camera

        apart = self.options.eyes
        if apart is None:
            return self._one(camera, shape, background)
        if not isinstance(camera, Camera):
            raise ValueError("--eyes is for perspective cameras; leave it out of other pictures")
        frames = []
        for side in (0.5, -0.5):  # the left eye has the scene farther to the right
            pose = camera.world_to_camera.copy()
            pose[0, 3] += side * apart
            frames.append(self._one(camera.moved(pose), shape, background))
        left, right = frames
        names = ("rgba", "depth", "first_depth", "coverage", "value")
        pairs = ((name, getattr(left, name), getattr(right, name)) for name in names)
        return left._replace(**{name: np.concatenate(pair, axis=1) for name, *pair in pairs})

    def _one(self, camera: Any, shape: "Shape", background: Any) -> Any:
        """Render a frame."""
        from resample.console import note
        from resample_points.painting.gaussians import render_gaussians

        free = free_memory()
        frame = render_gaussians(
            self.gaussians,
            camera,
            size=shape[::-1],
            style=self.options.style(),
            background=background,
            memory=None if free == float("inf") else int(SHARE * free),
            threads=self.threads,
        )
        training = self.gaussians.training
        is_used = self.options.trained_focal is None and self.options.appearance == "trained"
        if is_used and training is not None and training.is_guessed_for(camera):
            note(
                "pixels of training are estimated as"
                f" {training.distance / training.focal:.3g} scene units;"
                " cameras.json beside the scene, or --trained-focal, tells them"
            )
        return frame

    def write(self, path: Path, camera: Any, form: FrameFormat) -> None:
        """Render a frame, and write it."""
        from resample.files.saving import check_deep, tell_empty, write_deep, write_frame

        if self.options.deep is not None:
            check_deep(path)
            write_deep(path, self._slabs(camera, form.height_and_width(), self.options.deep))
            return

        behind = form.behind(path.suffix)
        frame = self.picture(camera, form.height_and_width(), behind)
        write_frame(path, frame, bits=form.bits, background=behind)
        tell_empty(path, not frame.coverage.any())

    def film(self, cameras: Sequence[Any], shape: "Shape", background: Any) -> "Shots":
        """Return the frames of a film."""
        from resample.files.animations import Shots
        from resample.files.saving import screen_levels
        from resample_points.scenes import film_job

        def frame(n: int) -> Any:
            return screen_levels(self.picture(cameras[n], shape, background).rgba)

        job = {
            "gaussians": self.print(),
            **film_job(cameras, shape, background),
            "look": self.options.model_dump(),
        }
        return Shots(len(cameras), frame, job)

    def _slabs(self, camera: Any, shape: "Shape", count: int) -> "Iterator[DepthSlab]":
        """Yield slabs front to back, each of the Gaussians with centers in it."""
        import numpy as np

        from resample.files.saving import DepthSlab, between
        from resample_points.data.gaussians import Gaussians, some_gaussians

        scene = self.gaussians
        if not isinstance(scene, Gaussians) or not hasattr(camera, "view"):
            raise ValueError("--deep is for scenes in memory, and not for panoramas; leave it out")
        view = camera.view()
        depth = scene.position @ view.rotation[2] + view.translation[2]
        ahead = depth[depth > view.near]
        ends = np.quantile(ahead, np.linspace(0, 1, count + 1)) if ahead.size else np.zeros(2)
        shown = np.zeros((*shape, 4))
        for near, far in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True):
            if not (depth <= far).any():
                continue
            front = replace(self, gaussians=some_gaussians(scene, depth <= far))
            more = between(front.picture(camera, shape).rgba, shown)
            shown += (1 - shown[..., 3:]) * more
            yield DepthSlab(near, far, more.astype(np.float32))


def gaussians_of(
    session: "Session", file: Path, clouds: CloudOptions, options: GaussianOptions
) -> GaussianPictures:
    """Read the Gaussians that a command draws."""
    from resample_points.data.gaussians import Gaussians, training_of

    whole = gaussians_read(session, file, clouds, options)
    if isinstance(whole, Gaussians) and whole.training is None:
        seen = training_of(whole.position, whole.scale, whole.opacity)
        whole = whole._replace(training=seen)
    return GaussianPictures(whole, options, clouds.threads)


def gaussians_read(
    session: "Session", file: Path, clouds: CloudOptions, options: GaussianOptions
) -> "Gaussians | StoredGaussians":
    """Read Gaussians, join and crop them."""
    from resample.cameras.files import read_pose
    from resample.messages import naming
    from resample_points.data.columns import corners_of
    from resample_points.data.gaussians import Crop, cropped_gaussians, joined_gaussians
    from resample_points.files.gaussians.formats import read_gaussians, stored_gaussians
    from resample_points.painting.gaussians import StoredGaussians

    crop = Crop(corners_of(clouds.crop), options.least_opacity, options.largest)
    with session.stage("read", bar="reading"):
        stored = None if clouds.also else stored_gaussians(file)
        if stored is not None and stored.count * BYTES > int(SHARE * free_memory()):
            return StoredGaussians(stored, crop)
        scenes, poses = [read_gaussians(file)], list["Doubles | None"]([None])
        for text in clouds.also:  # a scene, and the file of its pose if there is one
            name, comma, pose = text.rpartition(",")
            is_alone = Path(text).exists() or not comma
            poses.append(None if is_alone else read_pose(pose))
            scenes.append(read_gaussians(text if is_alone else name))
        whole = scenes[0] if len(scenes) == 1 else joined_gaussians(scenes, poses)
        with naming(file.name):
            return cropped_gaussians(whole, **crop._asdict())


def free_memory() -> float:
    """Bytes that a command may take, at least its current ones."""
    from resample.memory import ALLOWED, available_memory, memory_in_use

    allowed, free = ALLOWED.get(), available_memory()
    left = [] if free is None else [float(free)]
    if allowed is not None:
        left.append(float(max(allowed - memory_in_use(), 0)))
    return min(left, default=float("inf"))


class ConvertOptions(Choices):
    """Options for writing 3D Gaussians."""

    heading: ClassVar[str] = "Look"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    also: Annotated[
        tuple[str, ...],
        OptionTopic.SOURCE,
        Several,
        Field(
            description="Another scene to join, and a file of its pose: b.ply or b.ply,pose.txt."
        ),
    ] = ()
    pose: Annotated[
        str | None,
        OptionTopic.SOURCE,
        Field(description="File of a pose: the scene is moved and turned by it."),
    ] = None
    crop: Crop = None
    degree: Annotated[
        int | None, Field(ge=0, le=3, description="Highest degree of harmonics to keep.")
    ] = None
    least_opacity: LeastOpacity = 0.0
    largest: Largest = None

    def check(self) -> None:
        """Reject invalid options before any work is done."""
        from resample_points.data.columns import box_of

        box_of(self.crop)


def converted(session: "Session", file: Path, output: Path, options: ConvertOptions) -> None:
    """Read Gaussians, and write those that the options keep."""
    from resample.cameras.files import read_pose
    from resample.console import say
    from resample.memory import amount
    from resample_points.data.gaussians import DOWN, Gaussians, placed_gaussians, with_up
    from resample_points.data.harmonics import COUNTS
    from resample_points.files.gaussians.formats import suffix_of, write_gaussians

    clouds = CloudOptions(also=options.also, crop=options.crop)
    kept = GaussianOptions(least_opacity=options.least_opacity, largest=options.largest)
    scene = gaussians_read(session, file, clouds, kept)
    if not isinstance(scene, Gaussians):
        raise ValueError(f"{file.name} has {scene.file.count:,} Gaussians, too many for the memory")
    if options.pose is not None:
        scene = placed_gaussians(scene, read_pose(options.pose))
    width = scene.harmonics.shape[1]
    if options.degree is not None:
        width = min(width, COUNTS[options.degree])
        scene = scene._replace(harmonics=scene.harmonics[:, :width])
    is_ply = [name.suffix.lower() == ".ply" for name in (file, output)]
    if is_ply == [False, True]:  # most programs that read PLY do not read its axis
        scene = with_up(scene, DOWN)._replace(up=None)
    with session.stage("write", bar="writing"):
        write_gaussians(output, scene)
    lost = "" if suffix_of(output) != ".splat" or not width else "; .splat has no harmonics"
    say(
        f"{output.name}: {len(scene.opacity):,} Gaussians with harmonics of degree "
        f"{COUNTS.index(width)}, {amount(output.stat().st_size)}{lost}"
    )
