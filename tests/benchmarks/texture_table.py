"""The tables of docs/quality.md on texture: `python -m tests.benchmarks.texture_table [TABLE]`.

The workload is the floor of `shared/bench/texture_floor.py`: its geometry, pictures, truths, zones
and score. Where it is absent there is nothing to measure.
"""

import sys
import time
from collections.abc import Callable, Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from resample.measuring.compare import plain
from resample_texture import Homography, warp
from resample_texture.types import Warped

BENCH = Path(__file__).parents[2] / "../shared/bench"
NATURAL = ("astronaut", "brick")
SIZE = (512, 512)
RUNS = 7

Row = dict[str, object]

OURS: list[tuple[str, dict[str, Any]]] = [
    ("hybrid, quality 1", {"quality": 1.0}),
    ("hybrid", {}),
    ("hybrid, quality 2", {"quality": 2.0}),
    ("hybrid, quality 3", {"quality": 3.0}),
    ("hybrid, spline, quality 2", {"quality": 2.0, "interpolation": "spline"}),
    ("hybrid, spline, quality 4", {"quality": 4.0, "interpolation": "spline"}),
    ("hybrid, bilinear, quality 2", {"quality": 2.0, "interpolation": "bilinear"}),
    ("hybrid, splats", {"method": "hybrid:magnified=splats"}),
    ("hybrid, Gaussian, quality 1", {"filter": "gaussian", "quality": 1.0}),
    ("hybrid, Gaussian", {"filter": "gaussian"}),
    ("hybrid, Gaussian, quality 2", {"filter": "gaussian", "quality": 2.0}),
    ("hybrid, Gaussian, quality 3", {"filter": "gaussian", "quality": 3.0}),
    (
        "hybrid, Gaussian, spline, quality 2",
        {"filter": "gaussian", "quality": 2.0, "interpolation": "spline"},
    ),
    ("hybrid, Gaussian, splats", {"method": "hybrid:magnified=splats", "filter": "gaussian"}),
    ("paper", {"method": "paper"}),
    ("points", {"method": "points"}),
]
RIVALS: list[tuple[str, dict[str, Any]]] = [
    ("OpenCV bilinear", {"method": "bilinear", "edge": "clamp"}),
    ("OpenCV 4x4 linear", {"method": "opencv-supersample:n=4,kernel=linear", "edge": "clamp"}),
    ("OpenCV 8x8 cubic", {"method": "opencv-supersample:n=8", "edge": "clamp"}),
    ("anisotropic, 16 taps", {"method": "anisotropic", "edge": "clamp"}),
    ("OpenImageIO mitchell", {"method": "oiio:filter=mitchell", "edge": "clamp"}),
]


@cache
def floor() -> Any:
    """The workload."""
    sys.path.insert(0, str(BENCH.resolve()))
    return import_module("texture_floor")


@cache
def truth(name: str, yaw: bool = False, bilinear: bool = False) -> tuple[Any, Any]:
    """Box and Gauss truth of a picture."""
    bench = floor()
    matrix = bench.H_floor_yaw() if yaw else bench.H_floor()
    recon = 9 if name == "chirp" else 1 if bilinear else 3
    box, gauss = bench.truth(bench.image(name), matrix, recon=recon)
    return box, gauss


def picture(name: str, channels: int = 1) -> Any:
    gray = floor().image(name).astype(np.float32)
    return gray if channels == 1 else np.repeat(gray[..., None], channels, axis=2)


def decibels(
    name: str, choices: dict[str, Any], *, yaw: bool = False, bilinear: bool = False
) -> dict[str, tuple[float, float]]:
    """PSNR per zone against both truths."""
    bench = floor()
    matrix = bench.H_floor_yaw() if yaw else bench.H_floor()
    warped = warp(picture(name), matrix, SIZE, **choices)
    score: dict[str, tuple[float, float]] = bench.score(
        warped.image.astype(float), matrix, *truth(name, yaw, bilinear)
    )
    return score


def milliseconds(run: Callable[[], Warped]) -> float:
    """Median time of a warm run."""
    run()
    times = []
    for _ in range(RUNS):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return 1e3 * float(np.median(times))


def natural() -> Iterator[Row]:
    """Mean of astronaut and brick, per zone; checkerboard and chirp in the whole frame."""
    matrix = floor().H_floor()
    for title, choices in [*OURS, *RIVALS]:
        scores = [decibels(name, choices) for name in NATURAL]
        zones = {
            zone: [np.mean([score[zone][n] for score in scores]) for n in (0, 1)]
            for zone in scores[0]
        }
        checker, chirp = decibels("checker", choices)["all"], decibels("chirp", choices)["all"]
        gray, color = (picture("brick", channels) for channels in (1, 3))
        yield {
            "method": title,
            "box min": f"{zones['min'][0]:.1f}",
            "mag": f"{zones['mag'][0]:.1f}",
            "all": f"{zones['all'][0]:.1f}",
            "Gauss all": f"{zones['all'][1]:.1f}",
            "checker box / Gauss": f"{checker[0]:.1f} / {checker[1]:.1f}",
            "chirp box / Gauss": f"{chirp[0]:.1f} / {chirp[1]:.1f}",
            "ms": f"{milliseconds(lambda: warp(gray, matrix, SIZE, **choices)):.1f}",  # noqa: B023
            "RGB": f"{milliseconds(lambda: warp(color, matrix, SIZE, **choices)):.1f}",  # noqa: B023
        }


def turned() -> Iterator[Row]:
    """The texture turned by 30 degrees, and the truth with bilinear interpolation."""
    for title, choices in [*OURS, *RIVALS]:
        yaw = decibels("astronaut", choices, yaw=True)["all"]
        linear = [decibels(name, choices, bilinear=True)["all"] for name in NATURAL]
        yield {
            "method": title,
            "turned, astronaut box": f"{yaw[0]:.1f}",
            "Gauss": f"{yaw[1]:.1f}",
            "bilinear truth, natural box": f"{np.mean([each[0] for each in linear]):.1f}",
        }


def flicker() -> Iterator[Row]:
    """Mean over the minified half of the standard deviation of errors over 16 shifts, × 1e-3."""
    bench = floor()
    mask = bench.zones(bench.H_floor())["minhalf"]
    source = bench.image("checker")
    shifts = bench.cam_shifts()
    truths = [bench.truth(source, bench.H_floor(*shift)) for shift in shifts]
    for title, choices in [*OURS, *RIVALS]:
        errors: list[list[Any]] = [[], []]
        for shift, pair in zip(shifts, truths, strict=True):
            image = warp(source.astype(np.float32), bench.H_floor(*shift), SIZE, **choices).image
            for n in (0, 1):
                errors[n].append(image - pair[n])
        values = [1e3 * np.std(each, axis=0)[mask].mean() for each in errors]
        yield {"method": title, "box": f"{values[0]:.2f}", "Gauss": f"{values[1]:.2f}"}


def coverage() -> Iterator[Row]:
    """Errors of a quad's coverage against 32 × 32 points per pixel, in pixels that edges cut."""
    quad = [(20, 15), (110, 30), (100, 105), (8, 90)]
    for name, side in (("minified", 512), ("magnified", 32)):
        matrix = floor().quad_h([(0, 0), (side, 0), (side, side), (0, side)], quad)
        exact = inside(matrix, side, 128, 32)
        edge = (exact > 0) & (exact < 1)
        white = np.ones((side, side), np.float32)
        for title, choices in [*OURS[:4], *RIVALS]:
            options = {**choices, "edge": "transparent"}
            error = (warp(white, matrix, (128, 128), **options).coverage - exact)[edge]
            yield {
                "quad": name,
                "method": title,
                "rms": f"{np.sqrt(np.mean(error**2)):.5f}",
                "largest": f"{np.abs(error).max():.4f}",
            }


def inside(matrix: Any, side: int, size: int, points: int) -> Any:
    """Share of each pixel that shows a source of side × side texels."""
    inverse = Homography(matrix).inverse()
    y, x = (np.mgrid[0 : size * points, 0 : size * points] + 0.5) / points
    d = inverse[2, 0] * x + inverse[2, 1] * y + inverse[2, 2]
    u, v = ((inverse[n, 0] * x + inverse[n, 1] * y + inverse[n, 2]) / d for n in (0, 1))
    hit = (u >= 0) & (v >= 0) & (u <= side) & (v <= side)
    return hit.reshape(size, points, size, points).mean(axis=(1, 3))


def large() -> Iterator[Row]:
    """A source of 4096² texels (brick and noise) on the same floor, box truth at 32 × 32."""
    import cv2

    bench = floor()
    noise = 0.03 * np.random.default_rng(7).standard_normal((4096, 4096))
    source = cv2.resize(bench.image("brick"), (4096, 4096), interpolation=cv2.INTER_CUBIC) + noise
    source = np.clip(source, 0.0, 1.0)
    matrix = bench.H_floor() @ np.diag([0.25, 0.25, 1.0])
    box, gauss = bench.truth(source, matrix, ss=32)
    texels = source.astype(np.float32)
    for title, choices in [*OURS[:4], *RIVALS[:4]]:
        image = warp(texels, matrix, SIZE, **choices).image
        score = bench.score(image.astype(float), bench.H_floor(), box, gauss)["all"][0]
        time_ms = milliseconds(lambda: warp(texels, matrix, SIZE, **choices))  # noqa: B023
        yield {"method": title, "box, whole": f"{score:.1f}", "ms": f"{time_ms:.1f}"}


def horizon() -> Iterator[Row]:
    """Time with the horizon at row 100 of the frame, beside that without."""
    bench = floor()
    gray = picture("checker")
    for title, choices in [OURS[1], *RIVALS[:4]]:
        times = [
            milliseconds(lambda: warp(gray, matrix, SIZE, **choices))  # noqa: B023
            for matrix in (bench.H_floor(), bench.T(0, 176) @ bench.H_floor())
        ]
        yield {"method": title, "ms without": f"{times[0]:.1f}", "ms with": f"{times[1]:.1f}"}


TABLES = {
    "natural": natural,
    "turned": turned,
    "flicker": flicker,
    "coverage": coverage,
    "large": large,
    "horizon": horizon,
}


def main() -> None:
    if not BENCH.is_dir():
        sys.exit(f"the workload is not here: {BENCH}")
    for name in sys.argv[1:] or TABLES:
        sys.stdout.write(f"\n{name}: {TABLES[name].__doc__}\n{plain(list(TABLES[name]()))}")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
