"""Color bars that show opacity too: what a picture of a volume means, right beside it."""

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from resample.colors import Background, from_srgb, over, to_srgb
from resample.types import Doubles, Floats
from resample_volume.looks.transfer import DataRange, Transfer

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LEAST_HEIGHT = 64  # px
DPI = 64  # a power of two, so that a figure of whole px has as many
POINTS = 72 / DPI  # a px in points
FINE = 8  # parts of a row of px over which colors are averaged, so that no step is missed
FAIR = 2  # the same where colors also vary across
PURE = 0.3  # share of a bar that shows the colors alone
SQUARES = (0.16, 0.42)  # linear gray of the checkerboard
DARK, LIGHT = "#1a1a1a", "#e8e8e8"
BLACK = (0.0, 0.0, 0.0)
LUMINANCE = (0.2126, 0.7152, 0.0722)
BRIGHT = 0.18  # luminance from which on dark text is easier to read
SIDES = ("left", "center", "right")
LONGEST = 18  # letters of a title


def color_bar(
    transfer: Transfer,
    data_range: DataRange,
    height: int,
    *,
    title: str = "",
    steep: float = 1.0,
    background: Background = BLACK,
) -> Floats:
    """Picture of a transfer function, with a scale of data values.

    Colors lie over a checkerboard that shows through by their transparency. To the left they stand
    alone, since faint ones could not be told apart; to the right opacity is drawn as a curve.
    Functions of value and gradient are drawn over both instead.

    Parameters
    ----------
    transfer
        Any.
    data_range
        Least and greatest finite value of the data, where the scale begins and ends.
    height
        Of the picture, px, at least 64.
    title
        Above the bar, shortened where it is long.
    steep
        Slope of a full surface, see `resample_volume.voxels.visible.steepness`. With 1 a normalized
        function's gradients are shown as its fractions.
    background
        Linear color behind all this. Text is light on dark and dark on light.

    Returns
    -------
    (H, B, 4) linear, opaque. The width B follows from the height and the text.

    Raises
    ------
    ValueError
        The height is too small.
    """
    if height < LEAST_HEIGHT:
        raise ValueError(f"a color bar is at least {LEAST_HEIGHT} px high (got {height})")
    page = _Page.of(data_range, height, title, transfer.needs_gradient)
    ink = DARK if np.dot(background, LUMINANCE) > BRIGHT else LIGHT
    axes = _blank(page, background)
    if transfer.needs_gradient:
        _draw_plane(axes, page, transfer, (data_range, steep), ink)
    else:
        _draw_strip(axes, page, transfer, data_range, ink)
    _draw_scale(axes, page, ink)
    _write(axes, page, (page.margin, page.margin), page.title, ink, va="top")
    return _painted(axes, page)


def with_color_bar(rgba: Floats, bar: Floats, background: Background | None = None) -> Floats:
    """Picture (H, W + B, 4) with a bar (H, B, 4) to its right.

    Parameters
    ----------
    rgba
        (H, W, 4) linear, premultiplied.
    bar
        From `color_bar`, of the same height.
    background
        Linear color to put behind the picture; None leaves it transparent.

    Raises
    ------
    ValueError
        The heights differ.
    """
    if len(rgba) != len(bar):
        raise ValueError(f"a bar of {len(bar)} px does not fit a picture of {len(rgba)} px")
    if background is None:
        return np.concatenate([rgba, bar], axis=1)
    behind = np.ones_like(rgba)
    behind[..., :3] = over(rgba, background)
    return np.concatenate([behind, bar], axis=1)


class _Page(NamedTuple):
    """What stands where, px from the upper left corner."""

    height: int
    width: int
    type: float  # size of type
    margin: float
    top: float  # of the bar
    bottom: float
    bar: tuple[float, float]  # left and right of the colors
    curve: tuple[float, float]  # left and right of the opacities
    span: DataRange  # values at the bottom and at the top
    ticks: dict[float, str]
    title: str

    @classmethod
    def of(cls, data_range: DataRange, height: int, title: str, is_plane: bool) -> "_Page":
        """Page that is as wide as what has to be on it."""
        size = float(np.clip(round(4 + 0.017 * height), 8, 36))
        margin = round(0.8 * size)
        shown = title if len(title) <= LONGEST else title[: LONGEST - 1] + "…"
        top = margin + round(1.7 * size if title else 0.3 * size)
        bottom = height - margin - round(1.5 * size)
        span = data_range if data_range[0] < data_range[1] else _around(data_range[0])
        ticks = _ticks(span, (bottom - top) / (2.5 * size))
        middle = margin + round(max(0.5 * (bottom - top), 11 * size) if is_plane else 2.2 * size)
        curve = (middle, middle) if is_plane else (middle + size // 2, middle + round(7 * size))
        scale = curve[1] + size + max(_length(text, size) for text in ticks.values())
        width = math.ceil(max(scale, margin + _length(shown, size)) + margin)
        bar = (float(margin), float(middle))
        return cls(height, width, size, margin, top, bottom, bar, curve, span, ticks, shown)

    def row(self, value: Any) -> Any:
        """Where values are, px from the top."""
        low, high = self.span
        return self.bottom - (value - low) / (high - low) * (self.bottom - self.top)

    def values(self, parts: int) -> Doubles:
        """Values in the middle of each part of the bar's px, from the top to the bottom."""
        count = round(self.bottom - self.top) * parts
        share = (np.arange(count) + 0.5) / count
        return self.span[1] * (1 - share) + self.span[0] * share


def _around(value: float) -> DataRange:
    """Range for a volume of one value."""
    away = max(abs(value), 1.0) / 2
    return value - away, value + away


def _ticks(span: DataRange, most: float) -> dict[float, str]:
    """Round values within a range, and what is written beside them."""
    from matplotlib.ticker import MaxNLocator

    locator = MaxNLocator(nbins=int(np.clip(most, 2, 10)), steps=[1, 2, 2.5, 5, 10])
    places = [float(place) for place in locator.tick_values(*span)]
    step = places[1] - places[0]
    inside = [place for place in places if span[0] <= place <= span[1]]
    largest = max(map(abs, places))
    digits = math.floor(math.log10(largest)) - math.floor(math.log10(step)) + 2
    if 1e-4 <= largest < 1e6:
        digits = max(digits, math.floor(math.log10(largest)) + 1)
    texts = (f"{0.0 if abs(place) < step / 2 else place:.{digits}g}" for place in inside)
    return {place: text.replace("-", "−") for place, text in zip(inside, texts, strict=True)}


def _length(text: str, size: float) -> float:
    """Width of a line of text, px."""
    from matplotlib.textpath import TextPath

    return float(TextPath((0, 0), text, size=size).get_extents().width) if text.strip() else 0.0


def _blank(page: _Page, background: Background) -> "Axes":
    """Empty page whose coordinates are px."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    size = (page.width / DPI, page.height / DPI)
    figure = Figure(size, dpi=DPI, facecolor=to_srgb(np.asarray(background, np.float64)).tolist())
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    axes.set_xlim(0, page.width)
    axes.set_ylim(page.height, 0)
    return axes


def _draw_strip(
    axes: "Axes", page: _Page, transfer: Transfer, data_range: DataRange, ink: str
) -> None:
    """Colors by value, and the curve of opacities."""
    value = page.values(FINE)
    color, opacity = transfer.looks(value, None, data_range, 0.0)
    across = round(page.bar[1] - page.bar[0])
    colors = np.repeat(color.reshape(-1, FINE, 1, 3), across, axis=2)
    shares = np.repeat(opacity.reshape(-1, FINE, 1), across, axis=2)
    pure = shares[..., : round(PURE * across)]
    pure[pure > 0] = 1.0
    _show(axes, page, colors, shares, ink)
    left, right = page.curve
    row = page.row(value)
    for place in page.ticks:
        axes.plot(page.curve, [page.row(place)] * 2, color=ink, lw=_thin(page), alpha=0.25)
    axes.fill_betweenx(row, left, left + opacity * (right - left), color=ink, alpha=0.3, lw=0)
    axes.plot(left + opacity * (right - left), row, color=ink, lw=2 * _thin(page))
    _frame(axes, page, page.curve, ink)
    _name(axes, page, page.curve, ("0", "opacity", "1"), ink)


def _draw_plane(
    axes: "Axes",
    page: _Page,
    transfer: Transfer,
    extent: tuple[DataRange, float],
    ink: str,
) -> None:
    """Colors by value and gradient."""
    data_range, steep = extent
    end = (transfer.steepest(steep) or steep) * (1.0 if transfer.normalized else 1.25)
    value, across = page.values(FAIR), round(page.bar[1] - page.bar[0])
    slope = (np.arange(across) + 0.5) / across * end
    values, slopes = np.repeat(value, across), np.tile(slope.astype(np.float32), value.size)
    color, opacity = transfer.looks(values, slopes, data_range, steep)
    shape = (value.size // FAIR, FAIR, across)
    _show(axes, page, color.reshape(*shape, 3), opacity.reshape(shape), ink)
    _name(axes, page, page.bar, ("0", "gradient", f"{end:.3g}"), ink)


def _show(axes: "Axes", page: _Page, color: Floats, opacity: Floats, ink: str) -> None:
    """Colors (rows, parts, columns, 3) over the checkerboard."""
    rows, _, columns = opacity.shape
    side = max(3, round(0.5 * page.type))
    row, column = np.indices((rows, columns)) // side
    squares = np.where((row + column) % 2, *SQUARES)[:, np.newaxis, :, np.newaxis]
    share = opacity[..., np.newaxis]
    linear = (share * color + (1 - share) * squares).mean(axis=1)
    left, right = page.bar
    axes.imshow(
        np.round(255 * np.clip(to_srgb(linear), 0, 1)).astype(np.uint8),
        extent=(left, right, page.bottom, page.top),
        aspect="auto",
        interpolation="nearest",
    )
    axes.set_xlim(0, page.width)
    axes.set_ylim(page.height, 0)
    _frame(axes, page, page.bar, ink)


def _draw_scale(axes: "Axes", page: _Page, ink: str) -> None:
    """Values beside the bar."""
    right = page.curve[1]
    for place, text in page.ticks.items():
        row = page.row(place)
        axes.plot([right, right + 0.4 * page.type], [row, row], color=ink, lw=_thin(page))
        _write(axes, page, (right + 0.7 * page.type, row), text, ink, va="center_baseline")


def _name(
    axes: "Axes", page: _Page, span: tuple[float, float], texts: tuple[str, str, str], ink: str
) -> None:
    """What goes from left to right: where it begins, its name and where it ends."""
    row = page.bottom + 0.4 * page.type
    for x, text, side in zip((span[0], sum(span) / 2, span[1]), texts, SIDES, strict=True):
        _write(axes, page, (x, row), text, ink, va="top", ha=side)


def _frame(axes: "Axes", page: _Page, span: tuple[float, float], ink: str) -> None:
    left, right = span
    x, y = (
        [left, right, right, left, left],
        [page.top, page.top, page.bottom, page.bottom, page.top],
    )
    axes.plot(x, y, color=ink, lw=_thin(page), alpha=0.7)


def _write(
    axes: "Axes", page: _Page, place: tuple[float, float], text: str, ink: str, **sides: Any
) -> None:
    axes.text(*place, text, fontsize=page.type * POINTS, color=ink, parse_math=False, **sides)


def _thin(page: _Page) -> float:
    """Width of a fine line, points."""
    return max(1.0, page.type / 14) * POINTS


def _painted(axes: "Axes", page: _Page) -> Floats:
    """The page as a picture."""
    figure: Any = axes.figure
    canvas = figure.canvas
    canvas.draw()
    levels = np.asarray(canvas.buffer_rgba())[..., :3] / np.float32(255)
    picture = np.ones((page.height, page.width, 4), np.float32)
    picture[..., :3] = from_srgb(levels)
    return picture
