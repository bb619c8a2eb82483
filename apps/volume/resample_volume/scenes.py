"""Open a volume once, render it many times: what does not depend on the view is cached."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import AnyCamera
from resample.cameras.viewpoints import Spelled, viewpoint_of
from resample.outofcore.passes import Memo, memoizing
from resample.painting.choices import Projection
from resample.painting.scenes.plans import shape_of
from resample.progress import Cancel, Progress
from resample.resampler import Resampler
from resample.scene import PER, AnyScene, Quality, Shrunk, enlarged_frame, is_quick
from resample.types import Frame
from resample_volume import appearance as looks
from resample_volume.appearance import Appearance, Tone, VolumeLayer, XRay
from resample_volume.classification.transfer import Windowed
from resample_volume.classification.value_statistics import survey, without_padding
from resample_volume.data.values import as_array, values_of
from resample_volume.image_planes import settled as settled_plane
from resample_volume.inputs import as_volume
from resample_volume.picking import Picked, picked, voxels_at
from resample_volume.rendering import Fit, Subject, warn_of_nothing
from resample_volume.types import Volume
from resample_volume.voxels.framing import centered, planes
from resample_volume.voxels.visible import finite_range, unit_of

KEPT = 4  # looks whose samples are cached
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
            As of `render`.
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
        self,
        look: Shown = "auto",
        camera: Spelled = None,
        *,
        size: tuple[int, int] = (400, 400),
        resampler: Resampler | None = None,
        quality: Quality = "final",
        fit: Fit = "volume",
    ) -> tuple[AnyCamera, Volume]:
        """Return the camera of a picture, and the volume as placed before it.

        Parameters
        ----------
        look, camera, size, resampler, quality, fit
            As of `render`.
        """
        is_preview = is_quick(quality)
        subject, eye, _ = self._prepared(look, camera, size, resampler, fit, is_preview=is_preview)
        return eye, subject.placed(self.volume)

    def tone(self, look: Shown, resampler: Resampler, fit: Fit = "volume") -> Tone:
        """Return how measured values become gray; parameters as of `render`."""
        return self._prepared(look, None, (1, 1), resampler, fit)[0].tone

    def sample_ids(
        self,
        look: Shown = "auto",
        camera: Spelled = None,
        *,
        size: tuple[int, int] = (400, 400),
        resampler: Resampler | None = None,
        fit: Fit = "volume",
    ) -> NDArray[np.int32]:
        """Return the voxels at which the opacity of pixels passes one half.

        Parameters
        ----------
        look, camera, size, resampler, fit
            As of `render`.

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
            As of `render`. Where the total opacity is below one half, it is the voxel with which
            half of it is reached.

        Raises
        ------
        ValueError
            As of `sample_ids`.
        """
        subject, eye, paint = self._prepared(look, camera, size, resampler, fit)
        layers, each = self._layers(look), [subject]
        if isinstance(subject.voxels, list):  # the nearest of what each of them shows
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
        if labels is not None:  # each that of the block's first voxel
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
