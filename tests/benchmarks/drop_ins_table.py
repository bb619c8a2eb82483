"""Drop-ins beside the calls that they replace, against the scene: `python -m ... FOLDER`.

Each picture of the folder plays the scene. The source is the mean of its blocks of 4 × 4 px, as a
sensor would see it; the truth is the mean of the scene over each pixel of the target, by 16 × 16
bilinear rays into it. No interpolation kernel is favored: blur, aliasing and misplacement count.
Printed is PSNR in dB of gray levels 0..1, means over the pictures.
"""

import math
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from resample_texture import warp
from resample_texture.like import ndimage as like_ndimage
from resample_texture.like import opencv

FACTOR, RAYS, SIDE = 4, 16, 300
MARGIN = 12  # texels beside the source's edge that are not scored
FLAGS = {"LINEAR": cv2.INTER_LINEAR, "CUBIC": cv2.INTER_CUBIC, "LANCZOS4": cv2.INTER_LANCZOS4}
Picture = NDArray[np.float32]
Matrix = NDArray[np.float64]


def about(angle: float = 0.0, scale: float = 1.0, tilt: float = 0.0) -> Matrix:
    """Source to target about the center: degrees, scale, and a tilt toward a horizon."""
    a, half = math.radians(angle), SIDE / 2
    turn = np.array([[math.cos(a), -math.sin(a), 0], [math.sin(a), math.cos(a), 0], [0, tilt, 1]])
    turn[:2, :2] *= scale
    move = np.array([[1, 0, half], [0, 1, half], [0, 0, 1.0]])
    return np.asarray(move @ turn @ np.linalg.inv(move))


CASES = {
    "shift 1/2": np.array([[1, 0, 0.5], [0, 1, 0.25], [0, 0, 1.0]]),
    "turn 7": about(7),
    "turn 45": about(45),
    "tilted": about(3, 0.95, 6e-4),
    "1 / 1.5": about(2, 1 / 1.5),
    "1 / 3.7": about(2, 1 / 3.7),
    "x 1.5": about(5, 1.5),
    "x 3": about(5, 3.0),
}


def scenes(folder: Path) -> list[Picture]:
    """Gray pictures of the folder that are large enough, cut to a square."""
    side, found = FACTOR * SIDE, []
    for path in sorted(folder.iterdir()):
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if image is not None and min(image.shape) >= side:
            top, left = (image.shape[0] - side) // 2, (image.shape[1] - side) // 2
            square = image[top : top + side, left : left + side].astype(np.float32) / 255
            found.append(np.ascontiguousarray(square))
    return found


def truth(scene: Picture, matrix: Matrix) -> tuple[Picture, NDArray[np.bool_]]:
    """Means of the scene over the target's pixels, and which lie within the source."""
    back, total = np.linalg.inv(matrix), np.zeros((SIDE, SIDE))
    known = np.ones((SIDE, SIDE), np.bool_)
    rows, columns = np.mgrid[:SIDE, :SIDE]
    for ray in range(RAYS * RAYS):
        x, y = columns + (ray % RAYS + 0.5) / RAYS, rows + (ray // RAYS + 0.5) / RAYS
        u, v, w = np.einsum("ij,jkl->ikl", back, np.stack([x, y, np.ones_like(x)]))
        u, v = u / w, v / w
        for place in (u, v):
            known &= (place > MARGIN) & (place < SIDE - MARGIN)
        at = [(FACTOR * place - 0.5).astype(np.float32) for place in (u, v)]
        total += cv2.remap(scene, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    return (total / RAYS**2).astype(np.float32), known


def ways() -> dict[str, Callable[[Picture, Matrix], Picture]]:
    """Calls by name: of a picture and a matrix whose coordinates count from pixel corners."""
    found: dict[str, Callable[[Picture, Matrix], Picture]] = {}
    half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1.0]])

    def of_opencv(module: object, flag: int) -> Callable[[Picture, Matrix], Picture]:
        def call(image: Picture, matrix: Matrix) -> Picture:
            centered = np.linalg.inv(half) @ matrix @ half
            made = module.warpPerspective(  # type: ignore[attr-defined]
                image, centered, (SIDE, SIDE), flags=flag, borderMode=cv2.BORDER_REFLECT
            )
            return np.asarray(made)

        return call

    def of_scipy(module: object, order: int) -> Callable[[Picture, Matrix], Picture]:
        def call(image: Picture, matrix: Matrix) -> Picture:
            back = np.linalg.inv(np.linalg.inv(half) @ matrix @ half)
            rows, columns = np.mgrid[:SIDE, :SIDE].astype(np.float64)
            u, v, w = np.einsum("ij,jkl->ikl", back, np.stack([columns, rows, np.ones_like(rows)]))
            made = module.map_coordinates(  # type: ignore[attr-defined]
                image, np.stack([v / w, u / w]), order=order, mode="reflect"
            )
            return np.asarray(made)

        return call

    for name, flag in FLAGS.items():
        found[f"cv2 {name}"] = of_opencv(cv2, flag)
        found[f"like.opencv {name}"] = of_opencv(opencv, flag)
    for order in (1, 3, 5):
        found[f"scipy order {order}"] = of_scipy(ndimage, order)
        found[f"like.ndimage order {order}"] = of_scipy(like_ndimage, order)
    found["warp"] = lambda image, matrix: np.asarray(
        warp(image, matrix, (SIDE, SIDE), edge="mirror").image
    )
    return found


def main(folder: Path) -> None:
    """Print the table of a folder of photographs."""
    pictures = scenes(folder)
    if not pictures:
        sys.exit(f"{folder} holds no picture of {FACTOR * SIDE} x {FACTOR * SIDE} px or more")
    sources = [cv2.resize(one, (SIDE, SIDE), interpolation=cv2.INTER_AREA) for one in pictures]
    truths = {name: [truth(one, matrix) for one in pictures] for name, matrix in CASES.items()}
    head = f"{len(pictures)} pictures\n\n| | {' | '.join(CASES)} |\n|{'---|' * (len(CASES) + 1)}\n"
    sys.stdout.write(head)
    for name, way in ways().items():
        cells = []
        for case, matrix in CASES.items():
            errors = [
                np.square(way(image, matrix) - wanted)[known].mean()
                for image, (wanted, known) in zip(sources, truths[case], strict=True)
            ]
            cells.append(f"{np.mean([-10 * math.log10(error) for error in errors]):.2f}")
        sys.stdout.write(f"| {name} | {' | '.join(cells)} |\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
