"""Text as pixel coverage, and drawn on pictures of any background."""

import numpy as np

from resample.types import Floats

FONT = "DejaVu Sans"  # part of matplotlib
LIGHT, DARK = 0.9, 0.02  # linear gray of letters and bars, and of their outline
AROUND = 1  # px


def letters(text: str, size: int) -> Floats:
    """Return the pixel coverage (h, w) of a line of text; `size` is its font size in px."""
    from matplotlib.font_manager import findfont
    from matplotlib.ft2font import FT2Font

    font = FT2Font(findfont(FONT))
    font.set_size(size, 72)
    font.set_text(text, 0.0)
    font.draw_glyphs_to_bitmap(antialiased=True)
    return np.asarray(font.get_image(), np.float32) / np.float32(255)


def type_size(height: int, width: int) -> int:
    """Return the font size for a picture, px."""
    return max(9, round(0.035 * min(height, width)))


def put_mask(rgba: Floats, mask: Floats, left: int, top: int, *, is_dark: bool = False) -> None:
    """Draw light letters or bars with a dark outline on a premultiplied picture, or vice versa.

    They are clipped at its edges.
    """
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
