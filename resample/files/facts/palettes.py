"""Pictures whose pixels are numbers of colors in a palette, as PNG, GIF and TIFF store them."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.files.facts.chunks import PNG_START
from resample.files.facts.metadata import TIFF
from resample.files.facts.tags import Tag, read_tags
from resample.reading.limits import check_unpacked
from resample.reading.pictures import decoding

PNG_OF_PALETTE, TIFF_OF_PALETTE = 3, 3  # the formats' numbers for it
PHOTOMETRIC = 262  # a tag of TIFF
MOST = 256  # colors of a palette


class Palette(NamedTuple):
    """Colors by number."""

    colors: NDArray[np.uint8]  # (N, 3) sRGB
    opacity: NDArray[np.uint8]  # (N,)

    @property
    def clear(self) -> int | None:
        """Number of the first color that is transparent; None if all are visible."""
        found = np.flatnonzero(self.opacity == 0)
        return int(found[0]) if found.size else None

    def with_clear(self) -> "Palette":
        """Return a palette with one more color, which is transparent."""
        colors = np.concatenate([self.colors, np.zeros((1, 3), np.uint8)])
        return Palette(colors, np.append(self.opacity, np.uint8(0)))


def has_palette(path: Path) -> bool:
    """Whether a file is a picture with a palette; of GIF, one that may be an animation."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        head = file.read(26)
    if head[:8] == PNG_START:
        return head[25:26] == bytes([PNG_OF_PALETTE])
    if path.suffix.lower() in TIFF:
        tag = next((page.get(PHOTOMETRIC) for page in read_tags(path, (PHOTOMETRIC,), {})), None)
        return isinstance(tag, Tag) and int(tag.values[0]) == TIFF_OF_PALETTE
    return head[:4] == b"GIF8"


def read_indices(path: Path) -> tuple[NDArray[np.uint8], Palette] | None:
    """Read numbers (H, W) as stored, and their palette; None if Pillow has none of them."""
    from PIL import Image

    with decoding(path), Image.open(path) as image:
        check_unpacked(str(path), path.stat().st_size, 2 * image.width * image.height)
        if image.mode != "P":
            return None
        index = np.array(image)
        colors = np.array(image.getpalette("RGB"), np.uint8).reshape(-1, 3)
        told: Any = image.info.get("transparency", b"")
    count = max(len(colors), int(index.max(initial=0)) + 1)
    colors = np.concatenate([colors, np.zeros((count - len(colors), 3), np.uint8)])
    opacity = np.full(count, 255, np.uint8)
    if isinstance(told, int):
        opacity[told : told + 1] = 0
    else:
        given = np.frombuffer(told[:count], np.uint8)
        opacity[: len(given)] = given
    return index, Palette(colors, opacity)


def write_indices(path: Path, index: NDArray[np.uint8], palette: Palette, **texts: str) -> None:
    """Write numbers (H, W) and their palette as .png, with texts, or .tif."""
    from PIL import Image, PngImagePlugin

    height, width = index.shape
    image = Image.frombytes("P", (width, height), np.ascontiguousarray(index).tobytes())
    image.putpalette(palette.colors.tobytes())
    if path.suffix.lower() in TIFF:
        image.save(path, compression="tiff_adobe_deflate")
        return
    words = PngImagePlugin.PngInfo()
    for key, text in texts.items():
        words.add_text(key, text)
    is_opaque = bool((palette.opacity == 255).all())
    choices: dict[str, Any] = {} if is_opaque else {"transparency": palette.opacity.tobytes()}
    image.save(path, pnginfo=words, **choices)
