"""Render a volume: classify, shade, resample."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from resample.cameras.models import AnyCamera
from resample.cameras.viewpoints import Orbit, Sphere, Viewpoint, camera_from
from resample.console import progress_bar
from resample.files.saving import DepthSlab, between
from resample.messages import warn
from resample.painting.choices import MEASURING, Projection
from resample.progress import Progress
from resample.resampler import Resampler
from resample.types import NO_TRIANGLES, Doubles, Frame, LatticeField, Samples, Triangles, View
from resample_volume import appearance as looks
from resample_volume.appearance import Appearance, Tone, VolumeLayer
from resample_volume.classification.presets import LEVELS
from resample_volume.classification.transfer import Faded, Transfer
from resample_volume.classification.value_statistics import survey
from resample_volume.data.recordings import how, in_unit, mm_of, unit_of_space
from resample_volume.data.values import as_array, as_arrays, is_streamed
from resample_volume.types import Volume
from resample_volume.voxels import framing
from resample_volume.voxels.gathered import Gathered, gathered, lit_lattice, with_shadows
from resample_volume.voxels.shading import (
    Light,
    cue_range,
    cued,
    shade,
    viewer_of,
    voxel_transmittance,
)
from resample_volume.voxels.visible import Voxels, classify

if TYPE_CHECKING:
    from resample_volume.meshes import SceneMesh

Visible: TypeAlias = Voxels | Gathered | list[Gathered]
Shaded: TypeAlias = Samples | LatticeField | list[LatticeField]  # input of a renderer
Fit = Literal["visible", "volume"]  # what cameras orbit
# As `visible`, then zoomed and panned to fill the picture, or most of it.
Fitted = Fit | Literal["picture", "most"]
AROUND = 0.04  # of the visible part, left free around it without a camera


def placement(media: Sequence[VolumeLayer]) -> tuple[list[VolumeLayer], Volume, Doubles, Doubles]:
    """Place volumes in a scene: return them, their lattice, its former center, clip planes."""
    from resample_volume.series import common_lattice

    unit = unit_of_space(media[0][0])
    media = [(in_unit(volume, unit), look) for volume, look in media]
    whole, middle = common_lattice([volume for volume, _ in media])
    whole = whole._replace(origin=whole.origin - middle)
    moved = [(volume._replace(origin=volume.origin - middle), look) for volume, look in media]
    first, look = moved[0]
    cuts = [framing.planes(first, look.crop), framing.planes(whole, None, look.cuts)]
    return moved, whole, middle, np.concatenate(cuts)


def fields_of(voxels: Gathered | list[Gathered]) -> list[Gathered]:
    """Return fields as a list, also a single one."""
    return voxels if isinstance(voxels, list) else [voxels]


def shown_together(
    media: Iterable[VolumeLayer], clip: Doubles, resampler: Resampler
) -> framing.FramedVoxels:
    """Return the voxels of volumes in one scene that are visible when composited."""
    shown = []
    for volume, look in media:
        shape = looks.transfer_of(volume, look.framing or look.transfer)
        radius = resampler.reconstruction.radius
        shown.append(framing.shown_by(volume, shape, clip, radius, resampler.iso))
    coarsest = max(shown, key=lambda one: float(np.linalg.norm(one.lattice, axis=0).max()))
    return coarsest._replace(parts=lambda: chain.from_iterable(one.parts() for one in shown))


def visible_voxels(volume: Volume, appearance: Appearance) -> Voxels:
    """Return the voxels that the transfer function shows, with gradients if needed."""
    transfer = looks.transfer_of(volume, appearance)
    needed = transfer.needs_gradient or appearance.gradient_opacity is not None
    gradient = appearance.gradient if needed or appearance.light is not None else None
    fading, labels = appearance.gradient_opacity, appearance.labels
    return classify(volume, transfer, gradient=gradient, gradient_opacity=fading, labels=labels)


def _field_transfer(volume: Volume, appearance: Appearance, resampler: Resampler) -> Transfer:
    """Return the transfer function of a field, checked against its projection."""
    projection = resampler.projection
    if volume.colors is not None and projection is not Projection.COMPOSITE:
        raise ValueError(
            f"{volume.name} has colors, which need the projection composite; for others "
            f"{how('channel', volume.colors.shape[-1])}"
        )
    transfer = looks.transfer_of(volume, appearance, projection)
    if transfer.needs_gradient and projection is not Projection.COMPOSITE:
        raise ValueError(
            f"the projection {projection} shows values, which have no color in a transfer function "
            "of values and gradients; take one of values alone"
        )
    if appearance.gradient_opacity is not None:
        transfer = Faded(transfer, appearance.gradient_opacity)
    return transfer


def _pictures(
    volume: Volume, values: Any, appearance: Appearance, voxels: Visible
) -> "list[SceneMesh]":
    """Return planes and isosurfaces of a look as meshes in the volume's scene."""
    if not isinstance(voxels, Gathered) or not (appearance.planes or appearance.surfaces):
        return []
    from resample_volume.meshes import plane_mesh, surface_mesh
    from resample_volume.meshes import settled as settled_plane

    planes = [settled_plane(plane, volume) for plane in appearance.planes]
    made = [plane_mesh(plane, volume, voxels) for plane in planes]
    known = volume._replace(values=values)
    return made + [surface_mesh(one, known, voxels) for one in appearance.surfaces]


def _placed(meshes: "tuple[SceneMesh, ...]", middle: Doubles) -> Triangles:
    """Return all meshes for ray casting, with `middle` as the scene's origin."""
    if not meshes:
        return NO_TRIANGLES
    from resample_volume.meshes import placed

    return placed(meshes, middle)


def lit_samples(voxels: Voxels, light: Light | None, camera: AnyCamera) -> Samples:
    """Return samples with the light that voxels send to a camera."""
    view = camera.view()
    if view.perspective:
        return shade(voxels, light, eye=-view.rotation.T @ view.translation)
    return shade(voxels, light, view=view.rotation[2])


@dataclass(frozen=True, eq=False)
class Subject:
    """A volume classified once, to be rendered from any camera."""

    voxels: Visible  # around the scene's origin
    appearance: Appearance
    sphere: Sphere  # bounding sphere of everything visible
    middle: Doubles  # (3,) former place of the volume's center, scene units
    clip: Doubles  # (M, 4) planes, for the resampler
    mesh: Triangles = NO_TRIANGLES  # around the scene's origin
    tone: Tone = looks.AS_IT_IS  # of its frames
    # Voxels that are visible, found anew at each call; None: cameras orbit the whole volume.
    seen: "Callable[[], Voxels | framing.FramedVoxels] | None" = None

    @classmethod
    def of(
        cls, volume: Volume, appearance: Appearance, resampler: Resampler | None = None, *,
        around: Volume | None = None,
    ) -> "Subject":  # fmt: skip
        """Classify a volume; cameras orbit the volume `around`, or the visible part."""
        resampler = resampler or looks.resampler_for(appearance)
        looks.check_together(resampler, appearance.classification, appearance.extras)
        ((volume, appearance),), resampler = looks.decided([(volume, appearance)], resampler)
        scene, middle = framing.centered(volume)
        clip = framing.planes(scene, appearance.crop, appearance.cuts)
        scene, projection = as_array(scene), resampler.projection
        light, tone = appearance.light, looks.AS_IT_IS
        voxels: Visible
        if light is not None and light.is_blocked and projection in MEASURING:
            raise ValueError(
                "shadows and occlusion dim light, so they need the projection composite or "
                f"first-hit, not {projection}"
            )
        is_composite = projection is Projection.COMPOSITE
        if appearance.classification is looks.Classification.POST or not is_composite:
            measured, look, tone = scene, appearance, Tone(is_negative=appearance.invert)
            if projection is Projection.XRAY:  # the field is of attenuations
                xray = appearance.xray or looks.XRay(looks.MU_WATER * mm_of(scene))
                xray = looks.settled(xray, scene)
                water = looks.attenuation(scene.values, xray.added)
                measured = scene._replace(values=water, units="")
                look = replace(look, transfer=LEVELS)
                tone = Tone(xray.mu_water, xray.window, appearance.invert)
            transfer = _field_transfer(measured, look, resampler)
            voxels = gathered(measured, transfer, resampler, look.gradient, look.labels)
            if light is not None and light.is_blocked:
                (voxels,) = with_shadows([voxels], [scene], scene, resampler, clip, light)
        else:
            voxels, radius = visible_voxels(scene, appearance), resampler.reconstruction.radius
            voxels = framing.faced(framing.keep(voxels, clip, radius), clip)
            if light is not None and light.is_blocked:
                voxels = voxels._replace(reached=voxel_transmittance(voxels, light))
        pictures = _pictures(volume, scene.values, appearance, voxels)
        mesh = _placed((*appearance.meshes, *pictures), middle)
        if around is not None:
            ball = framing.bounding_sphere(around._replace(origin=around.origin - middle))
            return cls(voxels, appearance, ball, middle, clip, mesh, tone)

        def shown() -> Voxels | framing.FramedVoxels:
            """Return the visible voxels, for cameras to fit."""
            if not isinstance(voxels, Gathered):
                return voxels
            return shown_together([(scene, appearance)], clip, resampler)

        ball = framing.around_both(framing.sphere_around(shown(), scene), mesh.corner)
        return cls(voxels, appearance, ball, middle, clip, mesh, tone, shown)

    @classmethod
    def of_several(
        cls, media: Sequence[VolumeLayer], resampler: Resampler | None = None, fit: Fit = "visible"
    ) -> "Subject":
        """Classify several volumes of one scene; extinctions add up where they overlap.

        Light, crop, clip and depth cue are the first one's; each has its own transfer function
        and labels. Volumes in files share the memory limit.
        """
        if len(media) == 1:
            return cls.of(*media[0], resampler, around=media[0][0] if fit == "volume" else None)
        resampler = resampler or looks.BY_DEFAULT
        looks.check_several(media, resampler)
        media, resampler = looks.decided(media, resampler)
        moved, scene, middle, clip = placement(media)
        each = [look for _, look in moved]
        volumes = as_arrays([volume for volume, _ in moved])
        fields = []
        meshes = [mesh for look in each for mesh in look.meshes]
        for volume, look in zip(volumes, each, strict=True):
            transfer = _field_transfer(volume, look, resampler)
            fields.append(gathered(volume, transfer, resampler, look.gradient, look.labels))
            unmoved = volume._replace(origin=volume.origin + middle)
            meshes += _pictures(unmoved, volume.values, look, fields[-1])
        mesh, light = _placed(tuple(meshes), middle), each[0].light
        if light is not None and light.is_blocked:
            fields = with_shadows(fields, volumes, scene, resampler, clip, light)
        if fit == "volume":
            return cls(fields, each[0], framing.bounding_sphere(scene), middle, clip, mesh)
        layers = list(zip(volumes, each, strict=True))
        shown = partial(shown_together, layers, clip, resampler)
        ball = framing.around_both(framing.sphere_around(shown(), scene), mesh.corner)
        return cls(fields, each[0], ball, middle, clip, mesh, seen=shown)

    def placed(self, volume: Volume) -> Volume:
        """Return one of the volumes, moved around the scene's origin."""
        return volume._replace(origin=volume.origin - self.middle)

    def camera(self, viewpoint: Viewpoint, height: int, width: int) -> AnyCamera:
        """Return the camera for a picture of this size in px, with the scene around the origin."""
        camera = camera_from(viewpoint, self.sphere, height, width)
        return camera if isinstance(viewpoint, Orbit) else framing.Shifted(camera, self.middle)

    @property
    def is_of_field(self) -> bool:
        """Whether it is one field for rays, or several."""
        return isinstance(self.voxels, Gathered | list)

    def painter(self, resampler: Resampler) -> Resampler:
        """Return the renderer that this subject was prepared for; see `decided`."""
        return resampler if self.is_of_field else looks.of_voxels(resampler)

    def cuts(self, camera: AnyCamera) -> Doubles:
        """Return planes (M, 4) for the resampler: of the scene, and of a slab across the view."""
        across = self._across(camera)
        return np.concatenate([self.clip, across]) if len(across) else self.clip

    def _across(self, camera: AnyCamera) -> Doubles:
        section = self.appearance.section
        if section is None or section.normal is not None:
            return np.zeros((0, 4))
        return section.planes(camera.view().rotation[2])

    @property
    def is_empty(self) -> bool:
        """Whether nothing is visible."""
        return not self.visible and not len(self.mesh.face)

    @property
    def lattice(self) -> Doubles:
        """Lattice (3, 3) of its voxels, or of the finest of several fields."""
        if not isinstance(self.voxels, list):
            return self.voxels.lattice
        every = [field.lattice for field in self.voxels]
        return min(every, key=lambda lattice: abs(float(np.linalg.det(lattice))))

    @property
    def visible(self) -> int:
        """Number of visible voxels."""
        voxels = self.voxels
        if isinstance(voxels, Gathered | list):
            return sum(field.visible for field in fields_of(voxels))
        return len(voxels.position)

    def facts(self) -> dict[str, Any]:
        """Return what pictures depend on besides camera and renderer, as JSON values."""
        from resample.files.animations import fingerprint

        parts = [*self.voxels, self.clip, *self.mesh]
        while any(isinstance(part, tuple) for part in parts):
            nested = (part if isinstance(part, tuple) else (part,) for part in parts)
            parts = list(chain.from_iterable(nested))
        return {
            "voxels": fingerprint(*map(np.asarray, parts)),
            "light": repr(self.appearance.light),
            "depth cue": repr(self.appearance.cue),
            **({} if self.tone == looks.AS_IT_IS else {"tone": repr(self.tone)}),
            **({} if self.appearance.slab is None else {"slab": self.appearance.slab}),
        }

    def samples_for(self, camera: AnyCamera) -> Shaded:
        """Return the input of a renderer: samples, or fields, shaded for a camera."""
        cue, light = self.appearance.cue, self.appearance.light
        near, far = cue_range(camera, self.sphere)
        if isinstance(self.voxels, Voxels):
            across = framing.faced(self.voxels, self._across(camera))
            samples = lit_samples(across, light, camera)
            return samples if cue is None else cued(samples, camera, cue, near, far)
        view = camera.view()
        eye = -view.rotation.T @ view.translation
        viewer = viewer_of(eye) if view.perspective else viewer_of(view=view.rotation[2])
        dimmed = (near, far, cue.share if cue else 0.0)
        fields = fields_of(self.voxels)
        first, *others = (lit_lattice(field, light, viewer, dimmed) for field in fields)
        first = first._replace(mesh=self.mesh)
        return [first, *others] if isinstance(self.voxels, list) else first


def pictured(
    media: Sequence[VolumeLayer], viewpoint: Viewpoint, size: tuple[int, int], resampler: Resampler,
    fit: Fitted = "visible", threads: int | None = None, progress: Progress | None = None,
) -> tuple[Frame, Subject, AnyCamera]:  # fmt: skip
    """Return a picture (height, width) of volumes, their scene and the camera."""
    subject = Subject.of_several(media, resampler, "volume" if fit == "volume" else "visible")
    warn_of_nothing(subject, media, resampler.projection)
    if fit == "picture" or (fit == "most" and isinstance(viewpoint, Orbit)):
        viewpoint = filled(viewpoint, subject, size, AROUND if fit == "most" else 0.0)
    camera = subject.camera(viewpoint, *size)
    paint, seen = subject.painter(resampler), subject.samples_for(camera)
    given: dict[str, Any] = {"height": size[0], "width": size[1], "clip": subject.cuts(camera)}
    frame = paint(seen, camera, threads=threads, progress=progress, **given)
    return subject.tone.developed(frame), subject, camera


def filled(
    viewpoint: Viewpoint, subject: Subject, size: tuple[int, int], around: float = 0.0
) -> Orbit:
    """Zoom and pan until everything visible fills the picture; `around`: see `filling`."""
    if not isinstance(viewpoint, Orbit):
        raise ValueError(
            "zoom-in needs a camera that orbits the volume, such as 30,20,1; leave it out for a "
            "camera at a fixed position"
        )
    if subject.seen is None:
        return viewpoint
    place = (viewpoint, subject.sphere, subject.seen(), size)
    found = framing.filling(*place, subject.mesh.corner, around)
    is_smaller = around > 0 and found.zoom < viewpoint.zoom  # of a ball all is seen at zoom 1
    return viewpoint if is_smaller else found


def warn_of_nothing(subject: Subject, media: Sequence[VolumeLayer], projection: Projection) -> None:
    """Warn if nothing is visible, or nothing can be told apart."""
    if len(media) > 1 or is_streamed(media[0][0]):
        return
    volume, look = media[0]
    found = survey(volume)
    least, greatest = found.whole
    if not found.levels.value.size:
        warn(f"no value of {volume.name} is finite: nothing is visible")
    elif projection is not Projection.COMPOSITE:
        return
    elif subject.is_empty:
        warn(
            f"nothing of {volume.name} is visible: the transfer function, a crop or a cut hides "
            f"all of its values, {least:g} to {greatest:g}"
        )
    elif least == greatest and look.transfer == "auto" and volume.values.size > 1:
        warn(f"all values of {volume.name} are {least:g}: nothing can be told apart")


def painted_with_bar(
    resampler: Resampler, seen: Shaded, camera: AnyCamera, size: tuple[int, int],
    threads: int | None = None, clip: Doubles | None = None,
) -> Frame:  # fmt: skip
    """Paint a picture (height, width), with a progress bar on a terminal if it takes long."""
    shape: dict[str, Any] = {"height": size[0], "width": size[1]}
    with progress_bar("painting") as progress:
        return resampler(seen, camera, **shape, threads=threads, progress=progress, clip=clip)


Painter = Callable[[AnyCamera], Frame]
MOST = 1024
BESIDE = 1e-6  # fraction of the depth range added at both ends


@dataclass(frozen=True, eq=False)
class DepthClippedCamera:
    """A camera clipped to a range of depths."""

    camera: AnyCamera
    near: float
    far: float

    def view(self) -> View:
        view = self.camera.view()
        return view._replace(near=max(view.near, self.near), far=min(view.far, self.far))


def check_slabs(count: int, resampler: Resampler) -> None:
    """Reject slabs that would not composite to the picture."""
    if not 1 <= count <= MOST:
        raise ValueError(f"{count} slabs of a deep picture; give 1 to {MOST}")
    if resampler.projection in MEASURING:
        raise ValueError(
            f"deep pictures hold composited samples; the projection {resampler.projection} shows "
            "one value of a whole ray"
        )


def boxed(shown: Iterable[VolumeLayer], subject: Subject) -> Doubles:
    """Return the corners (N, 3) of a box around everything visible, in the subject's scene."""
    ends = [framing.corners(subject.placed(volume)) for volume, _ in shown]
    return np.concatenate([*ends, subject.mesh.corner])


def depths(camera: AnyCamera, points: Doubles, count: int) -> Doubles:
    """Return depths (count + 1,) of the planes between slabs, around points (N, 3)."""
    view = camera.view()
    depth = points @ view.rotation[2] + view.translation[2]
    slack = BESIDE * float(np.abs(depth).max())
    first, last = max(float(depth.min()) - slack, view.near), float(depth.max()) + slack
    return np.linspace(first, max(last, first + slack), count + 1)


def slabs(paint: Painter, camera: AnyCamera, planes: Doubles) -> Iterator[DepthSlab]:
    """Yield slabs front to back that composite to the picture up to each one's far plane."""
    first, shown = float(planes[0]), None
    for near, far in zip(planes[:-1].tolist(), planes[1:].tolist(), strict=True):
        front = paint(DepthClippedCamera(camera, first, far)).rgba
        alone = front
        if shown is None:
            shown = np.zeros(front.shape)
        else:
            alone = paint(DepthClippedCamera(camera, near, far)).rgba
        more = between(front, shown) * (alone[..., 3:] > 0)
        shown += (1 - shown[..., 3:]) * more
        yield DepthSlab(near, far, more.astype(np.float32))
