"""Pictures for two eyes: eye distance, layouts, rendering."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from resample.cameras.models import Camera
from resample.cameras.panoramic import Equirectangular
from resample.cameras.pixels import directions, pixel_centers
from resample.command.intrinsics import Shape
from resample.command.session import Session
from resample.console import say
from resample.files.pictures import Picture
from resample.types import Doubles
from resample_warp3d.command.animation import stepped
from resample_warp3d.command.choices import DepthWarping, Joint
from resample_warp3d.command.inputs import DepthInput, Inputs
from resample_warp3d.command.layouts import together
from resample_warp3d.command.parallax import Parallax
from resample_warp3d.command.rendering import Prepared, joined, joining_of, prepared, shifted
from resample_warp3d.command.writing import warped_picture
from resample_warp3d.depth.equation import of_rectified
from resample_warp3d.types import Hole, Warped
from resample_warp3d.wide import CameraModel, StereoPanorama

LARGEST = 4096  # px of an eye's picture around, unless its size is given
COMFORT = 0.015  # default parallax before and behind the screen, as a share of the width
COMFORT_AROUND = math.radians(2.0)  # default parallax of the nearest things to the farthest
SEEN = 1.0  # px of disparity, of which some is needed to see depth
STRAY = 0.01  # share of the depth at each end that may exceed this parallax


class Eyes(NamedTuple):
    """Parallax of two eyes: `gain` (n − `zero`) px at nearness n."""

    gain: float
    zero: float
    apart: float = 0.0  # distance between the eyes, scene units; 0: unknown

    @classmethod
    def of_pair(cls, taken: Sequence[Inputs]) -> "Eyes":
        """Return the eyes of a rectified pair; say if its disparities hardly move anything."""
        most = max(float(inputs.views[0].image.nearness.max(initial=0.0)) for inputs in taken)
        if most < SEEN:
            say(
                f"the eyes see the same picture: disparities are at most {most:.2g} px; depth of "
                "other kinds needs --depth-kind, such as relative or z"
            )
        return cls(1.0, 0.0)

    @classmethod
    def of(cls, taken: Sequence[Inputs], choice: Parallax) -> "Eyes":
        """Choose eyes for a flat picture, or some of a film, and report them."""
        first = taken[0].views[0]
        known = np.concatenate([_known(inputs.views[0], 1.0) for inputs in taken])
        width, focal = first.shape[1], abs(float(first.pinhole.matrix[0, 0]))
        far, middle, near = np.quantile(known, [STRAY, 0.5, 1.0 - STRAY])
        zero = float(middle) if choice.zero_plane is None else 1.0 / choice.zero_plane
        if choice.convergence is not None:
            zero = float(far + 0.01 * choice.convergence * (near - far))
        if choice.divergence is not None:
            gain = 0.01 * choice.divergence * width / max(near - far, 1e-12)
        elif choice.eyes is None:
            gain = COMFORT * width / max(near - zero, zero - far, 1e-12)
        else:
            gain = focal * choice.eyes
        before, behind = gain * (near - zero), gain * (far - zero)
        say(
            f"the eyes are {gain / focal:.3g} apart, the screen is {1.0 / zero:.3g} away: "
            f"parallax from {behind:.1f} to {before:.1f} px"
        )
        return cls(gain, zero, gain / focal)

    @classmethod
    def around(cls, taken: Sequence[Inputs], choice: Parallax) -> "Eyes":
        """Choose parallel eyes for pictures of directions, and report them."""
        known = np.concatenate([_known(v, _lengths(v)) for inputs in taken for v in inputs.views])
        far, near = np.quantile(known, [STRAY, 1.0 - STRAY])
        usual = COMFORT_AROUND / max(near - far, 0.5 * near)
        apart = usual if choice.eyes is None else choice.eyes
        least, most = (math.degrees(apart * each) for each in (far, near))
        say(f"the eyes are {apart:.3g} apart: parallax from {least:.2f} to {most:.2f} degrees")
        return cls(0.0, 0.0, float(apart))


def _lengths(view: DepthInput) -> Doubles:
    """Ray length over depth of a view's samples."""
    place = view.image.place if view.image.place.size else pixel_centers(view.shape)
    flat = directions(view.pinhole, place)
    return np.asarray(np.sqrt(1.0 + (flat * flat).sum(axis=2)))


def _known(view: DepthInput, length: Doubles | float) -> Doubles:
    """Nearness of a view's known samples, over a length."""
    nearness = view.image.nearness
    return np.asarray((nearness / length)[nearness > 0], np.float64)


class StereoPair(NamedTuple):
    """Picture to write, and the warp of the new eye's picture."""

    picture: Picture
    warped: Warped
    sources: list[Prepared]


@dataclass(frozen=True, eq=False)
class StereoRendering:
    """How both eyes' pictures are rendered."""

    parallax: Parallax
    fraction: float  # position of the new eye: 1 is the other eye
    given: str  # left or right: which eye's picture the source is
    warping: DepthWarping
    is_around: bool  # pictures of directions: vr180 and panoramas

    @property
    def way(self) -> float:
        """Position of the new eye to the right, in eye distances."""
        return self.fraction if self.given == "left" else -self.fraction

    def eyes(self, taken: Sequence[Inputs], *, is_pair: bool) -> Eyes:
        """Choose the eyes for a picture, or some of a film, and report them."""
        if is_pair:
            return Eyes.of_pair(taken)
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
        return (height, height) if self.parallax.layout == "vr180" else (height, width)

    def render(
        self, session: Session, taken: Inputs, eyes: Eyes, chosen: Sequence[str] | None = None
    ) -> StereoPair:
        """Render a picture for both eyes, in the layout.

        `chosen`: refinement of each view; None: that of the options.
        """
        sources = prepared(session, taken.views, self.warping, chosen)
        render = self._around if self.is_around else self._flat
        first, second, warped = render(session, taken, sources, eyes)
        if self.parallax.layout == "one":
            return StereoPair(second, warped, sources)
        both = (first, second) if self.given == "left" else (second, first)
        return StereoPair(together(*both, self.parallax.layout), warped, sources)

    def _flat(
        self, session: Session, taken: Inputs, sources: list[Prepared], eyes: Eyes
    ) -> tuple[Picture, Picture, Warped]:
        """Render the new eye's picture, beside the source's."""
        view, kind, filled = taken.views[0], taken.picture.kind, self.warping.fill
        shape, equation = taken.shape, of_rectified(self.way, eyes.gain, eyes.zero)
        warped = shifted(session, sources[0], equation, shape, self.warping)
        first = view.picture
        if view.image.place.size and self.parallax.layout != "one":  # only the source has a lens
            unbent = shifted(session, sources[0], of_rectified(0.0), shape, self.warping)
            first = warped_picture(unbent, kind, filled=filled)
        return first, warped_picture(warped, kind, filled=filled), warped

    def _around(
        self, session: Session, taken: Inputs, sources: list[Prepared], eyes: Eyes
    ) -> tuple[Picture, Picture, Warped]:
        """Render pictures of directions, for both eyes."""
        kind, filled = taken.picture.kind, self.warping.fill
        is_half = self.parallax.layout == "vr180"
        height, width = self.shape(taken)
        joining = joining_of(taken, Joint.usual())
        made = []
        for target in self._targets(taken, eyes, is_half=is_half):
            whole = height, 2 * width if is_half else width
            seen = joined(session, sources, target, whole, self.warping, joining).warped
            made.append(_front(seen, filled=filled) if is_half else seen)
        first, second = (warped_picture(each, kind, filled=filled) for each in made)
        return first, second, made[1]

    def _targets(self, taken: Inputs, eyes: Eyes, *, is_half: bool) -> list[CameraModel]:
        """Return the cameras of the given and of the new eye.

        The source of vr180 is one eye's picture; a panorama is the head's, between both eyes.
        """
        pose = taken.camera.world_to_camera
        if is_half:
            moved = stepped([self.way * eyes.apart, 0.0, 0.0]) @ pose
            return [Equirectangular(pose), Equirectangular(moved)]
        half = 0.5 * self.way * eyes.apart
        return [StereoPanorama(pose, -half), StereoPanorama(pose, half)]


def _front(warped: Warped, *, filled: bool) -> Warped:
    """Return the half of a panorama that is ahead; what is beside the source stays empty."""
    quarter = warped.coverage.shape[1] // 4
    ahead = slice(quarter, 3 * quarter)
    parts = {name: part[:, ahead] for name, part in warped._asdict().items()}
    half = warped._replace(**parts)
    if not filled:
        return half
    is_kept = half.holes != Hole.OUTSIDE
    image = half.image * is_kept[..., None]
    return half._replace(image=image, coverage=half.coverage * is_kept)
