"""Pictures for two eyes: eye distance, rendering, and layouts beside each other and in colors.

Colors of an anaglyph are mixed as light. The matrices of Dubois ("A projection method to generate
anaglyph stereo images", ICASSP 2001) make what each eye sees through red and cyan glasses as close
to its picture as the glasses allow; those for LCD screens by Eric Dubois.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import Camera, LensModel
from resample.cameras.pixels import Equirectangular, directions, pixel_centers
from resample.colors import from_srgb
from resample.command.flags import Shape
from resample.command.session import Session
from resample.console import say
from resample.files.films import UNMARKED, StereoMarks
from resample.files.pictures import Picture
from resample.types import Doubles, Floats
from resample_warp3d.command.choices import DepthWarping, Joint
from resample_warp3d.command.inputs import DepthInput, Inputs
from resample_warp3d.command.parallax import HALF, Parallax
from resample_warp3d.command.rendering import Prepared, joined, joining_of, rendered
from resample_warp3d.command.writing import warped_picture
from resample_warp3d.depth.equation import of_rectified
from resample_warp3d.projection_models import CameraModel, StereoPanorama, stepped
from resample_warp3d.types import Hole, Warped

LARGEST = 4096  # px of an eye's picture around, unless its size is given
FLAT = 1e-3  # of the nearness: depth that differs by less is that of one plane
COMFORT = 0.015  # default parallax before and behind the screen, as a share of the width
SEEN_WIDTH = math.radians(60.0)  # of a flat picture before a viewer, by which comfort is judged
TIRING = math.radians(1.0)  # parallax that eyes fuse without strain
FADE = 4.0  # px over which parallax fades at a border, per px of it
COMFORT_AROUND = math.radians(2.0)  # default parallax of the nearest things to the farthest
SEEN = 1.0  # px of disparity, of which some is needed to see depth
STRAY = 0.01  # share of the depth at each end that may exceed this parallax
LUMA = (0.2126, 0.7152, 0.0722)  # of sRGB's primaries
NONE = (0.0, 0.0, 0.0)
RED, GREEN, BLUE = np.eye(3)
# Light (3, 3) that red, green and blue have of the left and of the right picture.
ANAGLYPHS = {
    "anaglyph": ([RED, NONE, NONE], [NONE, GREEN, BLUE]),
    "anaglyph-half-color": ([LUMA, NONE, NONE], [NONE, GREEN, BLUE]),
    "anaglyph-gray": ([LUMA, NONE, NONE], [NONE, LUMA, LUMA]),
    "anaglyph-dubois": (
        [(0.437, 0.449, 0.164), (-0.062, -0.062, -0.024), (-0.048, -0.050, -0.017)],
        [(-0.011, -0.032, -0.007), (0.377, 0.761, 0.009), (-0.026, -0.093, 1.234)],
    ),
}

# What players have to know; names of files are those that iw3, Pigasus, SKYBOX and DeoVR know.
MARKS = {
    "side-by-side": StereoMarks("left-right", None, "_LRF_Full_SBS", "left_right"),
    "half-side-by-side": StereoMarks("left-right", None, "_LR", "left_right", 3),
    "top-bottom": StereoMarks("top-bottom", None, "_TBF_fulltb", "top_bottom"),
    "half-top-bottom": StereoMarks("top-bottom", None, "_TB", "top_bottom", 4),
    "cross-eyed": StereoMarks(None, None, "_RLF_cross", "right_left"),
    "half-cross-eyed": StereoMarks(None, None, "_RL", "right_left"),
    "rows": StereoMarks(None, None, "_rows", "row_interleaved_lr"),
    "rgbd": StereoMarks(name="_RGBD"),
    "half-rgbd": StereoMarks(name="_HRGBD"),
    "vr180": StereoMarks("left-right", "180", "_180x180_LR", "left_right"),
    "vr180-fisheye": StereoMarks("left-right", None, "_FISHEYE180_LR", "left_right"),
    **{layout: StereoMarks(None, None, "_redcyan", "anaglyph_cyan_red") for layout in ANAGLYPHS},
}


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

    @staticmethod
    def of_pair(taken: Sequence[Inputs]) -> "Eyes":
        """Return the eyes of a rectified pair; say if its disparities hardly move anything."""
        most = max(float(inputs.views[0].image.nearness.max(initial=0.0)) for inputs in taken)
        if most < SEEN:
            say(
                f"the eyes see the same picture: disparities are at most {most:.2g} px; depth of "
                "other kinds needs --depth-kind, such as relative or z"
            )
        return Eyes(1.0, 0.0, near=most)

    @staticmethod
    def of(taken: Sequence[Inputs], choice: Parallax) -> "Eyes":
        """Choose eyes for a flat picture, or some of a film, and report them."""
        first = taken[0].views[0]
        known = np.concatenate([_known(inputs.views[0], 1.0) for inputs in taken])
        width, focal = first.shape[1], abs(float(first.pinhole.matrix[0, 0]))
        far, middle, near = map(float, np.quantile(known, [STRAY, 0.5, 1.0 - STRAY]))
        zero = middle if choice.zero_plane is None else 1.0 / choice.zero_plane
        zero = float(scaled(np.array(zero), (far, near), choice.foreground_scale))
        if choice.convergence is not None:
            zero = far + 0.01 * choice.convergence * (near - far)
        least = FLAT * near
        if choice.divergence is not None:
            gain = 0.01 * choice.divergence * width / max(near - far, least)
        elif choice.eye_distance is None:
            gain = COMFORT * width / max(near - zero, zero - far, least)
        else:
            gain = focal * choice.eye_distance
        found = Eyes(gain, zero, gain / focal, far, near)
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

    @staticmethod
    def around(taken: Sequence[Inputs], choice: Parallax) -> "Eyes":
        """Choose parallel eyes for pictures of directions, and report them."""
        known = np.concatenate([_known(v, _lengths(v)) for inputs in taken for v in inputs.views])
        far, near = np.quantile(known, [STRAY, 1.0 - STRAY])
        usual = COMFORT_AROUND / max(near - far, 0.5 * near)
        apart = usual if choice.eye_distance is None else choice.eye_distance
        least, most = (math.degrees(apart * each) for each in (far, near))
        say(f"the eyes are {apart:.3g} apart: parallax from {least:.2f} to {most:.2f} degrees")
        return Eyes(0.0, 0.0, float(apart))


def _lengths(view: DepthInput) -> Doubles:
    """Ray length over depth of a view's samples."""
    place = view.image.place if view.image.place.size else pixel_centers(view.shape)
    flat = directions(view.pinhole, place)
    return np.asarray(np.sqrt(1.0 + (flat * flat).sum(axis=2)))


def scaled(nearness: Doubles, ends: tuple[float, float], scale: float) -> Doubles:
    """Return nearness with more relief of what is near: shares of its range to the 2^scale."""
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
        look = self._around if self.is_around else self._flat
        seen, warped = look(session, taken, sources, eyes)
        if layout.endswith("rgbd"):
            nearness = sources[0].source.nearness
            share = (nearness - eyes.far) / max(eyes.near - eyes.far, 1e-12)
            seen.append(self._cropped(shade(share, seen[0]), eyes))
        if layout == "quilt":
            columns = int(self.parallax.quilt.partition("x")[0])
            rows = [
                np.concatenate([each.data for each in seen[start : start + columns]], axis=1)
                for start in range(0, len(seen), columns)
            ]
            whole = seen[0]._replace(data=np.concatenate(rows[::-1], axis=0))
        elif layout == "one":
            whole = seen[0 if self.parallax.eyes == "left" else -1]
        else:
            whole = together(seen[0], seen[1], layout)
        return whole, seen, warped

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
        layout, places = self.parallax.layout or "one", list(self.positions)
        if layout.endswith("rgbd"):
            places = [0.0]
        elif layout == "one":
            places = places[:1] if self.parallax.eyes == "left" else places[1:]
        elif layout == "quilt":
            columns, rows = map(int, self.parallax.quilt.split("x"))
            places = list(self.fraction * np.linspace(-0.5, 0.5, columns * rows))
        seen: list[Picture] = []
        warped = None
        for position in places:
            picture = view.picture
            if position != 0.0 or view.image.place.size:
                equation = of_rectified(position, eyes.gain, eyes.zero)
                warped = rendered(
                    session, sources[0], equation, taken.shape, self.warping, method,
                    with_depth=False,
                )  # fmt: skip
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
        """Return the cameras of both eyes; a panorama is the head's, between them."""
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


def marks_of(layout: str | None, *, is_panorama: bool) -> StereoMarks:
    """Return what a player has to know of pictures in a layout."""
    marks = MARKS.get(layout or "one", UNMARKED)
    if not is_panorama or layout in HALF:
        return marks
    short = {"left-right": "_LR", "top-bottom": "_TB"}.get(marks.mode or "", "")
    return marks._replace(around="360", name=f"_360{short}")


def shade(share: Floats, like: Picture) -> Picture:
    """Return shares (H, W) of 0..1 as an opaque gray picture with the channels of another one."""
    light = from_srgb(np.clip(share, 0.0, 1.0).astype(np.float32))[..., None]
    data = np.repeat(light, len(like.kind.channels), axis=2)
    if like.kind.has_alpha:
        data[..., -1] = 1.0
    return like._replace(data=np.ascontiguousarray(data, np.float32))


def together(left: Picture, right: Picture, layout: str) -> Picture:
    """Combine the pictures of both eyes; both have alpha if one has."""
    if left.kind.has_alpha != right.kind.has_alpha:
        both = [left, right]
        for n, (data, kind, about) in enumerate(both):
            if not kind.has_alpha:  # opaque
                whole = np.concatenate([data, np.ones_like(data[..., :1])], axis=2)
                both[n] = Picture(whole, kind._replace(channels=(*kind.channels, "A")), about)
        left, right = both
    if layout in ANAGLYPHS:
        return _anaglyph(left, right, layout)
    if layout == "rows":
        whole = np.empty_like(left.data)
        upper, lower = (_squeezed(p.data, 0) for p in (left, right))
        whole[::2], whole[1::2] = upper, lower[: len(whole) // 2]
        return left._replace(data=whole)
    if layout.endswith("cross-eyed"):
        left, right = right, left
    axis = 1 if layout in HALF or layout.endswith(("side-by-side", "cross-eyed", "rgbd")) else 0
    halves = [p.data for p in (left, right)]
    if layout.startswith("half-"):
        halves = [_squeezed(data, axis) for data in halves]
    return left._replace(data=np.concatenate(halves, axis=axis))


def _squeezed(data: Floats, axis: int) -> Floats:
    """Halve a picture (H, W, C) along an axis by means; odd sides to the next larger half."""
    import cv2

    height, width, channels = data.shape
    size = (width, (height + 1) // 2) if axis == 0 else ((width + 1) // 2, height)
    made = cv2.resize(np.ascontiguousarray(data), size, interpolation=cv2.INTER_AREA)
    return np.asarray(made, np.float32).reshape(size[1], size[0], channels)


def _anaglyph(left: Picture, right: Picture, layout: str) -> Picture:
    """Mix the light of both pictures in red and cyan."""
    names, has_alpha = left.kind.channels, left.kind.has_alpha
    colors = names[:-1] if has_alpha else names
    if colors not in (("R", "G", "B"), ("Y",)):
        raise ValueError(f"an anaglyph is made of gray or RGB pictures, not of {', '.join(colors)}")
    data = np.zeros((*left.data.shape[:2], 3), np.float32)
    for picture, shares in zip((left, right), ANAGLYPHS[layout], strict=True):
        matrix = np.asarray(shares, np.float32)
        if len(colors) == 1:
            matrix = matrix.sum(axis=1, keepdims=True)
        color = picture.data
        if has_alpha:
            color, alpha = color[..., :-1], color[..., -1:]
            color = np.divide(color, alpha, out=np.zeros_like(color), where=alpha > 0)
        data += color @ matrix.T
    np.clip(data, 0, None, out=data)
    channels: tuple[str, ...] = ("R", "G", "B")
    if has_alpha:
        alpha = np.minimum(left.data[..., -1:], right.data[..., -1:])
        data = np.concatenate([data * alpha, alpha], axis=2)
        channels = (*channels, "A")
    return Picture(data, left.kind._replace(channels=channels), left.about)
