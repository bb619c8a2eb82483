"""The picture of turns in notes/quality.md: `python -m tests.benchmarks.turned_picture DATA`."""

import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from resample.files.pictures import read_picture
from resample.measuring.compare import contact_sheet
from resample_texture import warp
from resample_texture.geometry.matrices import turning

PICTURE = Path(__file__).parents[2] / "docs/images/turned.png"
DEGREES, SIDE, ZOOM = 7.0, 56, 4
PLACES = {  # row and column of what is shown
    "grass": ("kodim19.png", 612, 196),
    "fence": ("kodim19.png", 480, 300),
    "print": ("skimage_page.png", 66, 120),
}
METHODS = {"OpenCV linear": "bilinear", "OpenCV lanczos4": "lanczos4", "hybrid": "hybrid"}


def zone_plate() -> Any:
    """Rings up to the finest that texels hold, as their means, linear light."""
    y, x = (np.mgrid[0:4096, 0:4096] + 0.5) / 16 - 128
    rings = 0.5 + 0.45 * np.cos((x * x + y * y) * np.pi / 256)
    return rings.reshape(256, 16, 256, 16, 1).mean(axis=(1, 3)).astype(np.float32)


def turned_back(image: Any, method: str) -> Any:
    """Picture turned, and turned back."""
    shape = image.shape[:2]
    there, back = (turning(shape, angle, shape) for angle in (DEGREES, -DEGREES))
    once = warp(image, there, shape, method, edge="mirror").image
    return warp(once, back, shape, method, edge="mirror").image


def cropped(image: Any, row: int, column: int) -> Any:
    """Part of a picture, enlarged texel by texel."""
    part = image[row : row + SIDE, column : column + SIDE]
    large = cv2.resize(part, None, fx=ZOOM, fy=ZOOM, interpolation=cv2.INTER_NEAREST)
    return large.reshape(SIDE * ZOOM, SIDE * ZOOM, -1)


def main(data: Path) -> None:
    """Draw subjects as they are, and after two turns by each method."""
    subjects = {
        name: (read_picture(data / file).data, (row, column))
        for name, (file, row, column) in PLACES.items()
    }
    subjects["zone plate"] = zone_plate(), (100, 16)
    cells = {}
    for name, (image, place) in subjects.items():
        cells[name] = cropped(image, *place)
        for title, method in METHODS.items():
            cells[f"{name}, {title}"] = cropped(turned_back(image, method), *place)
    contact_sheet(cells, PICTURE, columns=1 + len(METHODS))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
