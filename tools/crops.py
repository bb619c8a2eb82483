"""Create the enlarged crops of the documentation: `python tools/crops.py`.

Text and lamps are drawn here. With a folder of photographs (`--data`) there are also crops of grass
(scikit-image's camera man, CC0) and of a flower (imagecompression.info, free to redistribute).
"""

import argparse
import sys
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from resample_texture import resize, scale

IMAGES = Path(__file__).parents[1] / "docs" / "images"
LINES = ("The quick brown fox jumps over", "the lazy dog; 0123456789")
PAGE = 88, 300  # px of the drawn text
FACTOR = 1.5
# Times by which photographs are made smaller first; left and top of the crop once enlarged, px.
PHOTOS = {"skimage_camera.png": (1, 345, 696), "flower_foveon.png": (3, 600, 355)}
SIDE, LARGER, GAP = 64, 4, 4  # px of a crop; times by which it is enlarged; px between two
LAMPS = 40  # on a square of 48 px


def text() -> tuple[NDArray[np.uint8], list[NDArray[np.uint8]]]:
    """Dark text, and its halves: of light, and of levels."""
    page = np.full(PAGE, 255, np.uint8)
    for n, line in enumerate(LINES):
        place = (6, 34 + 36 * n)
        cv2.putText(page, line, place, cv2.FONT_HERSHEY_SIMPLEX, 0.55, 0, 1, cv2.LINE_AA)
    return page, [resize(page, 0.5, linear_light=light).image for light in (True, False)]


def ink(page: NDArray[np.uint8]) -> float:
    """How dark a page is, on average, in levels."""
    return float((255.0 - page).mean())


def lamps() -> NDArray[np.uint8]:
    """Small bright lamps in the dark, some of them colored."""
    rng, night = np.random.default_rng(7), np.full((48, 48, 3), 12, np.uint8)
    places, colors = rng.integers(3, 45, (LAMPS, 2)), rng.integers(90, 256, (LAMPS, 3))
    for place, color in zip(places.tolist(), colors.tolist(), strict=True):
        cv2.circle(night, place, 1, color, -1, cv2.LINE_AA)
    return night


def pairs(page: NDArray[np.uint8], data: Path) -> list[list[NDArray[np.uint8]]]:
    """Enlarged photographs, text and lamps: light between texels, as in 0.2.0, and levels."""
    sources = [(np.dstack([page] * 3), (4, 20)), (lamps(), (4, 4))]
    for name, (smaller, *place) in PHOTOS.items():
        photo = np.asarray(Image.open(data / name).convert("RGB"))
        sources.append((resize(photo, 1 / smaller).image, tuple(place)))
    made = [
        scale(image, FACTOR, linear_light=light).image[top : top + SIDE, left : left + SIDE]
        for image, (left, top) in sources
        for light in (True, "pixels")
    ]
    return [made[:4], made[4:]]


def sheet(rows: list[list[NDArray[np.uint8]]]) -> Image.Image:
    """Pictures side by side in rows, each pixel enlarged to a square."""
    lines = []
    for row in rows:
        large = [np.kron(one, np.ones((LARGER, LARGER, 1), np.uint8)) for one in row]
        gap = np.full((large[0].shape[0], GAP, 3), 128, np.uint8)
        lines.append(np.concatenate([large[0], *(x for one in large[1:] for x in (gap, one))], 1))
    gap = np.full((GAP, lines[0].shape[1], 3), 128, np.uint8)
    return Image.fromarray(
        np.concatenate([lines[0], *(x for one in lines[1:] for x in (gap, one))], 0)
    )


def main() -> int:
    """Create the files, and print what the text keeps of its ink."""
    parser = argparse.ArgumentParser(prog="python tools/crops.py", description=__doc__)
    parser.add_argument("--data", type=Path, help="folder of photographs")
    data = parser.parse_args().data
    page, halves = text()
    colors = [np.repeat(half[..., None], 3, axis=2) for half in halves]
    sheet([colors]).save(IMAGES / "text-halved.png", optimize=True)
    for name, half in zip(("light", "levels"), halves, strict=True):
        sys.stdout.write(f"{name}: {100 * ink(half) / ink(page):.0f} % of the ink\n")
    if data is not None:
        sheet(pairs(page, data)).save(IMAGES / "levels.webp", quality=90, method=6)
    return 0


if __name__ == "__main__":
    sys.exit(main())
