"""The picture of limits in notes/quality.md: `python -m tests.benchmarks.limits_picture`."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from resample.measuring.compare import contact_sheet
from resample_texture import warp
from resample_texture.figures.scenes import bricks, checker, means

PICTURE = Path(__file__).parents[2] / "docs/images/limits.png"
ZOOM, SIDE = 8.0, 220
CHOICES = {
    "none": "area-spline:limit=none",
    "range": "area-spline:limit=range",
    "peaks (default)": "area-spline",
    "Catmull-Rom": "catmull-rom",
}


def printed() -> Any:
    """Letters as a camera sees them, linear light."""
    paper = np.full((512, 512), 190, np.uint8)
    for line, word in enumerate(["warp", "both", "ways"]):
        place = (20, 130 + 150 * line)
        cv2.putText(paper, word, place, cv2.FONT_HERSHEY_TRIPLEX, 5.0, 12, 14, cv2.LINE_AA)
    return means(paper[..., None].astype(np.float32) / 255, 16)


def zone_plate() -> Any:
    """Rings from slow to as fast as texels can tell, linear light."""
    y, x = np.mgrid[0:512, 0:512] / 16 - 4
    return means(
        (0.5 + 0.4 * np.cos((x * x + y * y) * np.pi / 34)).astype(np.float32)[..., None], 16
    )


def main() -> None:
    """Draw subjects enlarged and turned a little, with every limit."""
    cosine, sine = ZOOM * np.cos(np.radians(8)), ZOOM * np.sin(np.radians(8))
    matrix = [[cosine, -sine, 20.0], [sine, cosine, -10.0], [0.0, 0.0, 1.0]]
    subjects = {
        "checkerboard": 0.2 + 0.5 * checker(32, 4),
        "print": printed(),
        "zone plate": zone_plate(),
        "wall": means(bricks(), 4)[24:56, 40:72],
    }
    cells = {
        f"{subject}, {title}": warp(
            texels, matrix, (SIDE, SIDE), interpolation=name, edge="mirror"
        ).image
        for subject, texels in subjects.items()
        for title, name in CHOICES.items()
    }
    contact_sheet(cells, PICTURE, columns=len(CHOICES))


if __name__ == "__main__":
    main()
