"""Compare renderers on one view of one volume, also with VTK while the view changes."""

import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np

from resample import registry
from resample.cameras.models import AnyCamera
from resample.colors import from_srgb
from resample.measuring.compare import shown
from resample.measuring.quality import measure
from resample.painting.choices import Footprint, Primitive, Projection
from resample.profiles.orders import Rays, Summing
from resample.resampler import Resampler
from resample.types import Floats, LatticeField
from resample_comparisons.volume.peers import Peer, VtkRenderer
from resample_comparisons.volume.raycasting import Casting, cast_rays
from resample_volume.appearance import Appearance, transfer_of
from resample_volume.classification.transfer import Transfer
from resample_volume.rendering import Subject, painted_with_bar
from resample_volume.types import Volume

FINE_STEP = 0.25  # voxels, of a reference by ray casting
AMPLIFIED = 4  # factor by which differences are magnified

Row = dict[str, object]


def variants(
    resampler: Resampler,
    methods: Sequence[str],
    footprints: Sequence[str] = (),
    orders: Sequence[str] = (),
) -> dict[str, Resampler]:
    """Return renderers by name, one per combination; names show only what differs."""
    if not methods:
        raise ValueError(f"give a method to compare; known: {', '.join(Primitive)}")
    choice: dict[str, Resampler] = {}
    for method, footprint, order in product(methods, footprints or [""], orders or [""]):
        built = registry.build("orders", order) if order else resampler.order
        if built.summing is Summing.RAYS:  # orders that paint no samples
            choice.setdefault(order or "rays", replace(resampler, order=built))
            continue
        name = " ".join(filter(None, [method, footprint, order]))
        choice[name] = replace(
            resampler,
            primitive=_member("method", Primitive, method),
            footprint=_member("footprint", Footprint, footprint)
            if footprint
            else resampler.footprint,
            order=built,
        )
    return choice


def gathered_for(
    choice: Mapping[str, Resampler], volume: Volume, appearance: Appearance
) -> Subject | None:
    """Prepare the volume for ray casting renderers, if there are any."""
    rays = [one for one in choice.values() if one.order.summing is Summing.RAYS]
    return Subject.of(volume, appearance, rays[0]) if rays else None


def check_vtk(appearance: Appearance, resampler: Resampler) -> None:
    """Reject a look that VTK does not get, as its picture would show something else."""
    cut = {"crop": appearance.crop, "clip": appearance.clip, "slab": appearance.slab}
    chosen = [*appearance.extras, *(name for name, choice in cut.items() if choice)]
    if resampler.projection is not Projection.COMPOSITE:
        chosen.append(f"the projection {resampler.projection}")
    if chosen:
        raise ValueError(f"VTK does not get {', '.join(chosen)}; leave out either VTK or these")


def _member(role: str, family: Any, name: str) -> Any:
    if name not in list(family):
        raise ValueError(f"{role} {name!r}; known: {', '.join(family)}")
    return family(name)


@dataclass
class Contest:
    """A view for all renderers, and the reference picture."""

    subject: Subject
    gathered: Subject | None  # for ray casting renderers, if there are any
    camera: AnyCamera
    size: tuple[int, int]  # height and width, px
    rows: list[Row] = field(default_factory=list)
    pictures: dict[str, Floats] = field(default_factory=dict)  # the reference first

    @property
    def reference(self) -> Floats:
        """Return the picture (H, W, 4) that all are compared with."""
        return next(iter(self.pictures.values()))

    def splatted(self, resampler: Resampler, rays: int) -> None:
        """Set the reference to exact splats at `rays` × `rays` per pixel, or rays."""
        if resampler.order.summing is Summing.RAYS:
            order = resampler.order
            close = replace(order, step=FINE_STEP) if isinstance(order, Rays) else order
            fine = replace(resampler, order=close, subpixels=rays, pixel_filter=None)
            self.pictures[f"reference, {rays} x {rays} rays"] = self._painted(fine)[0]
            return
        fine = replace(
            resampler,
            primitive=Primitive.SPLATS,
            footprint=Footprint.EXACT,
            subpixels=rays,
            pixel_filter=None,
        )
        self.pictures[f"reference, {rays} x {rays} splats"] = self._painted(fine)[0]

    def cast(self, resampler: Resampler, rays: int) -> None:
        """Set the reference to the field integrated along `rays` × `rays` rays per pixel."""
        seen = self.subject.samples_for(self.camera)
        if isinstance(seen, LatticeField | list):
            self.splatted(resampler, rays)
            return
        cuts = self.subject.cuts(self.camera)
        casting = Casting(rays=rays, reconstruction=resampler.reconstruction, clip=cuts)
        cast = cast_rays(seen, self.camera, height=self.size[0], width=self.size[1], look=casting)
        self.pictures[f"reference, {rays} x {rays} rays"] = cast.rgba

    def draw(self, name: str, resampler: Resampler) -> None:
        """Measure a renderer; milliseconds are those of a second run."""
        self._painted(resampler)
        start = time.perf_counter()
        picture, share = self._painted(resampler)
        self._book(name, picture, 1000 * (time.perf_counter() - start), f"{100 * share:.1f} %")

    def draw_vtk(self, volume: Volume, rays: int) -> None:
        """Measure VTK's ray caster at `rays` × `rays` rays per pixel."""
        from resample_comparisons.volume.peers import Peer, VtkRenderer

        look = Peer(rays=rays, light=self.subject.appearance.light)
        height, width = self.size
        transfer = transfer_of(volume, self.subject.appearance)
        renderer = VtkRenderer(volume, transfer, height=height, width=width, look=look)
        renderer.render(self.camera)
        start = time.perf_counter()
        picture = renderer.render(self.camera)
        self._book(f"VTK, {rays} x {rays} rays", picture, 1000 * (time.perf_counter() - start), "")

    def differences(self) -> dict[str, Floats]:
        """Return pictures of the errors, magnified; mid-gray is no error."""
        target = shown(self.reference)
        return {
            f"{name}, error x {AMPLIFIED}": from_srgb(
                np.clip(0.5 + AMPLIFIED * (shown(picture) - target), 0.0, 1.0).astype(np.float32)
            )
            for name, picture in list(self.pictures.items())[1:]
        }

    def _book(self, name: str, picture: Floats, duration: float, share: str) -> None:
        self.pictures[name] = picture
        quality = measure(shown(picture), shown(self.reference))
        self.rows.append({"picture": name, **quality, "splats": share, "ms": duration})

    def _painted(self, resampler: Resampler) -> tuple[Floats, float]:
        """Return the picture, and its share of splats."""
        subject = self.subject
        if resampler.order.summing is Summing.RAYS and self.gathered is not None:
            subject = self.gathered
        seen = subject.samples_for(self.camera)
        cuts = self.subject.cuts(self.camera)
        frame = painted_with_bar(resampler, seen, self.camera, self.size, clip=cuts)
        frame = subject.tone.developed(frame)
        return frame.rgba, frame.statistics.splat_fraction


@dataclass
class VtkBeside:
    """VTK's ray caster for one volume; keeps the state of the last look.

    One thread draws everything, as a window belongs to the thread that created it.
    """

    _thread: ThreadPoolExecutor = field(
        init=False, default_factory=lambda: ThreadPoolExecutor(1, "vtk")
    )
    _kept: tuple[Any, VtkRenderer] | None = field(init=False, default=None)

    def picture(
        self,
        volume: Volume,
        appearance: Appearance,
        resampler: Resampler,
        camera: AnyCamera,
        size: tuple[int, int],
    ) -> Floats:
        """Render a picture (H, W, 4), premultiplied linear RGBA, one ray per pixel.

        `volume`: as placed before the camera; the same in all calls. `appearance`, `resampler`: as
        for our own picture. `camera`: the camera. `size`: width and height, px. Raises ValueError:
        VTK is not installed, or cannot show this.
        """
        check_vtk(appearance, resampler)
        transfer = transfer_of(volume, appearance)
        drawn = self._thread.submit(self._drawn, volume, transfer, appearance, camera, size)
        return drawn.result()

    def _drawn(
        self,
        volume: Volume,
        transfer: Transfer,
        appearance: Appearance,
        camera: AnyCamera,
        size: tuple[int, int],
    ) -> Floats:
        key = (appearance, size)
        if self._kept is None or self._kept[0] != key:
            width, height = size
            look = Peer(light=appearance.light)
            self._kept = None  # frees the window before another is created
            self._kept = key, VtkRenderer(volume, transfer, height=height, width=width, look=look)
        return self._kept[1].render(camera)
