"""Annotations, color bars and lines in a painted scene, with occlusion."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.cameras.models import AnyCamera
from resample.cameras.viewpoints import Orbit, Spelled, Sphere, camera_from, viewpoint_of
from resample.colors import Background, to_srgb
from resample.console import Color
from resample.engine.lookup import VISIBLE
from resample.lengths import length_text
from resample.measuring import color_bars as bars
from resample.painting.choices import MEASURING, Projection
from resample.resampler import Resampler
from resample.types import Doubles, Floats, Frame, View
from resample_volume import appearance as looks
from resample_volume.appearance import Appearance, Tone, VolumeLayer
from resample_volume.classification.scales import scale_named
from resample_volume.classification.transfer import (
    DataRange,
    Transfer,
    TransferFunction,
    from_points,
)
from resample_volume.classification.value_statistics import survey, without_padding
from resample_volume.data.recordings import unit_of_space
from resample_volume.rendering import Subject
from resample_volume.types import Picked, Volume
from resample_volume.voxels.framing import Shifted, centered, corners

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LEAST_DEPTH = 1e-6  # fraction of a line's length: nearer parts are cut off in perspective


class Stroke(NamedTuple):
    """A straight line between two points."""

    ends: Doubles  # (2, 3) scene units
    color: tuple[float, float, float]  # linear
    width: float  # px


def with_lines(frame: Frame, view: View, lines: Sequence[Stroke]) -> Frame:
    """Draw lines into the scene of a picture; its values are unchanged."""
    found = [marks for line in lines for marks in _marks(line, view, *frame.depth.shape)]
    if not found:
        return frame
    marked, deep, lights = map(np.concatenate, zip(*found, strict=True))
    order = np.lexsort((-deep, marked))
    deep, lights = deep[order], lights[order]
    # Composite marks, sorted by pixel and, within one, from back to front
    pixel, start = np.unique(marked[order], return_index=True)
    count = np.diff(np.append(start, marked.size))
    rgba = frame.rgba.reshape(-1, 4)[pixel].astype(np.float64)
    both = (part.reshape(-1)[pixel] for part in (frame.depth, frame.first_depth))
    depth, first = (part.astype(np.float64) for part in both)
    sent = np.zeros((pixel.size, 5))  # premultiplied light, opacity, opacity × depth
    behind = np.ones(pixel.size)  # share of the medium in front of the composited part
    for turn in range(int(count.max())):
        some = np.flatnonzero(count > turn)
        at, light = deep[start[some] + turn], lights[start[some] + turn]
        # Of the medium, a smooth step from its first to twice its mean depth is in front
        known = np.isfinite(first[some]) & np.isfinite(depth[some])
        begin, middle = np.where(known, first[some], 0.0), np.where(known, depth[some], 0.0)
        extent = np.maximum(2 * (middle - begin), 1e-6 * np.abs(middle) + 1e-30)
        t = np.clip((at - begin) / extent, 0, 1)
        here = np.minimum(np.where(known, t * t * (3 - 2 * t), 1.0), behind[some])
        sent[some] = _over(_medium(rgba[some], depth[some], behind[some] - here), sent[some])
        sent[some] = _over(np.column_stack([light, light[:, 3] * at]), sent[some])
        behind[some] = here
        is_seen = light[:, 3] * (1 - rgba[some, 3]) ** here > VISIBLE
        first[some] = np.minimum(first[some], np.where(is_seen, at, np.inf))
    sent = _over(_medium(rgba, depth, behind), sent)
    layers = [frame.rgba, frame.depth, frame.first_depth, frame.coverage]
    copies = [np.array(layer, np.float32) for layer in layers]
    copies[0].reshape(-1, 4)[pixel] = sent[:, :4]
    copies[1].reshape(-1)[pixel] = sent[:, 4] / np.maximum(sent[:, 3], 1e-30)
    copies[2].reshape(-1)[pixel] = first
    covered = np.maximum.reduceat(lights[:, 3], start)
    copies[3].reshape(-1)[pixel] = np.maximum(copies[3].reshape(-1)[pixel], covered)
    rgba, depth, first, coverage = copies
    return frame._replace(rgba=rgba, depth=depth, first_depth=first, coverage=coverage)


def _marks(
    line: Stroke, view: View, height: int, width: int
) -> Iterator[tuple[NDArray[np.int64], Doubles, Doubles]]:
    """Yield the pixels near a line (N,), its depths there, and its premultiplied light (N, 4)."""
    ends = line.ends @ view.rotation.T + view.translation
    if view.perspective:
        least = max(view.near, LEAST_DEPTH * float(np.linalg.norm(ends[1] - ends[0])))
        ends = _cut(ends, least)
    if not len(ends):
        return
    per = ends[:, 2:] if view.perspective else np.ones((2, 1))
    spot = ends[:, :2] / per * view.focal + view.principal
    row, column = _near(spot, line.width, (height, width))
    place = np.stack([column + 0.5, row + 0.5], axis=-1)
    way = spot[1] - spot[0]
    along = np.clip((place - spot[0]) @ way / max(float(way @ way), 1e-12), 0, 1)
    away = np.linalg.norm(place - spot[0] - along[:, None] * way, axis=-1)
    share = np.clip(line.width / 2 + 0.5 - away, 0, min(1.0, line.width))
    if view.perspective:
        depth = 1 / ((1 - along) / ends[0, 2] + along / ends[1, 2])
    else:
        depth = (1 - along) * ends[0, 2] + along * ends[1, 2]
    kept = (share > 0) & (depth >= view.near)
    if kept.any():
        light = share[kept, None] * np.array([*line.color, 1.0])
        yield (row * width + column)[kept], depth[kept], light


def _cut(ends: Doubles, near: float) -> Doubles:
    """Clip a line (2, 3) to its part behind a depth; (0, 3) if none is."""
    depth = ends[:, 2]
    if depth.max() <= near:
        return ends[:0]
    if depth.min() >= near:
        return ends
    share = (near - depth[0]) / (depth[1] - depth[0])
    ends = ends.copy()
    ends[int(depth[1] < near)] = ends[0] + share * (ends[1] - ends[0])
    return ends


def _near(
    spot: Doubles, width: float, size: tuple[int, int]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return rows and columns of the pixels near a line (2, 2) on the screen."""
    way = spot[1] - spot[0]
    major = int(abs(way[1]) > abs(way[0]))
    reach, count = width / 2 + 1, (size[1], size[0])
    ends = np.clip([spot[:, major].min() - reach, spot[:, major].max() + reach], -1, 1e9)
    first, last = max(0, math.floor(ends[0])), min(count[major] - 1, math.ceil(ends[1]))
    along = np.arange(first, last + 1)
    slope = way[1 - major] / way[major] if way[major] else 0.0
    middle = spot[0, 1 - major] + (along + 0.5 - spot[0, major]) * slope
    across = np.arange(-math.ceil(1.5 * reach), math.ceil(1.5 * reach) + 1)
    beside = np.floor(np.clip(middle, -1e9, 1e9)).astype(np.int64)[:, None] + across
    both = np.broadcast_to(along[:, None], beside.shape)
    kept = (beside >= 0) & (beside < count[1 - major])
    row, column = (both, beside) if major else (beside, both)
    return row[kept], column[kept]


def _medium(rgba: Doubles, depth: Doubles, share: Doubles) -> Doubles:
    """Return a share of the pixels' medium, as light with depth (N, 5)."""
    whole = rgba[:, 3]
    alpha = 1 - (1 - np.minimum(whole, 1.0)) ** share
    part = np.divide(alpha, whole, out=share.copy(), where=whole > 0)
    deep = np.where(np.isfinite(depth), depth, 0.0)
    return np.column_stack([part[:, None] * rgba[:, :3], alpha, alpha * deep])


def _over(front: Doubles, back: Doubles) -> Doubles:
    return np.asarray(front + (1 - front[:, 3:4]) * back)


class Measured(NamedTuple):
    """Distance and angle between points."""

    distance: float  # scene units, from the first point via the second to the last
    angle: float | None  # degrees 0 to 180 at the second of three points; None for two
    unit: str  # of the distance: mm, µm, ..., or empty if unknown


def measure(*points: Picked | ArrayLike, volume: Volume | None = None) -> Measured:
    """Measure the distance of two points, or the path along three and the angle at the second.

    Parameters
    ----------
    points
        Two or three points, from `Scene.pick` or (3,) scene units. A picked point is its voxel's
        center, so picked distances are accurate to a voxel.
    volume
        Gives the unit.

    Raises
    ------
    ValueError
        There are more or fewer points, one is invalid, or two of three coincide.

    Examples
    --------
    >>> from resample_volume import measure
    >>> measure((0, 0, 0), (3, 4, 0)).distance
    5.0
    >>> round(measure((1, 0, 0), (0, 0, 0), (0, 2, 0)).angle)
    90
    """
    if len(points) not in (2, 3):
        raise ValueError(f"{len(points)} points; give two for a distance, three for an angle")
    found = []
    for given in points:
        place = np.asarray(given.position if isinstance(given, Picked) else given, np.float64)
        if place.shape != (3,) or not np.isfinite(place).all():
            raise ValueError(f"the point {given!r} is not one of 3 finite numbers, scene units")
        found.append(place)
    ways = [after - before for before, after in pairwise(found)]
    lengths = [float(np.linalg.norm(way)) for way in ways]
    unit = "" if volume is None else unit_of_space(volume)
    if len(ways) == 1:
        return Measured(lengths[0], None, unit)
    if not all(lengths):
        raise ValueError("two of three points are the same, so there is no angle")
    back, on = -ways[0] / lengths[0], ways[1] / lengths[1]
    angle = 2 * np.arctan2(np.linalg.norm(back - on), np.linalg.norm(back + on))
    return Measured(sum(lengths), float(np.degrees(angle)), unit)


COLORS = ((0.75, 0.05, 0.04), (0.05, 0.5, 0.06), (0.08, 0.2, 0.9))  # of x, y and z, linear
GRAY = (0.4, 0.4, 0.4)  # of the box, on black as on white
BAR = 0.22  # of the picture's width, at most
HIDDEN = 0.5  # opacity in front of a label from which it is left out
CUBE = 0.2  # of the picture's shorter side
MARGIN = 0.03  # likewise
FONT = "DejaVu Sans"  # part of matplotlib
LIGHT, DARK = 0.9, 0.02  # linear gray of letters and bars, and of their outline
AROUND = 1  # px
AXES = ("+X", "-X", "+Y", "-Y", "+Z", "-Z")
PATIENT = ("L", "R", "P", "A", "S", "I")  # directions of the LPS axes
FINE = 4  # sub-pixels per side of a pixel
TYPE = 96  # px, of letters before they are mapped to a face
RIM = 0.07  # dark border, of half a side
REACH = 1.75  # half sides, from the cube's center to its corners


@dataclass(frozen=True)
class Annotations:
    """Annotations of a volume.

    Examples
    --------
    >>> from resample_volume import Annotations
    >>> Annotations(cube=False, scale_bar=False)
    Annotations(axes=True, box=True, cube=False, scale_bar=False, is_dark=False)
    """

    axes: bool = True  # lines along the scene's x, y and z, from the least corner of the box
    box: bool = True  # edges of the box around the volume
    cube: bool = True  # orientation of the axes: with a patient's directions if the file has them
    scale_bar: bool = True  # a length, in perspective at the depth of the volume's center
    is_dark: bool = False  # dark letters and bars, for bright backgrounds

    @property
    def is_any(self) -> bool:
        """Whether there is anything to draw."""
        return self.axes or self.box or self.cube or self.scale_bar


ALL = Annotations()


def annotate(
    frame: Frame,
    camera: Spelled,
    volume: Volume,
    shown: Annotations = ALL,
    *,
    appearance: Appearance | str = "auto",
) -> Frame:
    """Draw axes, box, an orientation cube and a scale bar into a picture of a volume.

    Parameters
    ----------
    frame
        From `render`; not changed.
    camera, volume, appearance
        As passed to `render`; an orbiting camera depends on the appearance.
    shown
        Which annotations to draw; hidden lines are removed.

    Raises
    ------
    TypeError, ValueError
        See `render`.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_volume import Annotations, annotate, as_volume, render
    >>> volume = as_volume(np.full((8, 8, 8), 200, np.uint8))
    >>> frame = render(volume, "100..300", (30, 20), size=(64, 48))
    >>> seen = annotate(frame, (30, 20), volume, Annotations(cube=False, scale_bar=False))
    >>> bool((seen.rgba[..., 3] > frame.rgba[..., 3]).any())  # axes around it
    True
    """
    height, width = frame.depth.shape
    scene, middle = centered(without_padding(volume, survey(volume)))
    camera = viewpoint_of(camera)
    eye: AnyCamera = Shifted(camera_from(camera, Sphere(middle, 1.0), height, width), middle)
    if isinstance(camera, Orbit):
        look = appearance if isinstance(appearance, Appearance) else Appearance(appearance)
        eye = Subject.of(scene, look).camera(camera, height, width)
    return annotated(frame, eye, scene, shown)


def annotated(frame: Frame, camera: AnyCamera, volume: Volume, given: Annotations) -> Frame:
    """Return the picture with annotations; camera and volume share a scene."""
    view, corner = camera.view(), corners(volume)
    height, width = frame.depth.shape
    size = max(9, round(0.035 * min(height, width)))  # of letters, px
    lines, arms = [], []
    if given.box:  # its edges: corners with numbers that differ in one bit
        pairs = [[n, n | bit] for n in range(8) for bit in (1, 2, 4) if not n & bit]
        lines = [Stroke(corner[pair], GRAY, size / 12) for pair in pairs]
    if given.axes:  # the scene's axes, as long as the box
        start, extent = corner[corner.sum(axis=1).argmin()], np.ptp(corner, axis=0)
        ends = [np.stack([start, start + extent * axis]) for axis in np.eye(3)]
        arms = [Stroke(*arm, size / 6) for arm in zip(ends, COLORS, strict=True)]
    drawn = with_lines(frame, view, [*lines, *arms])
    rgba = np.array(drawn.rgba)
    for arm, letter in zip(arms, "XYZ", strict=False):  # beyond its end, unless that is occluded
        end = arm.ends[1] + 0.06 * (arm.ends[1] - arm.ends[0])
        place = view.rotation @ end + view.translation
        if view.perspective and place[2] <= view.near:
            continue
        spot = place[:2] / (place[2] if view.perspective else 1.0) * view.focal + view.principal
        if not (np.abs(spot) < 1e6).all():
            continue
        column, row = np.floor(spot).astype(int)
        is_inside = 0 <= row < height and 0 <= column < width
        is_behind = is_inside and frame.depth[row, column] < place[2]
        if is_behind and frame.rgba[row, column, 3] > HIDDEN:
            continue
        mask = letters(letter, size)
        left, top = spot - np.array(mask.shape[::-1]) / 2
        put_mask(rgba, mask, round(left), round(top), is_dark=given.is_dark)
    if given.cube:  # in the lower left corner
        shorter = min(height, width)
        side, left = max(16, round(CUBE * shorter)), round(MARGIN * shorter / 2)
        cube = cube_picture(view.rotation, side, PATIENT if volume.space == "lps" else AXES)
        top = height - side - left
        part = rgba[max(0, top) : max(0, top) + side, left : left + side]
        shown = cube[max(0, -top) :][: part.shape[0], : part.shape[1]]
        part *= 1 - shown[..., 3:]
        part += shown
    if given.scale_bar:
        per_unit = float(view.focal[0])  # px, in perspective at the volume's center
        if view.perspective:
            depth = float(view.rotation[2] @ corner.mean(axis=0) + view.translation[2])
            if depth <= view.near:  # visible content may be in front
                seen = frame.depth[np.isfinite(frame.depth)]
                depth = float(np.median(seen)) if seen.size else math.inf
            per_unit /= depth
        _put_bar(rgba, per_unit, size, volume, given)
    return drawn._replace(rgba=rgba)


def round_length(most: float) -> float:
    """Return the greatest of 1, 2, 5, 10, ... that is at most this long."""
    power = 10.0 ** math.floor(math.log10(most))
    return max(step * power for step in (1, 2, 5) if step * power <= most * (1 + 1e-9))


def _put_bar(rgba: Floats, per_unit: float, size: int, volume: Volume, given: Annotations) -> None:
    """Draw a scale bar in the lower right corner, with its length above."""
    height, width = rgba.shape[:2]
    if not per_unit > 0:
        return
    length = round_length(BAR * width / per_unit)
    across, margin, thick = length * per_unit, round(MARGIN * min(height, width)), max(2, size // 5)
    tall = 2 * thick + 1
    mask = np.zeros((tall, math.ceil(across)), np.float32)
    mask[tall // 2 - thick // 2 :][:thick] = 1.0
    mask[:, : max(1, thick // 2)] = 1.0
    mask[:, -max(1, thick // 2) :] = 1.0
    mask[:, -1] *= across - math.floor(across) or 1.0
    left, top = width - margin - mask.shape[1], height - margin - tall
    put_mask(rgba, mask, left, top, is_dark=given.is_dark)
    words = letters(length_text(length, unit_of_space(volume)), size)
    middle = left + mask.shape[1] / 2
    left, top = round(middle - words.shape[1] / 2), top - words.shape[0] - thick - 2
    put_mask(rgba, words, left, top, is_dark=given.is_dark)


def letters(text: str, size: int) -> Floats:
    """Return the pixel coverage (h, w) of a line of text; `size` is its font size in px."""
    from matplotlib.font_manager import findfont
    from matplotlib.ft2font import FT2Font

    font = FT2Font(findfont(FONT))
    font.set_size(size, 72)
    font.set_text(text, 0.0)
    font.draw_glyphs_to_bitmap(antialiased=True)
    return np.asarray(font.get_image(), np.float32) / np.float32(255)


def put_mask(rgba: Floats, mask: Floats, left: int, top: int, *, is_dark: bool = False) -> None:
    """Draw light letters or bars with a dark outline, or vice versa; clipped at the edges."""
    from scipy.ndimage import grey_dilation

    wide = np.pad(mask, 2 * AROUND)
    rim = grey_dilation(wide, size=(2 * AROUND + 1, 2 * AROUND + 1))
    ink, around = (DARK, LIGHT) if is_dark else (LIGHT, DARK)
    for share, gray in ((0.8 * rim, around), (wide, ink)):
        cover(rgba, share, (gray, gray, gray), left - 2 * AROUND, top - 2 * AROUND)


def cover(
    rgba: Floats, share: Floats, color: tuple[float, float, float], left: int, top: int
) -> None:
    """Composite a color over a part of a premultiplied picture by pixel coverage (h, w)."""
    height, width = share.shape
    part = rgba[max(0, top) : max(0, top + height), max(0, left) : max(0, left + width)]
    shown = share[max(0, -top) :, max(0, -left) :][: part.shape[0], : part.shape[1]]
    ink = np.array([*color, 1.0], np.float32)
    part *= (1 - shown)[..., None]
    part += shown[..., None] * ink


def cube_picture(rotation: Doubles, side: int, names: tuple[str, ...] = AXES) -> Floats:
    """Draw a cube with a letter on each face (S, S, 4), premultiplied, linear."""
    place = ((np.arange(side * FINE) + 0.5) / (side * FINE) * 2 - 1) * REACH
    screen = np.stack(np.meshgrid(place, place), axis=-1)
    fine = np.zeros((side * FINE, side * FINE, 4))
    for face, letter in enumerate(names):
        normal = (1 - 2 * (face % 2)) * np.eye(3)[face // 2]
        toward = -float(rotation[2] @ normal)
        if toward <= 1e-3:
            continue
        # Draw a face, upright as seen from outside
        up = np.array([0.0, 1.0, 0.0] if normal[2] else [0.0, 0.0, 1.0])
        to_screen = np.stack([rotation @ np.cross(up, normal), rotation @ up], axis=1)[:2]
        middle = (rotation @ normal)[:2]
        local = (screen - middle) @ np.linalg.inv(to_screen).T  # -1..1 to the right and up
        # Look up the letter's ink, by px of it per half side
        mask = letters(letter, TYPE)
        height, width = mask.shape
        scale = max(width / 1.5, height / 1.1)
        column = np.floor(local[..., 0] * scale + width / 2).astype(np.int64)
        row = np.floor(-local[..., 1] * scale + height / 2).astype(np.int64)
        is_ink = (row >= 0) & (row < height) & (column >= 0) & (column < width)
        ink = np.where(is_ink, mask[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)], 0)
        inside = (np.abs(local) <= 1).all(axis=-1)
        is_rim = np.abs(local).max(axis=-1) > 1 - RIM
        gray = np.where(is_rim, 0.02, (0.15 + 0.55 * toward) * (1 - ink) + 0.01)
        fine[inside, :3] = gray[inside, None]
        fine[inside, 3] = 1.0
    return np.asarray(fine.reshape(side, FINE, side, FINE, 4).mean(axis=(1, 3)), np.float32)


SUBROWS = 8  # sub-rows per px over which colors are averaged, so that no step is missed
FAIR = 2  # the same where colors also vary across
PURE = 0.3  # share of a bar that shows opaque colors
GRAYS = from_points([(0.0, (0.0,) * 3, 1.0), (1.0, (1.0,) * 3, 1.0)], normalized=True)
SQUARES = (0.16, 0.42)  # linear gray of the checkerboard


def color_bar(
    transfer: Transfer, data_range: DataRange, height: int, *, title: str = "", steep: float = 1.0,
    background: Background = bars.BLACK, scale: str = "",
) -> Floats:  # fmt: skip
    """Draw a transfer function with a scale of data values (H, B, 4), linear, opaque.

    Colors lie over a checkerboard: opaque on the left, where faint ones can be told apart, and with
    opacity as a curve on the right. Functions of value and gradient are drawn over both axes.
    `steep` is the slope of a full surface (`voxels.visible.max_gradient`); 1 shows fractions.
    """
    bars.check_height(height)
    by = scale_named(scale)
    form: bars.Form = "plane" if transfer.needs_gradient else "curve"
    page = bars.BarLayout.of(data_range, height, title, form, None if by is None else by.ticks)
    ink = bars.ink_on(background)
    axes = bars.blank(page, background)
    if transfer.needs_gradient:
        # Draw colors by value and gradient
        end = (transfer.steepest(steep) or steep) * (1.0 if transfer.normalized else 1.25)
        value, across = page.values(FAIR), round(page.bar[1] - page.bar[0])
        slope = (np.arange(across) + 0.5) / across * end
        values, slopes = np.repeat(value, across), np.tile(slope.astype(np.float32), value.size)
        color, opacity = transfer.classify(values, slopes, data_range, steep)
        shape = (value.size // FAIR, FAIR, across)
        _show_over_squares(axes, page, color.reshape(*shape, 3), opacity.reshape(shape), ink)
        bars.name(axes, page, page.bar, ("0", "gradient", f"{end:.3g}"), ink)
    else:
        # Draw colors by value, and the curve of opacities
        value = page.values(SUBROWS)
        color, opacity = transfer.classify(value, None, data_range, 0.0)
        across = round(page.bar[1] - page.bar[0])
        colors = np.repeat(color.reshape(-1, SUBROWS, 1, 3), across, axis=2)
        shares = np.repeat(opacity.reshape(-1, SUBROWS, 1), across, axis=2)
        pure = shares[..., : round(PURE * across)]
        pure[pure > 0] = 1.0
        _show_over_squares(axes, page, colors, shares, ink)
        left, right = page.curve
        row = page.row(value)
        for place in page.ticks:
            axes.plot(page.curve, [page.row(place)] * 2, color=ink, lw=bars.thin(page), alpha=0.25)
        axes.fill_betweenx(row, left, left + opacity * (right - left), color=ink, alpha=0.3, lw=0)
        axes.plot(left + opacity * (right - left), row, color=ink, lw=2 * bars.thin(page))
        bars.frame(axes, page, page.curve, ink)
        bars.name(axes, page, page.curve, ("0", "opacity", "1"), ink)
    bars.draw_scale(axes, page, ink)
    return bars.painted(axes, page, ink)


def _show_over_squares(
    axes: "Axes", page: bars.BarLayout, color: Floats, opacity: Floats, ink: str
) -> None:
    """Composite colors (rows, parts, columns, 3) over the checkerboard."""
    rows, _, columns = opacity.shape
    side = max(3, round(0.5 * page.type))
    row, column = np.indices((rows, columns)) // side
    squares = np.where((row + column) % 2, *SQUARES)[:, np.newaxis, :, np.newaxis]
    share = opacity[..., np.newaxis]
    linear = (share * color + (1 - share) * squares).mean(axis=1)
    bars.show(axes, page, linear, ink)


def bar_of(
    medium: VolumeLayer, resampler: Resampler, height: int, background: Color | None, tone: Tone,
    frame: Frame | None = None,
) -> Floats:  # fmt: skip
    """Draw the color bar of a volume, or of the sums in a frame (height, B, 4), linear, opaque."""
    volume, appearance = medium
    transfer: Transfer = GRAYS
    scale = "" if resampler.projection is Projection.ADDITIVE else volume.scale
    if tone.window is not None:
        extent = tone.window
    elif resampler.projection is Projection.ADDITIVE:
        if frame is None:
            raise ValueError("each frame of sums has a range of its own; leave --color-bar out")
        # Light grows with the sum; the largest is white.
        share = np.linspace(0.0, 1.0, 256)
        gray = np.repeat(to_srgb(share)[:, np.newaxis], 3, axis=1)
        transfer = TransferFunction(share, gray, np.ones(share.size), normalized=True)
        value = np.zeros(1) if frame.value is None else frame.value
        extent = 0.0, float(value[np.isfinite(value)].max(initial=0.0))
    else:
        transfer = looks.transfer_of(volume, appearance, resampler.projection)
        extent = survey(volume).span
        if resampler.projection in MEASURING and isinstance(transfer, TransferFunction):
            extent = extent if transfer.normalized else (transfer.value[0], transfer.value[-1])
    if tone.is_negative:
        # Displayed colors with black and white swapped, over black.
        value = np.linspace(*extent, 256)
        color, opacity = transfer.classify(value, None, extent, 0.0)
        swapped = to_srgb(looks.negative(color * opacity[:, np.newaxis]))
        transfer = TransferFunction(value, swapped, np.ones(value.size))
    behind = background or (0.0, 0.0, 0.0)
    return color_bar(transfer, extent, height, title=volume.name, background=behind, scale=scale)


def with_bar(
    frame: Frame, volume: Volume, appearance: Appearance, resampler: Resampler,
    background: Color | None, tone: Tone = looks.AS_IT_IS,
) -> Frame:  # fmt: skip
    """Add the bar of a volume to the right of its picture."""
    bar = bar_of((volume, appearance), resampler, len(frame.rgba), background, tone, frame)
    return frame._replace(rgba=bars.with_color_bar(frame.rgba, bar, background))
