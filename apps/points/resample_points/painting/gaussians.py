"""Render 3D Gaussians, each evaluated exactly on every ray.

gaussians = read_gaussians("scene.ply")
frame = render_gaussians(gaussians, gaussian_camera(gaussians, size=(800, 600)), size=(800, 600))
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, cast

import numpy as np

from resample.cameras.models import AnyCamera, Camera, Orthographic
from resample.cameras.pixels import Equirectangular
from resample.colors import from_srgb, to_srgb
from resample.messages import check_kind, check_numbers, check_threads, shape_of
from resample.painting.ellipsoids import (
    FINEST,
    Ellipsoids,
    ShapedOrder,
    ShapedPicture,
    ShapedStyle,
    paint_ellipsoid_parts,
)
from resample.types import Doubles, Floats, Frame, View
from resample_points.data.cloud import Cloud
from resample_points.data.gaussians import (
    Crop,
    Gaussians,
    Training,
    are_drawable,
    kept_by,
    some_gaussians,
    training_of,
    with_unit_rotations,
)
from resample_points.geometry.framing import FIELD, framed
from resample_points.painting.bending import CloudView, ProjectedCamera

if TYPE_CHECKING:
    from resample_points.files.gaussians.ply import TrainedFile

DILATION = 0.3  # px², by which training widens Gaussians on the screen (Kerbl et al. 2023)
NEAR = 0.02  # share of a scene's radius before which nothing is shown, as training has it
PART = 1 << 16  # Gaussians with colors computed together
OPAQUE_ENOUGH = 0.3  # opacity of Gaussians that cameras are framed around, at least
WIDE = 2.0  # standard deviations that Gaussians are seen to reach
FRAMED = 20_000  # Gaussians that cameras are framed around, about
TRIMMED = 0.02  # share of these along each axis that may lie beside the frame, at each end


class GaussianAppearance(StrEnum):
    """Appearance of Gaussians."""

    TRAINED = "trained"  # as wide as training has seen them, exact on every ray
    BARE = "bare"  # as they are in the file
    AFFINE = "affine"  # as usual renderers draw them: projected linearly, widened on the screen


@dataclass(frozen=True)
class GaussianStyle:
    """Options of drawing Gaussians.

    Parameters
    ----------
    appearance
        `trained`, `bare` or `affine`.
    order
        `depth` along the view axis, which pops when the camera turns; `distance` from the eye,
        which pops when it moves, and which panoramas and lenses take; or `rays`, along each
        ray, where pops become lines that sweep.
    trained_focal
        Focal length of the pictures of training, px, for pictures from as far away. None: of the
        scene's `training`, so that pictures from afar are close to the mean of near ones.
    subpixels
        Sub-pixels per side of a pixel, up to 8. None: as thin Gaussians need.
    near
        Depth before which nothing is shown, scene units. None: 0.02 of the radius of half the
        scene, 0 if `bare`.

    Raises
    ------
    ValueError
        An option is unknown or out of range.

    Examples
    --------
    >>> import resample_points as points
    >>> parts = (np.full((1, n), 0.1, np.float32) for n in (3, 3, 4))
    >>> one = points.Gaussians(*parts, np.ones(1, np.float32), np.ones((1, 3), np.float32))
    >>> eye = points.gaussian_camera(one, size=(32, 24))
    >>> for appearance in ("bare", "trained"):
    ...     style = points.GaussianStyle(appearance, near=0.0)
    ...     frame = points.render_gaussians(one, eye, size=(32, 24), style=style)
    ...     print(bool(frame.rgba[12, 16, 3] > 0.9))
    True
    True
    """

    appearance: GaussianAppearance | Literal["trained", "bare", "affine"] = (
        GaussianAppearance.TRAINED
    )
    order: ShapedOrder | Literal["depth", "distance", "rays"] | None = None
    trained_focal: float | None = None
    subpixels: int | None = None
    near: float | None = None

    def __post_init__(self) -> None:
        check_numbers(self, "trained_focal", "subpixels", "near")
        if self.appearance not in list(GaussianAppearance):
            raise ValueError(
                f"appearance {self.appearance!r}; known: {', '.join(GaussianAppearance)}"
            )
        if self.order is not None and self.order not in list(ShapedOrder):
            raise ValueError(f"order {self.order!r}; known: {', '.join(ShapedOrder)}")
        if self.trained_focal is not None and not 0 < self.trained_focal < np.inf:
            raise ValueError(f"a focal length of {self.trained_focal:g} px; give one above 0")
        if self.subpixels is not None and not 1 <= self.subpixels <= FINEST:
            raise ValueError(f"{self.subpixels} sub-pixels; give 1 to {FINEST}")
        if self.near is not None and not 0 <= self.near < np.inf:
            raise ValueError(f"the near plane at {self.near:g} must not lie behind the eye")

    def shaped(
        self, camera: CloudView, training: Training | None, *, is_antialiased: bool, is_wide: bool
    ) -> ShapedStyle:
        """Return the style for painting ellipsoids, for a camera's picture."""
        is_bare = self.appearance == GaussianAppearance.BARE
        usual = ShapedOrder.DISTANCE if is_wide else ShapedOrder.DEPTH
        near, trained, least = self.near, self.trained_focal, 0.0
        if near is None:
            near = 0.0 if is_bare or training is None else NEAR * training.radius
        if trained is None and training is not None:
            seen = training.focal_for(camera)
            # Pictures finer than an estimate are drawn as usual renderers do.
            trained, least = (None, seen) if training.is_estimated else (seen, 0.0)
        return ShapedStyle(
            ShapedOrder(self.order) if self.order is not None else usual,
            self.subpixels,
            near=near,
            dilation=0.0 if is_bare else DILATION,
            trained=trained,
            least_trained=least,
            is_compensated=is_antialiased and not is_bare,
            is_affine=self.appearance == GaussianAppearance.AFFINE,
        )


class GaussianParts(NamedTuple):
    """Gaussians in parts, in colors for a view, as an `EllipsoidSource`."""

    gaussians: Gaussians

    def kernel(self) -> None:
        """None: opacities fall as Gaussians do."""

    def sizes(self) -> Sequence[int]:
        """Gaussians of each part."""
        count = len(self.gaussians.opacity)
        return [min(PART, count - first) for first in range(0, count, PART)]

    def load(self, part: int, view: View, /) -> Ellipsoids:
        """Some Gaussians with their colors toward the eye."""
        return self.load_rows(slice(part * PART, (part + 1) * PART), view)

    def load_rows(self, rows: slice, view: View) -> Ellipsoids:
        """Some rows, with colors."""
        position, scale, rotation, opacity = (array[rows] for array in self.gaussians[:4])
        color = colors_of(self.gaussians, rows, view)
        return Ellipsoids(position, scale, rotation, opacity, color)


class StoredGaussians:
    """Gaussians of a PLY file, more than memory holds, decoded part by part for each picture.

    Pictures have the bits of `render_gaussians` of what `read_gaussians` and `cropped_gaussians`
    give.
    """

    def __init__(self, file: "TrainedFile", crop: Crop | None = None) -> None:
        file.tell()
        self.file, self.crop = file, crop or Crop()
        facts = file.empty(0)
        self.is_antialiased, self.up = facts.is_antialiased, facts.up

    @cached_property
    def training(self) -> Training | None:
        """The training's view of the scene, as from `read_gaussians`."""
        from resample_points.files.gaussians.formats import shots_beside

        rows = (self._drawable(part) for part in range(len(self.sizes())))
        shapes = [(made.position, made.scale, made.opacity) for made in rows]
        position, scale, opacity = map(np.concatenate, zip(*shapes, strict=True))
        return training_of(position, scale, opacity, shots_beside(self.file.path))

    def kernel(self) -> None:
        """None: opacities fall as Gaussians do."""

    def sizes(self) -> Sequence[int]:
        """Gaussians of each part, at most."""
        return [min(PART, self.file.count - first) for first in range(0, self.file.count, PART)]

    def load(self, part: int, view: View, /) -> Ellipsoids:
        """Drawable Gaussians of a part, with their colors toward the eye."""
        made = self._drawable(part)
        kept = kept_by(made, self.crop)
        made = made if kept.all() else some_gaussians(made, kept)
        return GaussianParts(with_unit_rotations(made)).load_rows(slice(None), view)

    def _drawable(self, part: int) -> Gaussians:
        """Read the Gaussians of a part that can be drawn."""
        made = self.file.part(slice(part * PART, (part + 1) * PART))
        known = are_drawable(made)
        return made if known.all() else some_gaussians(made, known)


def colors_of(gaussians: Gaussians, rows: slice, view: View) -> Floats:
    """Display-referred colors (N, 3) of some Gaussians, seen in a view."""
    from resample_points.kernels.gaussian_colors import color_gaussians

    toward = np.append(view.rotation[2], 0.0)
    if view.perspective:
        toward = np.append(-view.rotation.T @ view.translation, 1.0)
    position = np.ascontiguousarray(gaussians.position[rows], np.float32)
    constant = np.ascontiguousarray(gaussians.color[rows], np.float32)
    harmonics = gaussians.harmonics[rows]
    if harmonics.shape[:1] != position.shape[:1]:
        harmonics = np.zeros((len(position), 0, 3), np.int16)
    color = np.empty_like(constant)
    step = float(gaussians.harmonic_step)
    color_gaussians(position, constant, np.ascontiguousarray(harmonics), step, toward, color)
    return color


def render_gaussians(
    gaussians: Gaussians | StoredGaussians,
    camera: CloudView,
    *,
    size: tuple[int, int],
    style: GaussianStyle | None = None,
    background: Sequence[float] | None = None,
    memory: int | None = None,
    threads: int | None = None,
) -> Frame:
    """Render 3D Gaussians.

    Parameters
    ----------
    gaussians
        A checked scene, as `read_gaussians` returns it; or one that stays in its file.
    camera
        Any: perspective or parallel, with a lens, `Equirectangular`, or a `ProjectedCamera`.
    size
        Width and height, px.
    style
        Options of drawing.
    background
        Linear RGB behind the scene. Gaussians are composited in display values, as they were
        trained, with it as well: the picture is then opaque. None: transparent.
    memory
        Bytes for projected Gaussians; beyond, windows of the picture are painted one by one.
    threads
        Most threads to use.

    Returns
    -------
    The picture in linear light, bit-identical for any number of threads and any order of the
    Gaussians; `depth` is the mean, `value` the median depth, which is inf where less than half of
    the light is stopped. For panoramas and lenses depths are distances.

    Raises
    ------
    ValueError
        The size or an option is invalid, or the camera does not go with the others.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_points import Camera, Gaussians, render_gaussians
    >>> one = Gaussians(
    ...     *(np.ones((1, n), np.float32) for n in (3, 3, 4)),
    ...     np.ones(1, np.float32), np.ones((1, 3), np.float32),
    ... )
    >>> pose = np.eye(4)
    >>> pose[2, 3] = 5
    >>> frame = render_gaussians(one, Camera.from_fov(60, 24, 32, pose), size=(32, 24))
    >>> frame.rgba.shape, round(float(frame.rgba[14, 18, 3]), 2)
    ((24, 32, 4), 0.93)
    """
    from resample.engine import jit
    from resample.outofcore.ellipsoids import BYTES, paint_parts
    from resample.painting.all_around import paint_around

    if not isinstance(gaussians, Gaussians | StoredGaussians):
        raise TypeError(
            f"Gaussians of {type(gaussians).__name__}; give Gaussians, as read_gaussians(path) does"
        )
    shape, chosen = shape_of(size), style or GaussianStyle()
    check_kind("style", chosen, GaussianStyle, 'a GaussianStyle, such as GaussianStyle("bare")')
    wide = _rays(camera, shape)
    parts = GaussianParts(gaussians) if isinstance(gaussians, Gaussians) else gaussians
    training = gaussians.training
    if training is None and isinstance(gaussians, Gaussians):
        training = training_of(gaussians.position, gaussians.scale, gaussians.opacity)
    is_antialiased = gaussians.is_antialiased
    drawn = chosen.shaped(camera, training, is_antialiased=is_antialiased, is_wide=wide is not None)
    check_threads(threads)
    with jit.threads(jit.workers() if threads is None else threads):
        if wide is not None:
            picture = paint_around(parts, wide, shape, drawn)
        elif memory is not None and sum(parts.sizes()) * BYTES > memory:
            picture, _ = paint_parts(parts, cast("AnyCamera", camera), shape, drawn, memory=memory)
        else:
            picture = paint_ellipsoid_parts(parts, cast("AnyCamera", camera), shape, drawn)
    return developed(picture, background)


def _rays(camera: CloudView, shape: tuple[int, int]) -> Any:
    """Return the rays of a camera that bends lines; None for others."""
    from resample.painting.all_around import RayDirections, ray_directions

    if isinstance(camera, ProjectedCamera):
        projection = camera.projection
        projection.check(shape)
        if len(projection.tiles(shape)) > 1:
            raise ValueError(
                "Gaussians are rendered in projections of one part, not"
                f" {type(projection).__name__}"
            )

        def rays(place: Doubles) -> Doubles:
            shown = projection.shows(place, shape)[..., None]
            return np.where(shown, projection.rays(place, shape, 0), np.nan)

        return RayDirections(camera.world_to_camera, rays)
    if isinstance(camera, Equirectangular):
        return ray_directions(camera, shape)
    if isinstance(camera, Camera) and camera.distortion is not None:
        return ray_directions(camera, shape)
    if isinstance(camera, Camera | Orthographic):
        return None
    raise ValueError(
        "Gaussians are rendered by Camera, Orthographic, Equirectangular or ProjectedCamera, not by"
        f" {type(camera).__name__}; give a camera"
    )


def developed(picture: ShapedPicture, background: Sequence[float] | None) -> Frame:
    """Return a picture of display values in linear light, over a background if there is one."""
    rgba, alpha = picture.rgba, picture.rgba[..., 3:]
    if background is not None:
        behind = to_srgb(np.asarray(background, np.float32))
        light = from_srgb(rgba[..., :3] + (1 - alpha) * behind)
        rgba = np.concatenate([light, np.ones_like(alpha)], axis=2)
    else:
        straight = np.divide(
            rgba[..., :3], alpha, out=np.zeros_like(rgba[..., :3]), where=alpha > 0
        )
        rgba = np.concatenate([from_srgb(straight) * alpha, alpha], axis=2)
    counts, depths = picture.statistics, (picture.depth, picture.first_depth)
    return Frame(rgba, *depths, picture.coverage, counts, picture.median)


def shown_part(gaussians: Gaussians | StoredGaussians) -> Cloud:
    """Return the centers that cameras frame: opaque ones, without outliers."""
    if isinstance(gaussians, Gaussians):
        some = slice(None, None, max(1, len(gaussians.opacity) // FRAMED))
        place, opacity = gaussians.position[some], gaussians.opacity[some]
        reach = WIDE * float(np.median(gaussians.scale[some].max(axis=1))) if len(place) else 0.0
    else:
        reach = 0.0  # of so many, the centers tell where they are
        some = slice(None, None, max(1, gaussians.file.count // FRAMED))
        place, opacity = gaussians.file.shape_of(some)
        known = np.isfinite(place).all(axis=1) & np.isfinite(opacity)
        place, opacity = place[known], opacity[known]
    position: Doubles = place[opacity >= OPAQUE_ENOUGH].astype(np.float64)
    if not len(position):
        position = place.astype(np.float64)
    low, high = np.quantile(position, (TRIMMED, 1 - TRIMMED), axis=0)
    kept = ((position >= low) & (position <= high)).all(axis=1)
    inner = position[kept] if kept.any() else position
    low, high = inner.min(axis=0), inner.max(axis=0)
    if reach > (high - low).max():  # a few, or one within the other: they are larger than apart
        corners = np.indices((2, 2, 2)).reshape(3, -1).T
        inner = np.where(corners, high + reach, low - reach)
    nothing = np.empty((0, 3), np.float32)
    return Cloud(inner, nothing, nothing, np.empty(0, np.float32))


def gaussian_camera(
    gaussians: Gaussians | StoredGaussians, *, size: tuple[int, int], **choices: Any
) -> Camera | Orthographic:
    """Return a camera that frames a scene, without its outliers.

    Parameters
    ----------
    size
        Width and height, px.
    choices
        `azimuth`, `elevation`, `up`, `fov` as `framed` takes them.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_points import Gaussians, gaussian_camera
    >>> place = np.random.default_rng(1).normal(size=(50, 3)).astype(np.float32)
    >>> parts = place, np.full((50, 3), 0.1, np.float32), np.ones((50, 4), np.float32)
    >>> scene = Gaussians(*parts, np.ones(50, np.float32), np.ones((50, 3), np.float32))
    >>> gaussian_camera(scene, size=(32, 24), azimuth=30, up="z").fx > 0
    True
    """
    return framed(shown_part(gaussians), size=size, **{"fov": FIELD, **choices})
