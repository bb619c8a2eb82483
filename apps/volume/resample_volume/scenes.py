"""A volume that is opened once and seen often: what does not depend on the view is kept."""

from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from resample.cameras.viewpoints import Spelled, Sphere, viewpoint_of
from resample.resampler import Resampler
from resample.types import Frame
from resample.watching import Cancel, Progress, cancellable
from resample_volume.inputs import as_volume
from resample_volume.looks.surveys import survey, without_padding
from resample_volume.rendering import Appearance, Subject, kept_look, resampler_for
from resample_volume.types import Volume
from resample_volume.voxels.framing import ball_around

KEPT = 4  # looks whose samples are kept
MERGED = 2  # voxels each way that are one in a preview
LARGE = 256**3  # voxels from which on twice as many are
FINEST = 1  # sub-pixels per side of a preview along rays

Quality = Literal["final", "preview"]


@dataclass(eq=False)
class Scene:
    """A volume for many pictures: other looks, other cameras, quick previews.

    Pictures of one look need no other preparation than the light of their camera; a view does not
    move when a look or a cut shows more or less of the volume.

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
    >>> scene = Scene(np.ones((8, 8, 8), np.uint8))
    >>> scene.render("300..900", size=(32, 24))
    Frame(32 × 24 px, 0 % covered)
    """

    given: Any
    volume: Volume = field(init=False)  # without padding

    def __post_init__(self) -> None:
        whole = as_volume(self.given)
        self.volume = without_padding(whole, survey(whole))
        self._coarse: Volume | None = None
        self._subjects: dict[tuple[Any, ...], Subject] = {}

    def render(  # noqa: PLR0913 - what a user may say about a picture
        self,
        look: Appearance | str = "auto",
        camera: Spelled = None,
        *,
        size: tuple[int, int] = (400, 400),
        resampler: Resampler | None = None,
        quality: Quality = "final",
        fit: Literal["volume", "visible"] = "volume",
        cancel: Cancel | None = None,
        progress: Progress | None = None,
    ) -> Frame:
        """Picture of the volume.

        Parameters
        ----------
        look
            What voxels look like; a name stands for a transfer function.
        camera
            As of `render`.
        size
            Width and height, px.
        resampler
            Renderer; None is the one that suits the look.
        quality
            `preview` merges 2 × 2 × 2 voxels (4 × 4 × 4 of large volumes) and keeps the opacity of
            lengths. Its statistics say `is_preview`.
        fit
            What a camera that is placed around something looks at: the whole volume, or what the
            look shows of it.
        cancel
            Stops it from another thread.
        progress
            Called with the share of the work done, 0 to 1.

        Raises
        ------
        ValueError
            A choice is not allowed.
        resample.CancelledError
            It was cancelled.
        """
        if quality not in ("final", "preview"):
            raise ValueError(f"quality {quality!r}; it can be final or preview")
        width, height = size
        appearance = look if isinstance(look, Appearance) else Appearance(look)
        paint = resampler or resampler_for(appearance)
        is_preview = quality == "preview"
        if is_preview and paint.subpixels is None:
            paint = replace(paint, subpixels=FINEST)
        with cancellable(cancel):
            subject = self._subject(appearance, paint, is_preview=is_preview)
            if fit == "volume":
                subject = replace(subject, sphere=self._sphere(subject))
            eye = subject.camera(viewpoint_of(camera), height, width)
            frame = paint(
                subject.seen_by(eye),
                eye,
                height=height,
                width=width,
                progress=progress,
                clip=subject.clip,
            )
        return frame._replace(statistics=frame.statistics._replace(is_preview=is_preview))

    def _subject(self, look: Appearance, paint: Resampler, *, is_preview: bool) -> Subject:
        """Volume as it appears, which is kept."""
        key = (look, paint.order, paint.projection, paint.iso, paint.reconstruction, is_preview)
        found = self._subjects.pop(key, None)
        if found is None:
            shown, kept = self.volume, look
            if is_preview:
                shown, kept = self._preview(), kept_look(self.volume, look)
            found = Subject.of(shown, kept, paint)
        while len(self._subjects) >= KEPT:
            del self._subjects[next(iter(self._subjects))]
        self._subjects[key] = found
        return found

    def _preview(self) -> Volume:
        """Volume with fewer voxels."""
        if self._coarse is None:
            per = MERGED if self.volume.values.size < LARGE else 2 * MERGED
            self._coarse = merged(self.volume, per)
        return self._coarse

    def _sphere(self, subject: Subject) -> Sphere:
        """Ball around the volume, in the subject's scene."""
        return ball_around(subject.placed(self.volume))


def merged(volume: Volume, per: int) -> Volume:
    """Volume of means over so many voxels each way; what is missing takes no part in them.

    Parameters
    ----------
    volume
        Of values or of colors.
    per
        Voxels along each axis that become one; the last take what is left.
    """
    shift = volume.direction * volume.spacing @ np.full(3, (per - 1) / 2)
    colors = None if volume.colors is None else _means(volume.colors, per)
    return volume._replace(
        values=_means(volume.values, per),
        colors=colors,
        spacing=per * volume.spacing,
        origin=volume.origin + shift,
    )


def _means(values: NDArray[Any], per: int) -> NDArray[Any]:
    """Means of so many along the first three axes, of the same type."""
    total: NDArray[Any] = np.asarray(values, np.float32)
    known: NDArray[Any] = np.isfinite(total).astype(np.float32)
    total = np.where(known > 0, total, 0)
    for axis in range(3):
        starts = np.arange(0, values.shape[axis], per)
        total, known = (np.add.reduceat(part, starts, axis) for part in (total, known))
    with np.errstate(invalid="ignore"):
        mean = total / known
    return np.asarray(np.rint(mean).astype(values.dtype) if values.dtype.kind in "iu" else mean)
