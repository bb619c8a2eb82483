"""What a file holds: a cloud, 3D Gaussians or particles, with the options of each."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from resample.command.settings import Choices
from resample_points.command import gaussians as of_gaussians
from resample_points.command.choices import Aimed, CloudOptions
from resample_points.command.density import SHARED, ParticleOptions
from resample_points.command.gaussians import GaussianOptions

if TYPE_CHECKING:
    from resample.command.session import Session
    from resample.files.animations import Frames, Shots
    from resample_points.data.cloud import Cloud
    from resample_points.geometry.spacing import Surfels
    from resample_points.scenes import Shape

NO_PARTICLES = ParticleOptions.usual()


class SceneKind(StrEnum):
    """What a file holds."""

    CLOUD = "clouds of points"
    GAUSSIANS = "3D Gaussians"
    PARTICLES = "particles"


@dataclass(frozen=True)
class FileOptions:
    """Options of all that files may hold."""

    clouds: CloudOptions
    gaussians: GaussianOptions
    particles: ParticleOptions = NO_PARTICLES

    def with_threads(self, threads: int) -> "FileOptions":
        """Return the options with another number of threads."""
        return replace(self, clouds=self.clouds.model_copy(update={"threads": threads}))


class Filmed(Protocol):
    """A scene that films go around."""

    @property
    def framing(self) -> "Surfels | Cloud":
        """What cameras are framed around."""

    def upright(self, aim: Aimed, /) -> Aimed:
        """Return cameras with the scene's own axis up, unless another is given."""

    def film(self, cameras: Sequence[Any], shape: "Shape", background: Any) -> "Shots":
        """Return the frames of a film."""


def kind_of(file: Path, options: FileOptions) -> SceneKind:
    """Return what a file holds; refuse options of the others."""
    from resample_points.files.gaussians.reading import is_gaussians
    from resample_points.files.particles import is_snapshot

    own: tuple[SceneKind, tuple[str, ...]] = (SceneKind.CLOUD, tuple(CloudOptions.model_fields))
    if is_snapshot(file) or options.particles.model_fields_set:
        own = SceneKind.PARTICLES, SHARED
    elif is_gaussians(file):
        own = SceneKind.GAUSSIANS, of_gaussians.SHARED
    kind, shared = own
    groups: dict[SceneKind, Choices] = {
        SceneKind.CLOUD: options.clouds,
        SceneKind.GAUSSIANS: options.gaussians,
        SceneKind.PARTICLES: options.particles,
    }
    for owner, group in groups.items():
        others = group.model_fields_set - (set(shared) if owner is SceneKind.CLOUD else set())
        if owner is not kind and others:
            name = "look" if min(others) == "appearance" else min(others).replace("_", "-")
            held = "none" if kind is SceneKind.CLOUD else kind
            raise ValueError(
                f"--{name} is an option of {owner}, and {file.name} holds {held}; leave it out"
            )
    return kind


def check_film_options(file: Path, options: FileOptions, output: Path, height: int) -> SceneKind:
    """Return what a file holds; refuse invalid options of a film before any work is done."""
    options.gaussians.check()
    kind = kind_of(file, options)
    if kind is SceneKind.CLOUD:
        options.clouds.check(output, height)
    elif kind is SceneKind.PARTICLES:
        options.particles.with_clouds(options.clouds).check_appearance(output, height)
    return kind


def scene_in(session: "Session", files: Sequence[Path], options: FileOptions) -> Filmed:
    """Read what a file holds, or the first of several that are a frame each."""
    from resample_points.command.particles import pictures_of
    from resample_points.command.rendering import ColoredScene, scene_of

    file = files[0]
    if len(files) > 1:
        first = scene_in(session, files[:1], options)
        if isinstance(first, ColoredScene) and first.scale is not None:
            span = "{!r},{!r}".format(*first.scale.span)
            options = replace(options, clouds=options.clouds.model_copy(update={"span": span}))
        return Sweep(first, files, options)
    kind = kind_of(file, options)
    if kind is SceneKind.PARTICLES:
        return pictures_of(session, file, options.particles.with_clouds(options.clouds))
    if kind is SceneKind.GAUSSIANS:
        return of_gaussians.gaussians_of(session, file, options.clouds, options.gaussians)
    return scene_of(session, file, options.clouds)


@dataclass(frozen=True)
class Sweep:
    """Files that are a frame each, framed as the first."""

    first: Filmed
    files: Sequence[Path]
    options: FileOptions

    @property
    def framing(self) -> "Surfels | Cloud":
        """What cameras are framed around."""
        return self.first.framing

    def upright(self, aim: Aimed) -> Aimed:
        """Return cameras with the scene's own axis up, unless another is given."""
        return self.first.upright(aim)

    def film(self, cameras: Sequence[Any], shape: "Shape", background: Any) -> "Shots":
        """Return the frames of a film; a frame's file is read when it is made."""
        from resample.command.session import Session
        from resample.files.animations import Shots

        def frame(n: int) -> Any:
            scene = scene_in(Session(is_quiet=True), self.files[n : n + 1], self.options)
            return scene.film(cameras[n : n + 1], shape, background).frame(0)

        job = dict(self.first.film(cameras, shape, background).job)
        known = [(file.resolve(), file.stat()) for file in self.files]
        job["files"] = [[str(file), stat.st_size, stat.st_mtime_ns] for file, stat in known]
        return Shots(len(cameras), frame, job)


def frames_of(
    files: Sequence[Path],
    options: FileOptions,
    cameras: Sequence[Any],
    shape: "Shape",
    background: Any,
    threads: int,
) -> "Frames":
    """Return the function that makes frames of what a file holds."""
    from resample.command.session import Session

    scene = scene_in(Session(), files, options.with_threads(threads))
    return scene.film(cameras, shape, background).frame
