"""Pictures for two eyes: eye distance, layouts, rendering."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import Camera, LensModel
from resample.cameras.pixels import Equirectangular, directions, pixel_centers
from resample.command.flags import Shape
from resample.command.session import Session
from resample.console import say
from resample.files.pictures import Picture
from resample.types import Doubles
from resample_warp3d.command.animation import stepped
from resample_warp3d.command.choices import DepthWarping, Joint
from resample_warp3d.command.inputs import DepthInput, Inputs
from resample_warp3d.command.layouts import shade, tiled, together
from resample_warp3d.command.parallax import HALF, Parallax
from resample_warp3d.command.rendering import Prepared, joined, joining_of, shifted
from resample_warp3d.command.writing import warped_picture
from resample_warp3d.depth.equation import of_rectified
from resample_warp3d.projection_models import CameraModel, StereoPanorama
from resample_warp3d.types import Hole, Warped

LARGEST = 4096  # px of an eye's picture around, unless its size is given
COMFORT = 0.015  # default parallax before and behind the screen, as a share of the width
SEEN_WIDTH = math.radians(60.0)  # of a flat picture before a viewer, by which comfort is judged
TIRING = math.radians(1.0)  # parallax that eyes fuse without strain
FADE = 4.0  # px over which parallax fades at a border, per px of it
COMFORT_AROUND = math.radians(2.0)  # default parallax of the nearest things to the farthest
SEEN = 1.0  # px of disparity, of which some is needed to see depth
STRAY = 0.01  # share of the depth at each end that may exceed this parallax


class Eyes(NamedTuple):
    """Parallax of two eyes: `gain` (n − `zero`) px at nearness n."""

    gain: float
    zero: float
    apart: float = 0.0  # distance between the eyes, scene units; 0: unknown
    far: float = 0.0  # nearness of the farthest and of the nearest things, without strays
    near: float = 1.0

    @property
    def most(self) -> float:
        """Largest parallax, px."""
        return self.gain * max(self.near - self.zero, self.zero - self.far)

    @classmethod
    def of_pair(cls, taken: Sequence[Inputs]) -> "Eyes":
        """Return the eyes of a rectified pair; say if its disparities hardly move anything."""
        most = max(float(inputs.views[0].image.nearness.max(initial=0.0)) for inputs in taken)
        if most < SEEN:
            say(
                f"the eyes see the same picture: disparities are at most {most:.2g} px; depth of "
                "other kinds needs --depth-kind, such as relative or z"
            )
        return cls(1.0, 0.0, near=most)

    @classmethod
    def of(cls, taken: Sequence[Inputs], choice: Parallax) -> "Eyes":
        """Choose eyes for a flat picture, or some of a film, and report them."""
        first = taken[0].views[0]
        known = np.concatenate([_known(inputs.views[0], 1.0) for inputs in taken])
        width, focal = first.shape[1], abs(float(first.pinhole.matrix[0, 0]))
        far, middle, near = map(float, np.quantile(known, [STRAY, 0.5, 1.0 - STRAY]))
        zero = middle if choice.zero_plane is None else 1.0 / choice.zero_plane
        zero = float(scaled(np.array(zero), (far, near), choice.foreground_scale))
        if choice.convergence is not None:
            zero = far + 0.01 * choice.convergence * (near - far)
        if choice.divergence is not None:
            gain = 0.01 * choice.divergence * width / max(near - far, 1e-12)
        elif choice.eye_distance is None:
            gain = COMFORT * width / max(near - zero, zero - far, 1e-12)
        else:
            gain = focal * choice.eye_distance
        found = cls(gain, zero, gain / focal, far, near)
        viewed = 0.5 * width / math.tan(0.5 * SEEN_WIDTH)  # px
        before, behind = gain * (near - zero), gain * (far - zero)
        low, high = (math.degrees(math.atan(each / viewed)) for each in (behind, before))
        limit = viewed * math.tan(TIRING)
        tiring = "; that tires eyes" if found.most > 1.01 * limit else ""
        say(
            f"the eyes are {found.apart:.3g} apart, the screen is {1.0 / zero:.3g} away: "
            f"parallax from {behind:.1f} to {before:.1f} px, {low:.2f} to {high:.2f} degrees where "
            f"the picture is 60 degrees wide; comfortable are {limit:.1f} px, 1 degree{tiring}"
        )
        return found

    @classmethod
    def around(cls, taken: Sequence[Inputs], choice: Parallax) -> "Eyes":
        """Choose parallel eyes for pictures of directions, and report them."""
        known = np.concatenate([_known(v, _lengths(v)) for inputs in taken for v in inputs.views])
        far, near = np.quantile(known, [STRAY, 1.0 - STRAY])
        usual = COMFORT_AROUND / max(near - far, 0.5 * near)
        apart = usual if choice.eye_distance is None else choice.eye_distance
        least, most = (math.degrees(apart * each) for each in (far, near))
        say(f"the eyes are {apart:.3g} apart: parallax from {least:.2f} to {most:.2f} degrees")
        return cls(0.0, 0.0, float(apart))


def _lengths(view: DepthInput) -> Doubles:
    """Ray length over depth of a view's samples."""
    place = view.image.place if view.image.place.size else pixel_centers(view.shape)
    flat = directions(view.pinhole, place)
    return np.asarray(np.sqrt(1.0 + (flat * flat).sum(axis=2)))


def scaled(nearness: Doubles, ends: tuple[float, float], scale: float) -> Doubles:
    """Return nearness with more relief of what is near: shares of its range to the power 2^scale.

    `ends`: nearness of the farthest and of the nearest things; 0 is unknown and stays.
    """
    if scale == 0.0:
        return nearness
    far, near = ends
    share = np.maximum(nearness - far, 0.0) / max(near - far, 1e-12)
    made = far + (near - far) * share ** (2.0**scale)
    return np.asarray(np.where(nearness > 0.0, np.maximum(made, 1e-9), 0.0), nearness.dtype)


def _known(view: DepthInput, length: Doubles | float) -> Doubles:
    """Nearness of a view's known samples, over a length."""
    nearness = view.image.nearness
    return np.asarray((nearness / length)[nearness > 0], np.float64)


@dataclass(frozen=True, eq=False)
class StereoRendering:
    """How both eyes' pictures are rendered."""

    parallax: Parallax
    fraction: float  # distance between the pictures: 1 is that of the eyes
    warping: DepthWarping
    is_around: bool  # pictures of directions: vr180 and panoramas
    bars: NDArray[np.bool_] | None = None  # (H, W) black bars, which stay on the screen

    @property
    def positions(self) -> tuple[float, float]:
        """Positions of the left and of the right picture from the source, in eye distances."""
        if self.parallax.eyes == "both":
            return -0.5 * self.fraction, 0.5 * self.fraction
        return (-self.fraction, 0.0) if self.parallax.eyes == "left" else (0.0, self.fraction)

    def eyes(self, taken: Sequence[Inputs], *, is_pair: bool) -> Eyes:
        """Choose the eyes for a picture, or some of a film, and report them."""
        if is_pair:
            return Eyes.of_pair(taken)
        if self.bars is not None:
            for inputs in taken:
                inputs.views[0].image.nearness[self.bars] = 0.0
        return (Eyes.around if self.is_around else Eyes.of)(taken, self.parallax)

    def shape(self, taken: Inputs) -> Shape:
        """Return height and width of an eye's picture, px."""
        given = self.parallax.shape()
        if not self.is_around or given is not None:
            return taken.shape if given is None else given
        if isinstance(taken.camera, Camera):
            side = min(LARGEST, 2 * round(0.5 * math.pi * abs(taken.camera.fx)))
            return side, side
        height, width = taken.shape
        is_half = self.parallax.layout in HALF
        return (height, height) if is_half else (height, width)

    def render(
        self, session: Session, taken: Inputs, eyes: Eyes, sources: list[Prepared]
    ) -> tuple[Picture, list[Picture], Warped | None]:
        """Render a picture for both eyes, in the layout.

        Also return the pictures of the left and of the right eye, or of a quilt, and the warp of
        the new one, None if nothing is new. `taken`: with its depth staged, as the sources are.
        """
        layout = self.parallax.layout or "one"
        if self.is_around:
            seen, warped = self._around(session, taken, sources, eyes)
        else:
            seen, warped = self._flat(session, taken, sources, eyes)
        if layout.endswith("rgbd"):
            nearness = sources[0].source.nearness
            share = (nearness - eyes.far) / max(eyes.near - eyes.far, 1e-12)
            seen.append(self._cropped(shade(share, seen[0]), eyes))
        if layout == "quilt":
            whole = tiled(seen, int(self.parallax.quilt.partition("x")[0]))
        elif layout == "one":
            whole = seen[0 if self.parallax.eyes == "left" else -1]
        else:
            whole = together(seen[0], seen[1], layout)
        return whole, seen, warped

    @property
    def _places(self) -> list[float]:
        """Positions of flat pictures, of which one, two or a quilt are made."""
        (left, right), layout = self.positions, self.parallax.layout or "one"
        if layout.endswith("rgbd"):
            return [0.0]
        if layout == "one":
            return [left if self.parallax.eyes == "left" else right]
        if layout != "quilt":
            return [left, right]
        columns, rows = map(int, self.parallax.quilt.split("x"))
        return list(self.fraction * np.linspace(-0.5, 0.5, columns * rows))

    def staged(self, taken: Inputs, eyes: Eyes) -> Inputs:
        """Return a flat picture with its depth as the options scale it, and fade it at borders."""
        choice, view = self.parallax, taken.views[0]
        if self.is_around:
            return taken
        near = view.image.nearness
        if choice.foreground_scale == 0.0 and not choice.preserve_borders and self.bars is None:
            return taken
        made = scaled(np.asarray(near, np.float64), (eyes.far, eyes.near), choice.foreground_scale)
        if choice.preserve_borders:
            width = near.shape[1]
            from_border = np.minimum(np.arange(width) + 0.5, width - 0.5 - np.arange(width))
            most = eyes.most * max(map(abs, self.positions))
            fade = np.clip(from_border / max(FADE * most, 1.0), 0.0, 1.0)
            made = np.where(made > 0, np.maximum(eyes.zero + (made - eyes.zero) * fade, 1e-9), 0)
        if self.bars is not None:
            made = np.where(self.bars & (near > 0), max(eyes.zero, 1e-9), made)
        image = view.image._replace(nearness=made.astype(np.float32))
        return taken._replace(views=[view._replace(image=image, step=None)])

    def _cropped(self, picture: Picture, eyes: Eyes) -> Picture:
        """Return a flat picture, of a size that is given, and without borders if requested."""
        data, size = picture.data, self.parallax.shape()
        if self.parallax.crop_borders:
            most = eyes.most * (self.positions[1] - self.positions[0])
            lost = min(math.ceil(most), data.shape[1] // 4)
            data = data[:, lost : data.shape[1] - lost]
        if size is not None:
            import cv2

            data = cv2.resize(data, size[::-1], interpolation=cv2.INTER_AREA)
            data = data.reshape(*size, picture.data.shape[2])
        return picture._replace(data=np.ascontiguousarray(data, np.float32))

    def _flat(
        self, session: Session, taken: Inputs, sources: list[Prepared], eyes: Eyes
    ) -> tuple[list[Picture], Warped | None]:
        """Render flat pictures; the source's own is copied, unless it has a lens."""
        view, kind, method = taken.views[0], taken.picture.kind, self.warping.built()
        seen: list[Picture] = []
        warped = None
        for position in self._places:
            picture = view.picture
            if position != 0.0 or view.image.place.size:
                equation = of_rectified(position, eyes.gain, eyes.zero)
                warped = shifted(session, sources[0], equation, taken.shape, self.warping, method)
                picture = warped_picture(warped, kind, filled=self.warping.fill)
            seen.append(self._cropped(picture, eyes))
        return seen, warped

    def _around(
        self, session: Session, taken: Inputs, sources: list[Prepared], eyes: Eyes
    ) -> tuple[list[Picture], Warped | None]:
        """Render pictures of directions, for both eyes."""
        kind, filled = taken.picture.kind, self.warping.fill
        layout = self.parallax.layout or ""
        height, width = self.shape(taken)
        joining = joining_of(taken, Joint.usual())
        made = []
        for target in self._targets(taken, eyes, layout, width):
            whole = height, 2 * width if layout == "vr180" else width
            seen = joined(session, sources, target, whole, self.warping, joining).warped
            made.append(_ahead(seen, layout, filled=filled) if layout in HALF else seen)
        new = made[0 if self.parallax.eyes == "left" else 1]
        return [warped_picture(each, kind, filled=filled) for each in made], new

    def _targets(self, taken: Inputs, eyes: Eyes, layout: str, width: int) -> list[CameraModel]:
        """Return the cameras of the left and of the right eye.

        A panorama is the head's, between both eyes.
        """
        pose, (left, right) = taken.camera.world_to_camera, self.positions
        if layout not in HALF:
            half = 0.5 * (right - left) * eyes.apart
            return [StereoPanorama(pose, -half), StereoPanorama(pose, half)]
        poses = [stepped([position * eyes.apart, 0.0, 0.0]) @ pose for position in (left, right)]
        if layout == "vr180":
            return [Equirectangular(each) for each in poses]
        focal, middle = width / math.pi, 0.5 * width  # 90 degrees at the circle's edge
        matrix = np.array([[focal, 0, middle], [0, focal, middle], [0, 0, 1.0]])
        return [Camera(matrix, each, model=LensModel.FISHEYE) for each in poses]


def _ahead(warped: Warped, layout: str, *, filled: bool) -> Warped:
    """Return the half sphere that is ahead; what is beside the source stays empty."""
    height, width = warped.coverage.shape
    if layout == "vr180":
        ahead = slice(width // 4, 3 * (width // 4))
        parts = {name: part[:, ahead] for name, part in warped._asdict().items()}
        warped = warped._replace(**parts)
        is_kept = np.ones(warped.coverage.shape, bool)
    else:
        row, column = np.ogrid[:height, :width]
        is_kept = np.hypot(row + 0.5 - 0.5 * height, column + 0.5 - 0.5 * width) <= 0.5 * width
    if filled:
        is_kept = is_kept & (warped.holes != Hole.OUTSIDE)
    image = warped.image * is_kept[..., None]
    return warped._replace(image=image, coverage=warped.coverage * is_kept)
