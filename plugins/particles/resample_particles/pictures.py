"""Particles ready to be mapped: maps and films for the command line, and pages."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from resample.cameras.models import Camera, Orthographic
from resample_particles.choices import DensityOptions, number_of
from resample_points.command.choices import Aimed
from resample_points.command.rendering import Sweep
from resample_points.data.columns import corners_of

if TYPE_CHECKING:
    from resample.command.session import Session
    from resample.files.animations import Shots
    from resample.types import Doubles, Floats
    from resample_particles.density import DensityMap
    from resample_particles.mapping import MapPicture
    from resample_particles.particles import Particles
    from resample_points.command.choices import CloudStart
    from resample_points.data.cloud import Cloud
    from resample_points.scenes import Shape

FEW = 10_000  # most particles of previews
MEASURED = 4  # frames of a film by which the range of its colors is found


@dataclass(frozen=True)
class ParticlePictures:
    """Particles, ready to be mapped with the options of a command."""

    particles: "Particles"
    options: DensityOptions

    @cached_property
    def framing(self) -> "Cloud":
        """What cameras are framed around."""
        from resample_points.data.cloud import Cloud

        nothing = np.empty((0, 3), np.float32)
        return Cloud(self.particles.position, nothing, nothing, np.empty(0, np.float32))

    @cached_property
    def fewer(self) -> "ParticlePictures":
        """Every n-th particle, heavier and wider; for previews."""
        per = -(-len(self.particles) // FEW)
        if per < 2:
            return self
        few = self.particles.some(np.arange(0, len(self.particles), per))
        smoothing = None if few.smoothing is None else few.smoothing * per ** (1 / 3)
        return replace(self, particles=replace(few, mass=few.mass * per, smoothing=smoothing))

    @cached_property
    def middle(self) -> "Doubles":
        """Return the center (3,) of the particles' bounds."""
        position = self.particles.position
        return np.asarray((position.min(axis=0) + position.max(axis=0)) / 2, np.float64)

    def place_at(self, camera: Any, shape: "Shape", x: float, y: float) -> "Doubles | None":
        """Return the position at a point of the picture, in the slice or the middle's plane.

        None: cameras that see more than a half-space have no such plane.
        """
        from resample_points.painting.bending import places_at

        if not isinstance(camera, Camera | Orthographic):
            return None
        pose, chosen = camera.world_to_camera, self.options.slice
        middle = float(pose[2, :3] @ self.middle + pose[2, 3])
        depth = middle if chosen is None else number_of(chosen)
        (place,) = places_at(camera, shape, np.array([[x, y]]), np.array([depth]))
        return np.asarray(place)

    def upright(self, aim: Aimed) -> Aimed:
        """Return the cameras as they are: simulations have no axis up."""
        return aim

    def measure(self, camera: Any, shape: "Shape") -> "DensityMap":
        """Return the map that a camera sees."""
        from resample.engine import jit
        from resample_particles.density import column_density

        options = self.options
        with jit.threads(options.threads):
            return column_density(
                self.particles,
                camera,
                size=shape[::-1],
                kernel=options.kernel,
                quantity=options.quantity,
                slice_at=None if options.slice is None else number_of(options.slice),
            )

    def picture(self, camera: Any, shape: "Shape") -> "MapPicture":
        """Return the map that a camera sees, in colors."""
        from resample_particles.mapping import map_picture

        own = self.options
        found = self.measure(camera, shape)
        return map_picture(found, colormap=own.colormap, span=own.span, log=own.log)

    def shown(self, camera: Any, shape: "Shape", background: Any) -> "Floats":
        """Return a picture, with the bar of its colors if requested."""
        return self.with_bar(self.picture(camera, shape), background)

    def with_bar(self, picture: "MapPicture", background: Any) -> "Floats":
        """Return a picture's light, with the bar of its colors if requested."""
        from resample.measuring.color_bars import with_color_bar

        if not self.options.color_bar:
            return picture.rgba
        return with_color_bar(picture.rgba, picture.bar(background), background)

    def spanned(self, cameras: Sequence[Any], shape: "Shape") -> "ParticlePictures":
        """Return the scene with one range of colors for all frames of a film.

        It is that of `MEASURED` frames, evenly spaced.
        """
        from resample_particles.mapping import DECADES

        few = sorted({n * len(cameras) // MEASURED for n in range(MEASURED)})
        found = [self.picture(cameras[n], shape) for n in few]
        low, high = min(each.span[0] for each in found), max(each.span[1] for each in found)
        if found[0].is_log and self.options.span is None:
            low = max(low, high * 10.0**-DECADES)
        return replace(self, options=self.options.model_copy(update={"span": f"{low!r},{high!r}"}))

    def film(self, cameras: Sequence[Any], shape: "Shape", background: Any) -> "Shots":
        """Return the frames of a film."""
        from resample.files.animations import Shots, fingerprint
        from resample.files.saving import screen_levels
        from resample_points.scenes import film_job

        scene = self.spanned(cameras, shape)

        def frame(n: int) -> Any:
            rgba = scene.shown(cameras[n], shape, background)
            return screen_levels(rgba, background=background)

        held = self.particles
        smoothing = () if held.smoothing is None else (held.smoothing,)
        job = {
            "particles": fingerprint(held.position, held.mass, *smoothing),
            "quantity": [fingerprint(values) for values in held.quantities.values()],
            **film_job(cameras, shape, background),
            "look": scene.options.model_dump(exclude={"threads"}),
        }
        return Shots(len(cameras), frame, job)


def particles_in(session: "Session", file: Path, options: DensityOptions) -> "Particles":
    """Read the particles of a command, and estimate missing smoothing lengths."""
    from resample.engine import jit
    from resample.messages import naming
    from resample_particles.files import read_particles

    wanted = () if options.quantity is None else (options.quantity,)
    with session.stage("read", bar="reading"):
        particles = read_particles(file, options.kind, quantities=wanted)
    with (
        jit.threads(options.threads),
        session.stage("prepare", bar="measuring"),
        naming(file.name),
    ):
        return particles.smoothed()


def pictures_of(session: "Session", file: Path, options: DensityOptions) -> ParticlePictures:
    """Read the particles of a command, those in the box of --crop."""
    particles = particles_in(session, file, options)
    if options.crop is not None:
        low, high = corners_of(options.crop)
        inside = (particles.position >= low) & (particles.position <= high)
        kept = inside.all(axis=1)
        if not kept.any():
            raise ValueError("no particle is in the box of --crop")
        particles = particles.some(kept)
    return ParticlePictures(particles, options)


def scene_in(
    files: Sequence[Path],
    options: DensityOptions,
    session: "Session",
    threads: int | None = None,
) -> "ParticlePictures | ParticleSweep":
    """Read the particles of a file, or of the first of several that are a frame each."""
    if threads is not None:
        options = options.model_copy(update={"threads": threads})
    first = pictures_of(session, files[0], options)
    if len(files) == 1:
        return first
    return ParticleSweep(first, files, partial(scene_in, options=options))


class ParticleSweep(Sweep):
    """Snapshots that are a frame each, framed and colored as the first."""

    def film(self, cameras: Sequence[Any], shape: "Shape", background: Any) -> "Shots":
        """Return the frames of a film; a frame's file is read when it is made."""
        first = cast(ParticlePictures, self.first).spanned(cameras, shape)
        read = partial(scene_in, options=first.options)
        return Sweep(first, self.files, read).film(cameras, shape, background)


def density_of(
    session: "Session",
    file: Path,
    options: DensityOptions,
    start: "CloudStart",
    shape: tuple[int, int],
) -> "DensityMap":
    """Read the particles of a command, and make their map."""
    from resample.engine import jit
    from resample.messages import naming
    from resample_particles.density import column_density

    if start.model_fields_set:
        from resample_points.scenes import camera_of

        scene = pictures_of(session, file, options)
        with session.stage("paint", bar="painting"), naming(file.name):
            return scene.measure(camera_of(scene.framing, shape, start.start()), shape)
    particles = particles_in(session, file, options)
    region = None if options.crop is None else corners_of(options.crop)
    with (
        jit.threads(options.threads),
        session.stage("paint", bar="painting"),
        naming(file.name),
    ):
        view = options.axis or "z"
        return column_density(
            particles,
            view,
            size=shape[::-1],
            kernel=options.kernel,
            quantity=options.quantity,
            slice_at=_slice(particles, view, options.slice, region),
            region=region,
        )


def _slice(particles: "Particles", axis: str, given: str | None, region: Any) -> float | None:
    """Return the position of a slice along an axis; shares are of the region."""
    from resample_particles.placing import region_of

    if given is None:
        return None
    text = given.strip()
    if not text.endswith("%"):
        return number_of(text)
    low, high = region_of(particles, region)[:, "xyz".index(axis)]
    return float(low + (high - low) * number_of(text[:-1]) / 100.0)
