"""Color bars with opacities, beside a picture of a volume."""

from typing import TYPE_CHECKING

import numpy as np

from resample.colors import Background, to_srgb
from resample.console import Color
from resample.measuring.color_bars import (
    BLACK,
    BarLayout,
    Form,
    blank,
    check_height,
    draw_scale,
    frame,
    ink_on,
    name,
    painted,
    show,
    thin,
    with_color_bar,
)
from resample.painting.choices import MEASURING, Projection
from resample.resampler import Resampler
from resample.types import Floats, Frame
from resample_volume.classification.scales import scale_named
from resample_volume.classification.transfer import (
    DataRange,
    Transfer,
    TransferFunction,
    from_points,
)
from resample_volume.classification.value_statistics import survey
from resample_volume.multivolume.appearance import Appearance, VolumeLayer, transfer_of
from resample_volume.multivolume.xrays import AS_IT_IS, Tone, negative
from resample_volume.types import Volume

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FINE = 8  # sub-rows per px over which colors are averaged, so that no step is missed
FAIR = 2  # the same where colors also vary across
PURE = 0.3  # share of a bar that shows opaque colors
FORMS: tuple[Form, Form] = ("curve", "plane")  # of functions of values, and of gradients too
GRAYS = from_points([(0.0, (0.0,) * 3, 1.0), (1.0, (1.0,) * 3, 1.0)], normalized=True)
SQUARES = (0.16, 0.42)  # linear gray of the checkerboard


def color_bar(
    transfer: Transfer,
    data_range: DataRange,
    height: int,
    *,
    title: str = "",
    steep: float = 1.0,
    background: Background = BLACK,
    scale: str = "",
) -> Floats:
    """Draw a transfer function with a scale of data values.

    Colors lie over a checkerboard that shows through transparent ones. On the left they are opaque,
    since faint ones could not be told apart; on the right opacity is drawn as a curve. Functions of
    value and gradient are drawn over both axes instead.

    `height`: of the picture, px, at least 64. `steep`: slope of a full surface, see
    `resample_volume.voxels.visible.steepness`. 1 shows the gradients of a normalized function as
    fractions. Result: (H, B, 4) linear, opaque. The width B follows from the height and the text.
    """
    check_height(height)
    by, form = scale_named(scale), FORMS[transfer.needs_gradient]
    page = BarLayout.of(data_range, height, title, form, None if by is None else by.ticks)
    ink = ink_on(background)
    axes = blank(page, background)
    if transfer.needs_gradient:
        _draw_plane(axes, page, transfer, (data_range, steep), ink)
    else:
        # Draw colors by value, and the curve of opacities
        value = page.values(FINE)
        color, opacity = transfer.classify(value, None, data_range, 0.0)
        across = round(page.bar[1] - page.bar[0])
        colors = np.repeat(color.reshape(-1, FINE, 1, 3), across, axis=2)
        shares = np.repeat(opacity.reshape(-1, FINE, 1), across, axis=2)
        pure = shares[..., : round(PURE * across)]
        pure[pure > 0] = 1.0
        _show_over_squares(axes, page, colors, shares, ink)
        left, right = page.curve
        row = page.row(value)
        for place in page.ticks:
            axes.plot(page.curve, [page.row(place)] * 2, color=ink, lw=thin(page), alpha=0.25)
        axes.fill_betweenx(row, left, left + opacity * (right - left), color=ink, alpha=0.3, lw=0)
        axes.plot(left + opacity * (right - left), row, color=ink, lw=2 * thin(page))
        frame(axes, page, page.curve, ink)
        name(axes, page, page.curve, ("0", "opacity", "1"), ink)
    draw_scale(axes, page, ink)
    return painted(axes, page, ink)


def _draw_plane(
    axes: "Axes",
    page: BarLayout,
    transfer: Transfer,
    extent: tuple[DataRange, float],
    ink: str,
) -> None:
    """Draw colors by value and gradient."""
    data_range, steep = extent
    end = (transfer.steepest(steep) or steep) * (1.0 if transfer.normalized else 1.25)
    value, across = page.values(FAIR), round(page.bar[1] - page.bar[0])
    slope = (np.arange(across) + 0.5) / across * end
    values, slopes = np.repeat(value, across), np.tile(slope.astype(np.float32), value.size)
    color, opacity = transfer.classify(values, slopes, data_range, steep)
    shape = (value.size // FAIR, FAIR, across)
    _show_over_squares(axes, page, color.reshape(*shape, 3), opacity.reshape(shape), ink)
    name(axes, page, page.bar, ("0", "gradient", f"{end:.3g}"), ink)


def _show_over_squares(
    axes: "Axes", page: BarLayout, color: Floats, opacity: Floats, ink: str
) -> None:
    """Composite colors (rows, parts, columns, 3) over the checkerboard."""
    rows, _, columns = opacity.shape
    side = max(3, round(0.5 * page.type))
    row, column = np.indices((rows, columns)) // side
    squares = np.where((row + column) % 2, *SQUARES)[:, np.newaxis, :, np.newaxis]
    share = opacity[..., np.newaxis]
    linear = (share * color + (1 - share) * squares).mean(axis=1)
    show(axes, page, linear, ink)


def bar_of(
    medium: VolumeLayer, resampler: Resampler, height: int, background: Color | None, tone: Tone,
    frame: Frame | None = None,
) -> Floats:  # fmt: skip
    """Draw the bar of colors, opacities and values, or of the sums of a frame, of a volume.

    Result: (height, B, 4) linear, opaque.
    """
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
        transfer = transfer_of(volume, appearance, resampler.projection)
        extent = survey(volume).span
        if resampler.projection in MEASURING and isinstance(transfer, TransferFunction):
            extent = extent if transfer.normalized else (transfer.value[0], transfer.value[-1])
    if tone.is_negative:
        # Displayed colors with black and white swapped, over black.
        value = np.linspace(*extent, 256)
        color, opacity = transfer.classify(value, None, extent, 0.0)
        swapped = to_srgb(negative(color * opacity[:, np.newaxis]))
        transfer = TransferFunction(value, swapped, np.ones(value.size))
    behind = background or (0.0, 0.0, 0.0)
    return color_bar(transfer, extent, height, title=volume.name, background=behind, scale=scale)


def with_bar(
    frame: Frame,
    volume: Volume,
    appearance: Appearance,
    resampler: Resampler,
    background: Color | None,
    tone: Tone = AS_IT_IS,
) -> Frame:
    """Add the bar of a volume to the right of its picture."""
    bar = bar_of((volume, appearance), resampler, len(frame.rgba), background, tone, frame)
    return frame._replace(rgba=with_color_bar(frame.rgba, bar, background))
