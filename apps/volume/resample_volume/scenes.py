"""Open a volume once, render it many times: what does not depend on the view is cached."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import AnyCamera
from resample.cameras.viewpoints import Spelled, viewpoint_of
from resample.messages import shape_of
from resample.outofcore.passes import Memo, memoizing
from resample.painting.choices import Projection
from resample.profiles.reconstruction import footprint_table
from resample.progress import Cancel, Progress
from resample.resampler import Resampler
from resample.scene import PER, AnyScene, Quality, Shrunk, enlarged_frame, is_quick, lines_of
from resample.types import Doubles, Frame, Indices, View
from resample_volume import appearance as looks
from resample_volume.appearance import Appearance, Tone, VolumeLayer, XRay
from resample_volume.classification.scales import value_at
from resample_volume.classification.transfer import Windowed
from resample_volume.classification.value_statistics import survey, without_padding
from resample_volume.data.values import as_array, values_of
from resample_volume.inputs import as_volume
from resample_volume.meshes import settled as settled_plane
from resample_volume.rendering import Fit, Subject, warn_of_nothing
from resample_volume.types import Picked, Volume
from resample_volume.voxels.framing import centered, planes
from resample_volume.voxels.gathered import Gathered
from resample_volume.voxels.thin import SAME, of_samples, voxels_of
from resample_volume.voxels.visible import Voxels, finite_range, lattice_of, unit_of

KEPT = 4  # looks with cached samples
MERGED = 2  # voxels per side that a preview merges
LARGE = 256**3  # voxels from which twice as many per side are merged
FINEST = 1  # sub-pixels per side of a ray cast preview
Shown = Appearance | str | Sequence[VolumeLayer]


@dataclass(eq=False)
class Scene(AnyScene):
    """A volume for many pictures: changing looks, changing cameras, quick previews.

    Pictures of one look only need to be shaded for their camera; the view stays when a look or a
    cut shows more or less of the volume.

    Parameters
    ----------
    given
        What `as_volume` takes.

    Raises
    ------
    TypeError, ValueError, OSError
        See `as_volume`.

    Examples
    --------
    >>> import numpy as np
    >>> scene = Scene(np.full((8, 8, 8), 200, np.uint8))
    >>> scene.render("100..300", size=(32, 24))
    Frame(32 × 24 px, 36.7 % covered, depth from 22.65)
    """

    given: Any
    volume: Volume = field(init=False)  # without padding

    def __post_init__(self) -> None:
        whole = as_array(as_volume(self.given))
        self.volume = without_padding(whole, survey(whole))
        self._coarse: dict[int, tuple[Volume, Volume]] = {}  # by id: volume, and its merged one
        self._subjects: dict[tuple[Any, ...], Subject] = {}
        self._quick: dict[Resampler, Resampler] = {}  # renderers of previews
        self._found: Memo = {}

    def render(
        self,
        look: Shown = "auto",
        camera: Spelled = None,
        *,
        size: tuple[int, int] = (400, 400),
        resampler: Resampler | None = None,
        quality: Quality = "final",
        fit: Fit = "volume",
        cancel: Cancel | None = None,
        progress: Progress | None = None,
    ) -> Frame:
        """Render the volume.

        Parameters
        ----------
        look
            Look of the voxels, or the name of a transfer function; or layers (volume, look) that
            are shown together, this volume first.
        camera, size, resampler, progress
            As in `render`.
        quality
            `preview` merges 2 × 2 × 2 voxels (4 × 4 × 4 of large volumes) and 2 × 2 pixels, and
            keeps opacity per length. Its statistics have `is_preview` set.
        fit
            What an orbiting camera looks at: the whole volume, or its visible part.
        cancel
            Cancels the picture from another thread.

        Raises
        ------
        ValueError
            A choice is not allowed.
        resample.CancelledError
            It was cancelled.
        """
        height, width = shape_of(size)
        with self._rendering(quality, cancel) as is_preview, memoizing(self._found):
            words = (look, camera, size, resampler, fit)
            subject, eye, paint = self._prepared(*words, is_preview=is_preview)
            per = PER if is_preview else 1
            seen, cuts = subject.samples_for(eye), subject.cuts(eye)
            shape: dict[str, Any] = {"height": -(-height // per), "width": -(-width // per)}
            view = Shrunk(eye, per) if is_preview else eye
            frame = paint(seen, view, **shape, progress=progress, clip=cuts)
            frame = subject.tone.developed(frame)
        if is_preview:
            frame = enlarged_frame(frame, per, (height, width))
        return frame._replace(statistics=frame.statistics._replace(is_preview=is_preview))

    def placed_view(
        self, look: Shown = "auto", camera: Spelled = None, *, size: tuple[int, int] = (400, 400),
        resampler: Resampler | None = None, quality: Quality = "final", fit: Fit = "volume",
    ) -> tuple[AnyCamera, Volume]:  # fmt: skip
        """Return the camera of a picture, and the volume as placed before it.

        Parameters
        ----------
        look, camera, size, resampler, quality, fit
            As in `render`.
        """
        is_preview = is_quick(quality)
        subject, eye, _ = self._prepared(look, camera, size, resampler, fit, is_preview=is_preview)
        return eye, subject.placed(self.volume)

    def tone(self, look: Shown, resampler: Resampler, fit: Fit = "volume") -> Tone:
        """Return the gray levels' window of measured values; parameters as in `render`."""
        return self._prepared(look, None, (1, 1), resampler, fit)[0].tone

    def sample_ids(
        self, look: Shown = "auto", camera: Spelled = None, *, size: tuple[int, int] = (400, 400),
        resampler: Resampler | None = None, fit: Fit = "volume",
    ) -> NDArray[np.int32]:  # fmt: skip
        """Return the voxels at which the opacity of pixels passes one half.

        Parameters
        ----------
        look, camera, size, resampler, fit
            As in `render`.

        Returns
        -------
        (H, W, 3) indices into the values, z, y and x. Behind each pixel's center, voxels are
        composited front to back; it is the voxel with which the accumulated opacity exceeds one
        half. For a ray cast field it is the voxel around the point where that happens, or where the
        surface, the maximum or the minimum is. -1: there is none.

        Raises
        ------
        ValueError
            The projection shows no single voxel, or a choice is not allowed.
        """
        height, width = shape_of(size)
        row, column = np.indices((height, width)) + 0.5
        pixels = np.column_stack([column.ravel(), row.ravel()])
        subject, eye, paint = self._prepared(look, camera, size, resampler, fit)
        found, _ = voxels_at(subject, self.volume, eye, paint, pixels)
        index = np.stack(np.unravel_index(np.maximum(found, 0), self.volume.values.shape), axis=-1)
        index[found < 0] = -1
        return index.reshape(height, width, 3).astype(np.int32)

    def pick(
        self,
        x: float,
        y: float,
        look: Shown = "auto",
        camera: Spelled = None,
        *,
        size: tuple[int, int] = (400, 400),
        resampler: Resampler | None = None,
        fit: Fit = "volume",
    ) -> Picked | None:
        """Return the voxel visible at a point of the picture; None if there is none.

        Parameters
        ----------
        x, y
            Right and down, px; centers of pixels are at halves.
        look, camera, size, resampler, fit
            As in `render`. Where the total opacity is below one half, it is the voxel with which
            half of it is reached.

        Raises
        ------
        ValueError
            As in `sample_ids`.
        """
        subject, eye, paint = self._prepared(look, camera, size, resampler, fit)
        layers, each = self._layers(look), [subject]
        if isinstance(subject.voxels, list):  # the nearest of their visible voxels
            each = [replace(subject, voxels=field) for field in subject.voxels]
        nearest, least = None, np.inf
        for (volume, _), one in zip(layers, each, strict=True):
            given = one, volume, eye, paint, np.array([[x, y]])
            (found,), (kept,) = voxels_at(*given)
            if found < 0 and kept < 1:
                (found,), _ = voxels_at(*given, level=(1 - kept) / 2)
            if found >= 0:
                seen, view = picked(volume, int(found)), eye.view()
                depth = view.rotation[2] @ (seen.position - subject.middle) + view.translation[2]
                if depth < least:
                    nearest, least = seen, depth
        return nearest

    def _layers(self, look: Shown) -> list[VolumeLayer]:
        """Return the volumes that are shown, each with its look."""
        if isinstance(look, str):
            look = Appearance(look)
        return [(self.volume, look)] if isinstance(look, Appearance) else list(look)

    def _prepared(
        self, look: Shown, camera: Spelled, size: tuple[int, int], resampler: Resampler | None,
        fit: Fit, *, is_preview: bool = False,
    ) -> tuple[Subject, AnyCamera, Resampler]:  # fmt: skip
        """Return subject, camera and renderer of a picture."""
        if fit not in get_args(Fit):
            raise ValueError(f"fit {fit!r}; known: {', '.join(get_args(Fit))}")
        layers = self._layers(look)
        paint = resampler or looks.resampler_for(layers[0][1])
        if is_preview and paint.subpixels is None:
            paint = self._quick.setdefault(paint, replace(paint, subpixels=FINEST))
        parts = (paint.order, paint.projection, paint.iso, paint.reconstruction)
        key = (*(look for _, look in layers), *parts, fit, is_preview)
        subject = self._subjects.pop(key, None)
        if subject is None:
            with memoizing(self._found):
                shown = [self._previewed(*one, paint) for one in layers] if is_preview else layers
                if len(shown) > 1:
                    subject = Subject.of_several(shown, paint, fit)
                else:
                    around = self.volume if fit == "volume" else None
                    subject = Subject.of(*shown[0], paint, around=around)
        while len(self._subjects) >= KEPT:
            del self._subjects[next(iter(self._subjects))]
        self._subjects[key] = subject
        eye = subject.camera(viewpoint_of(camera), *shape_of(size))
        warn_of_nothing(subject, layers, paint.projection)
        return subject, eye, subject.painter(paint)

    def _previewed(self, volume: Volume, look: Appearance, paint: Resampler) -> VolumeLayer:
        """Return a volume with fewer voxels, and the look adapted to it."""
        per = MERGED if volume.values.size < LARGE else 2 * MERGED
        if id(volume) not in self._coarse:
            self._coarse[id(volume)] = volume, merged(volume, per)
        coarse = self._coarse[id(volume)][1]
        if paint.projection is Projection.XRAY:
            look = replace(look, xray=looks.settled(look.xray or XRay(), volume))
        transfer, labels = looks.transfer_of(volume, look), look.labels
        unit = unit_of(transfer, volume)
        transfer = Windowed(transfer, finite_range(volume.values), unit)
        if labels is not None:  # each from the block's first voxel
            whole = values_of(labels.values).whole()
            labels = replace(labels, values=whole[::per, ::per, ::per])
        # Merged voxels are cut where crop and clip cut the volume.
        middle = centered(coarse)[1]
        cuts = tuple(
            ",".join(map(repr, [*normal, -far - float(np.dot(normal, middle))]))
            for *normal, far in planes(volume, look.crop, look.cuts).tolist()
        )
        slab = None if look.section is None or look.section.normal else look.slab
        pictures = tuple(settled_plane(plane, volume) for plane in look.planes)
        look = replace(look, transfer=transfer, labels=labels, planes=pictures)
        return coarse, replace(look, crop=None, clip=cuts, slab=slab)


def merged(volume: Volume, per: int) -> Volume:
    """Downsample a volume by means over blocks of voxels, without missing values."""
    shift = volume.direction * volume.spacing @ np.full(3, (per - 1) / 2)
    values, colors = _means(volume.values, per), volume.colors
    colors = None if colors is None else _means(colors, per)
    place = {"spacing": per * volume.spacing, "origin": volume.origin + shift}
    return volume._replace(values=values, colors=colors, **place)


def _means(values: NDArray[Any], per: int) -> NDArray[Any]:
    """Return the means of blocks along the first three axes, in the same type."""
    total: NDArray[Any] = np.asarray(values, np.float32)
    known: NDArray[Any] = np.isfinite(total).astype(np.float32)
    total = np.where(known > 0, total, 0)
    for axis in range(3):
        starts = np.arange(0, values.shape[axis], per)
        total, known = (np.add.reduceat(part, starts, axis) for part in (total, known))
    with np.errstate(invalid="ignore"):
        mean = total / known
    return np.asarray(np.rint(mean).astype(values.dtype) if values.dtype.kind in "iu" else mean)


HALF = 0.5  # accumulated opacity at which a voxel counts as the visible one

PICKED = (Projection.COMPOSITE, Projection.MAXIMUM, Projection.MINIMUM, Projection.FIRST_HIT)


def voxels_at(
    subject: Subject, volume: Volume, camera: AnyCamera, resampler: Resampler, pixels: Doubles,
    level: float = HALF,
) -> tuple[Indices, Doubles]:  # fmt: skip
    """Return flat indices (N,) of the voxels behind points, and their transmittance (N,).

    `pixels`: (N, 2) right and down, px; centers are at halves. It is the voxel at which the
    accumulated opacity exceeds the level; in a field, the one around the point where the ray
    reaches the level, the surface, a more opaque plane, or its extreme; -1 if there is none.
    """
    from resample.engine.rays.coefficients import bundled
    from resample_volume.kernels.voxels import (
        PickedField,
        SplattedVoxels,
        pick_in_field,
        pick_voxels,
    )

    voxels, projection, view = subject.voxels, resampler.projection, camera.view()
    if projection not in PICKED or not isinstance(voxels, Voxels | Gathered):
        raise ValueError(
            f"the projection {projection} of {volume.name} shows no single voxel; take composite, "
            "maximum, minimum or first-hit, the last three along rays"
        )
    scene = subject.placed(volume)
    reach = resampler.reconstruction.radius if isinstance(voxels, Voxels) else 0.5
    thin = voxels.thin if isinstance(voxels, Gathered) else SAME
    samples = of_samples(scene, thin)
    rays = _rays(view, samples, pixels, subject.cuts(camera), reach)
    voxel, kept = np.full(len(pixels), -1, np.int64), np.ones(len(pixels))
    if isinstance(voxels, Voxels):
        lattice, (width, height, deep) = lattice_of(scene), scene.values.shape[::-1]
        place = (voxels.position - scene.origin) @ np.linalg.inv(lattice).T
        x, y, z = np.rint(place).astype(np.int64).T
        thickness = np.zeros(scene.values.size, np.float32)
        thickness[(z * height + y) * width + x] = voxels.extinction
        toward, kernel = view.rotation[2], resampler.reconstruction
        x_deeper, y_deeper, z_deeper = (toward @ lattice).tolist()
        splatted = SplattedVoxels(
            thickness,
            (width, height, deep),
            float(toward @ scene.origin + view.translation[2]),
            (x_deeper, y_deeper, z_deeper),
            footprint_table(kernel).values,
            float(kernel.radius),
        )
        pick_voxels(splatted, rays, level, voxel, kept)
    else:
        depth, shown = _on_planes(subject, volume, view, pixels, level)
        rays = rays._replace(last=np.maximum(rays.first, np.minimum(rays.last, depth)))
        coefficient: Any = bundled(voxels.spline.coefficient)
        field = PickedField(
            voxels.spline._replace(coefficient=coefficient),
            voxels.known,
            voxels.each,
            *voxels.table,
            np.ascontiguousarray(np.linalg.inv(voxels.lattice).T),
            PICKED.index(projection),
            float(resampler.iso or 0.0),
        )
        pick_in_field(field, rays, level, voxel, kept)
        voxel = voxels_of(voxel, scene.values.shape, thin)
        is_plane = (voxel < 0) & np.isfinite(depth)
        voxel[is_plane], kept[is_plane] = shown[is_plane], 0.0
    return voxel, kept


def _on_planes(
    subject: Subject, volume: Volume, view: View, pixels: Doubles, level: float
) -> tuple[Doubles, Indices]:
    """Return depths (N,) at which rays meet planes of values, or inf, and the voxels there."""
    depth, voxel = np.full(len(pixels), np.inf), np.full(len(pixels), -1, np.int64)
    eye, way = lines_of(view, pixels)
    eye, to_lattice = eye + subject.middle, np.linalg.inv(lattice_of(volume)).T
    shape = volume.values.shape
    for plane in subject.appearance.planes:
        if plane.opacity <= level:
            continue
        *numbers, distance = settled_plane(plane, volume).numbers
        normal = np.array(numbers)
        with np.errstate(divide="ignore", invalid="ignore"):
            at = (distance - eye @ normal) / (way @ normal)
            place = (eye + at[:, np.newaxis] * way - volume.origin) @ to_lattice
            is_nearer = (at >= view.near) & (at < np.minimum(depth, view.far))
        near = np.flatnonzero(is_nearer & np.isfinite(place).all(axis=1))
        x, y, z = np.floor(place[near] + 0.5).astype(np.int64).T
        inside = (x >= 0) & (y >= 0) & (z >= 0) & (x < shape[2]) & (y < shape[1]) & (z < shape[0])
        near, found = near[inside], (z[inside] * shape[1] + y[inside]) * shape[2] + x[inside]
        is_known = np.isfinite(volume.values.reshape(-1)[found])
        depth[near[is_known]], voxel[near[is_known]] = at[near[is_known]], found[is_known]
    return depth, voxel


def picked(volume: Volume, voxel: int) -> Picked:
    """Return position and value of a voxel, by its flat index."""
    place = np.unravel_index(voxel, volume.values.shape)
    index = np.array(place[::-1], np.float64)
    value = float(value_at(volume.values[place], volume.scale))
    z, y, x = map(int, place)
    return Picked((z, y, x), value, np.asarray(volume.origin + lattice_of(volume) @ index))


def _rays(view: View, scene: Volume, pixels: Doubles, clip: Doubles, reach: float) -> Any:
    """Return the rays of pixels, clipped to a volume's box and to planes."""
    from resample_volume.kernels.voxels import PickingRays

    eye, direction = lines_of(view, pixels)
    to_lattice = np.linalg.inv(lattice_of(scene)).T
    origin, speed = (eye - scene.origin) @ to_lattice, direction @ to_lattice
    first = np.full(len(pixels), view.near if view.perspective else -np.inf)
    last = np.full(len(pixels), view.far)
    size = np.array(scene.values.shape[::-1])
    # Clip to depths where linear functions are positive, as they are inside
    inside = [*(origin + reach).T, *(size - 1 + reach - origin).T]
    inside += [eye @ plane[:3] + plane[3] for plane in clip]
    growth = [*speed.T, *-speed.T, *(direction @ plane[:3] for plane in clip)]
    for at, per in zip(inside, growth, strict=True):
        with np.errstate(divide="ignore", invalid="ignore"):
            where = -at / per
        np.maximum(first, where, out=first, where=per > 0)
        np.minimum(last, where, out=last, where=per < 0)
        last[(per == 0) & (at < 0)] = -np.inf
    length = np.linalg.norm(direction, axis=1)
    arrays = (origin, np.ascontiguousarray(speed), length, first, np.maximum(last, first))
    return PickingRays(*(np.ascontiguousarray(array, np.float64) for array in arrays))
