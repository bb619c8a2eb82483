"""Color bars: legends beside a picture that map colors to values."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from resample.colors import Background, from_srgb, over, to_srgb
from resample.types import Doubles, Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LEAST_HEIGHT = 64  # px
DPI = 64  # a power of two, so that figures have whole px
POINTS = 72 / DPI  # a px in points
DARK, LIGHT = "#1a1a1a", "#e8e8e8"
BLACK = (0.0, 0.0, 0.0)
LUMINANCE = (0.2126, 0.7152, 0.0722)
BRIGHT = 0.18  # luminance above which dark text is easier to read
SIDES = ("left", "center", "right")
LONGEST = 18  # characters of a title
LINES = 2.0  # lines of text in the space of a tick

Span = tuple[float, float]  # minimum and maximum of a scale
Ticked = Callable[[Span, float], dict[float, str]]  # as `ticks_of`
Form = Literal["colors", "curve", "plane"]  # a color strip, a strip with a curve, or a square


def plain_bar(
    colors: Floats,
    span: Span,
    height: int,
    *,
    title: str = "",
    background: Background = BLACK,
    ticked: "Ticked | None" = None,
) -> Floats:
    """Picture of opaque colors with a scale of their values.

    `colors`: (N, 3) linear, at equally spaced values from the minimum to the maximum. `height`: of
    the picture, px, at least 64. `ticked`: values to mark, and their labels; default: round ones.
    Result: (H, B, 4) linear, opaque. The width B follows from the height and the text.
    """
    check_height(height)
    page = BarLayout.of(span, height, title, "colors", ticked)
    ink = ink_on(background)
    axes = blank(page, background)
    rows = round(page.bottom - page.top)
    place = np.clip((np.arange(rows)[::-1] + 0.5) / rows * len(colors), 0, len(colors) - 1)
    shown = np.asarray(colors, np.float32)[place.astype(np.int64), np.newaxis]
    show(axes, page, np.repeat(shown, round(page.bar[1] - page.bar[0]), axis=1), ink)
    draw_scale(axes, page, ink)
    return painted(axes, page, ink)


def class_bar(
    colors: Floats, names: Sequence[str], height: int, *, title: str, background: Background = BLACK
) -> Floats:
    """Picture of the colors (N, 3) of classes, the first at the bottom, beside their names.

    Where names would overlap, only some are written.
    """

    def ticked(_: Span, most: float) -> dict[float, str]:
        every = math.ceil(len(names) / max(LINES * most, 1.0))
        return {n + 0.5: name for n, name in list(enumerate(names))[::every]}

    span = (0.0, float(len(names)))
    return plain_bar(colors, span, height, title=title, background=background, ticked=ticked)


def with_color_bar(rgba: Floats, bar: Floats, background: Background | None = None) -> Floats:
    """Picture (H, W + B, 4) with a bar (H, B, 4) on its right.

    `rgba`: (H, W, 4) linear, premultiplied. `background`: linear background color of the picture;
    None leaves it transparent.
    """
    if len(rgba) != len(bar):
        raise ValueError(f"a bar of {len(bar)} px does not fit a picture of {len(rgba)} px")
    if background is None:
        return np.concatenate([rgba, bar], axis=1)
    behind = np.ones_like(rgba)
    behind[..., :3] = over(rgba, background)
    return np.concatenate([behind, bar], axis=1)


def check_height(height: int) -> None:
    """Reject a height at which text is illegible."""
    if height < LEAST_HEIGHT:
        raise ValueError(f"a color bar is at least {LEAST_HEIGHT} px high (got {height})")


def check_bar(path: Path, height: int) -> None:
    """Reject a bar that cannot stand beside a picture of this height, before any work is done."""
    if path.suffix.lower() == ".exr":
        raise ValueError(f"{path}: a color bar has no depth; write a .png, or leave it out")
    if height < LEAST_HEIGHT:
        raise ValueError(
            f"a color bar is at least {LEAST_HEIGHT} px high, not {height}; take a larger size"
        )


def ink_on(background: Background) -> str:
    """Color of text that is easy to read on a background."""
    return DARK if np.dot(background, LUMINANCE) > BRIGHT else LIGHT


class BarLayout(NamedTuple):
    """Layout in px from the upper left corner."""

    height: int
    width: int
    type: float  # size of type
    margin: float
    top: float  # of the bar
    bottom: float
    bar: tuple[float, float]  # left and right of the colors
    curve: tuple[float, float]  # left and right of the opacities
    span: Span  # values at the bottom and at the top
    ticks: dict[float, str]
    title: str

    @classmethod
    def of(
        cls, span: Span, height: int, title: str, form: Form, ticked: "Ticked | None" = None
    ) -> "BarLayout":
        """Page just wide enough for its contents."""
        size = float(np.clip(round(4 + 0.017 * height), 8, 36))
        margin = round(0.8 * size)
        shown = title if len(title) <= LONGEST else title[: LONGEST - 1] + "…"
        top = margin + round(1.7 * size if title else 0.3 * size)
        bottom = height - margin - round(1.5 * size)
        if not span[0] < span[1]:  # a single value
            away = max(abs(span[0]), 1.0) / 2
            span = span[0] - away, span[0] + away
        ticks = (ticked or ticks_of)(span, (bottom - top) / (2.5 * size))
        is_wide = form == "plane"
        middle = margin + round(max(0.5 * (bottom - top), 11 * size) if is_wide else 2.2 * size)
        curve: tuple[float, float] = (middle, middle)
        if form == "curve":
            curve = (middle + size // 2, middle + round(7 * size))
        scale = curve[1] + size + max(_length(text, size) for text in ticks.values())
        width = math.ceil(max(scale, margin + _length(shown, size)) + margin)
        bar = (float(margin), float(middle))
        return cls(height, width, size, margin, top, bottom, bar, curve, span, ticks, shown)

    def row(self, value: Any) -> Any:
        """Positions of values, px from the top."""
        low, high = self.span
        return self.bottom - (value - low) / (high - low) * (self.bottom - self.top)

    def values(self, parts: int) -> Doubles:
        """Values at the centers of `parts` equal parts of the bar, from top to bottom."""
        count = round(self.bottom - self.top) * parts
        share = (np.arange(count) + 0.5) / count
        return self.span[1] * (1 - share) + self.span[0] * share


def ticks_of(span: Span, most: float) -> dict[float, str]:
    """Round values within a range, and their labels."""
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


def blank(page: BarLayout, background: Background) -> "Axes":
    """Empty page with coordinates in px."""
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


def show(axes: "Axes", page: BarLayout, linear: Floats, ink: str) -> None:
    """Draw colors (rows, columns, 3) as the bar."""
    left, right = page.bar
    axes.imshow(
        np.round(255 * np.clip(to_srgb(linear), 0, 1)).astype(np.uint8),
        extent=(left, right, page.bottom, page.top),
        aspect="auto",
        interpolation="nearest",
    )
    axes.set_xlim(0, page.width)
    axes.set_ylim(page.height, 0)
    frame(axes, page, page.bar, ink)


def draw_scale(axes: "Axes", page: BarLayout, ink: str) -> None:
    """Draw values beside the bar."""
    right = page.curve[1]
    for place, text in page.ticks.items():
        row = page.row(place)
        axes.plot([right, right + 0.4 * page.type], [row, row], color=ink, lw=thin(page))
        write(axes, page, (right + 0.7 * page.type, row), text, ink, va="center_baseline")


def name(
    axes: "Axes", page: BarLayout, span: tuple[float, float], texts: tuple[str, str, str], ink: str
) -> None:
    """Draw a horizontal axis: its start, name and end."""
    row = page.bottom + 0.4 * page.type
    for x, text, side in zip((span[0], sum(span) / 2, span[1]), texts, SIDES, strict=True):
        write(axes, page, (x, row), text, ink, va="top", ha=side)


def frame(axes: "Axes", page: BarLayout, span: tuple[float, float], ink: str) -> None:
    """Draw a line around the area between two columns of px."""
    left, right = span
    rows = [page.top, page.top, page.bottom, page.bottom, page.top]
    axes.plot([left, right, right, left, left], rows, color=ink, lw=thin(page), alpha=0.7)


def write(
    axes: "Axes", page: BarLayout, place: tuple[float, float], text: str, ink: str, **sides: Any
) -> None:
    """Draw text at a position in px; `sides` are matplotlib's alignments."""
    axes.text(*place, text, fontsize=page.type * POINTS, color=ink, parse_math=False, **sides)


def thin(page: BarLayout) -> float:
    """Width of a fine line, points."""
    return max(1.0, page.type / 14) * POINTS


def painted(axes: "Axes", page: BarLayout, ink: str) -> Floats:
    """Render the page with its title to a picture."""
    write(axes, page, (page.margin, page.margin), page.title, ink, va="top")
    figure: Any = axes.figure
    canvas = figure.canvas
    canvas.draw()
    levels = np.asarray(canvas.buffer_rgba())[..., :3] / np.float32(255)
    picture = np.ones((page.height, page.width, 4), np.float32)
    picture[..., :3] = from_srgb(levels)
    return picture
