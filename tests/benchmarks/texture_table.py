"""The tables of notes/quality.md on texture: `python -m tests.benchmarks.texture_table [TABLE]`.

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
from resample_texture import BackwardMap, Homography, warp
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
    ("hybrid, no limits", {"interpolation": "area-spline:limit=none"}),
    ("hybrid, limits of range", {"interpolation": "area-spline:limit=range"}),
    ("hybrid, degree 3", {"interpolation": "area-spline:degree=3"}),
    ("hybrid, degree 5", {"interpolation": "area-spline:degree=5"}),
    ("hybrid, Lanczos", {"interpolation": "lanczos"}),
    ("hybrid, quintic spline", {"interpolation": "spline:degree=5"}),
    ("hybrid, Catmull-Rom", {"interpolation": "catmull-rom"}),
    ("hybrid, bilinear", {"interpolation": "bilinear"}),
    ("hybrid, splats", {"method": "hybrid:magnified=splats"}),
    ("hybrid, Gaussian, quality 1", {"filter": "gaussian", "quality": 1.0}),
    ("hybrid, Gaussian", {"filter": "gaussian"}),
    ("hybrid, Gaussian, quality 2", {"filter": "gaussian", "quality": 2.0}),
    ("hybrid, Gaussian, quality 3", {"filter": "gaussian", "quality": 3.0}),
    ("hybrid, Gaussian, splats", {"method": "hybrid:magnified=splats", "filter": "gaussian"}),
    ("paper", {"method": "paper"}),
    ("points", {"method": "points"}),
]
BASELINES: list[tuple[str, dict[str, Any]]] = [
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
    for title, choices in [*OURS, *BASELINES]:
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
    for title, choices in [*OURS, *BASELINES]:
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
    for title, choices in [*OURS, *BASELINES]:
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
        for title, choices in [*OURS[:4], *BASELINES]:
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
    for title, choices in [*OURS[:4], *BASELINES[:4]]:
        image = warp(texels, matrix, SIZE, **choices).image
        score = bench.score(image.astype(float), bench.H_floor(), box, gauss)["all"][0]
        time_ms = milliseconds(lambda: warp(texels, matrix, SIZE, **choices))  # noqa: B023
        yield {"method": title, "box, whole": f"{score:.1f}", "ms": f"{time_ms:.1f}"}


def horizon() -> Iterator[Row]:
    """Time with the horizon at row 100 of the frame, beside that without."""
    bench = floor()
    gray = picture("checker")
    for title, choices in [OURS[1], *BASELINES[:4]]:
        times = [
            milliseconds(lambda: warp(gray, matrix, SIZE, **choices))  # noqa: B023
            for matrix in (bench.H_floor(), bench.T(0, 176) @ bench.H_floor())
        ]
        yield {"method": title, "ms without": f"{times[0]:.1f}", "ms with": f"{times[1]:.1f}"}


def scene() -> Iterator[Row]:
    """PSNR against the scene itself, of which source and truth are both area means."""
    floor()  # finds the folder
    bench = import_module("scene_truth")

    def ours(choices: dict[str, Any]) -> Callable[..., Any]:
        options = {"edge": "mirror", "linear_light": False, **choices}
        return lambda texels, matrix, size: warp(texels, matrix, size[::-1], **options).image

    flags = {"linear": 1, "cubic": 2, "lanczos4": 4}
    methods = {f"OpenCV {name}": bench.opencv(flag) for name, flag in flags.items()}
    methods |= {
        f"OpenCV 8x8 {name}": bench.opencv(flags[name], 8) for name in ("cubic", "lanczos4")
    }
    methods |= {title: ours(choices) for title, choices in OURS if "filter" not in choices}
    for title, row in bench.table(methods).items():
        yield {"method": title, **{case: f"{value:.2f}" for case, value in row.items()}}


def barrel(x: Any, y: Any) -> tuple[Any, Any]:
    """Places of a source that a barrel's picture shows; pictures are from -1 to 1."""
    bend = 1.0 - 0.22 * (x * x + y * y) + 0.04 * (x * x + y * y) ** 2
    return x * bend, y * bend


def fisheye(x: Any, y: Any) -> tuple[Any, Any]:
    """Places in a pinhole's picture, 100 degrees wide, of a fisheye's as wide, equidistant."""
    angle = np.hypot(x, y) * np.radians(50)
    bend = (
        np.tan(np.minimum(angle, 1.4)) / np.maximum(np.hypot(x, y), 1e-9) / np.tan(np.radians(50))
    )
    return x * bend, y * bend


def waves(x: Any, y: Any) -> tuple[Any, Any]:
    """Places that a smooth flow of a few pixels comes from."""
    return x + 0.02 * np.sin(7 * y) + 0.01 * np.cos(11 * x), y + 0.02 * np.sin(9 * x)


def maps() -> Iterator[Row]:
    """Backward maps against the scene, as in `scene`: dB, mean of two pictures."""
    floor()  # finds the folder
    bench = import_module("scene_truth")
    side, rays, factor = bench.SIDE, 16, bench.FACTOR
    half = side / 2
    seen = {name: (bench.scene(name), bench.source(bench.scene(name))) for name in bench.PICTURES}
    rows: dict[str, Row] = {title: {"method": title} for title, _ in MAPPERS}
    for case in (barrel, fisheye, waves):
        y, x = ((np.mgrid[0 : side * rays, 0 : side * rays] + 0.5) / rays - half) / half
        u, v = (half * place + half for place in case(x, y))
        known = (np.minimum(u, v) > 8) & (np.maximum(u, v) < side - 8)
        known = known.reshape(side, rays, side, rays).all(axis=(1, 3))
        middles = ((np.mgrid[0:side, 0:side] + 0.5) - half) / half
        places = BackwardMap(*(half * p + half for p in case(middles[1], middles[0])))
        truths = {
            name: read_between(large, u * factor, v * factor).reshape(side, rays, side, rays)
            for name, (large, _) in seen.items()
        }
        for title, method in MAPPERS:
            found = [
                psnr(
                    warp(source, places, (side, side), method, edge="mirror").image,
                    truths[name].mean(axis=(1, 3)),
                    known,
                )
                for name, (_, source) in seen.items()
            ]
            rows[title][case.__name__] = f"{np.mean(found):.2f}"
    yield from rows.values()


MAPPERS = [
    ("OpenCV linear", "bilinear"),
    ("OpenCV cubic", "cubic"),
    ("OpenCV lanczos4", "lanczos4"),
    ("OpenCV 8x8 cubic", "opencv-supersample:n=8"),
    ("hybrid", "hybrid"),
]


def read_between(picture: Any, u: Any, v: Any) -> Any:
    """Values between texels, bilinear."""
    import cv2

    rows = [
        cv2.remap(picture, np.float32(a - 0.5), np.float32(b - 0.5), cv2.INTER_LINEAR)
        for a, b in zip(np.array_split(u, 8), np.array_split(v, 8), strict=True)
    ]
    return np.concatenate(rows)


def trips() -> Iterator[Row]:
    """Four photographs turned by 7 degrees and back, and 36 times by 10 degrees.

    PSNR in a disc, the Laplacian's variance after one turn beside that of the picture, and PSNR of
    a picture 30 times smaller against its means.
    """
    for title, choices in [*TRIPS, *((f"hybrid, {name}", each) for name, each in KERNELS)]:
        there, around, sharp, small = [], [], [], []
        for name in PHOTOGRAPHS:
            photograph = gray_photograph(name)
            disc = np.hypot(*(np.mgrid[:512, :512] - 255.5)) < 216
            turned = one_turn(photograph, 7.0, choices)
            there.append(psnr(one_turn(turned, -7.0, choices), photograph, disc))
            sharp.append(laplacian(turned, disc) / laplacian(photograph, disc))
            picture = photograph
            for _ in range(36):
                picture = one_turn(picture, 10.0, choices)
            around.append(psnr(picture, photograph, disc))
            part = photograph[:510, :510]
            means = part.reshape(17, 30, 17, 30).mean(axis=(1, 3))
            shrunk = run(part, np.diag([1 / 30, 1 / 30, 1.0]), (17, 17), choices)
            small.append(psnr(shrunk, means, np.ones((17, 17), bool)))
        yield {
            "method": title,
            "there and back": f"{np.mean(there):.1f}",
            "36 turns": f"{np.mean(around):.1f}",
            "Laplacian": f"{np.mean(sharp):.2f}",
            "30 times smaller": f"{np.mean(small):.1f}",
        }


PHOTOGRAPHS = ("skimage_astronaut", "skimage_camera", "kodim19", "waterloo_barbara")
KERNELS: list[tuple[str, Any]] = [
    ("default", {}),
    ("no limits", {"interpolation": "area-spline:limit=none"}),
    ("limits of range", {"interpolation": "area-spline:limit=range"}),
    ("degree 3", {"interpolation": "area-spline:degree=3"}),
    ("degree 5", {"interpolation": "area-spline:degree=5"}),
    ("Lanczos", {"interpolation": "lanczos"}),
    ("quintic spline", {"interpolation": "spline:degree=5"}),
    ("Catmull-Rom", {"interpolation": "catmull-rom"}),
]
TRIPS: list[tuple[str, Any]] = [("OpenCV linear", 1), ("OpenCV cubic", 2), ("OpenCV lanczos4", 4)]


@cache
def gray_photograph(name: str) -> Any:
    """Its upper left 512² px, 0..1, as encoded."""
    import cv2

    file = BENCH / "../data/textures" / f"{name}.png"
    return cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)[:512, :512].astype(np.float32) / 255


def run(picture: Any, matrix: Any, shape: tuple[int, int], choices: Any) -> Any:
    """Picture warped by OpenCV, if choices are one of its flags, or by the hybrid."""
    import cv2

    if isinstance(choices, dict):
        return warp(picture, matrix, shape, edge="mirror", **choices).image
    center = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
    theirs = np.linalg.inv(center) @ matrix @ center
    return cv2.warpPerspective(
        picture, theirs, shape[::-1], flags=choices, borderMode=cv2.BORDER_REFLECT
    )


def one_turn(picture: Any, degrees: float, choices: Any) -> Any:
    """Picture turned about its middle."""
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    move = np.array([[1.0, 0.0, 256.0], [0.0, 1.0, 256.0], [0.0, 0.0, 1.0]])
    return run(picture, move @ turn @ np.linalg.inv(move), picture.shape, choices)


def psnr(found: Any, truth: Any, where: Any) -> float:
    error = (found.astype(np.float64) - truth)[where]
    return float(-10 * np.log10(max(np.mean(error**2), 1e-14)))


def laplacian(picture: Any, where: Any) -> float:
    """Variance of the Laplacian, a measure of sharpness."""
    import cv2

    return float(cv2.Laplacian(picture.astype(np.float64), cv2.CV_64F)[where].var())


def own() -> Iterator[Row]:
    """The floor against 16 × 16 rays through the same reconstruction, and time beside OpenCV's.

    PSNR is that of the linear reconstruction, times those of the default, which has limits.
    """
    bench = floor()
    for turn, matrix in (("straight", bench.H_floor()), ("turned", bench.H_floor_yaw())):
        zones = bench.zones(matrix)
        for name in NATURAL:
            exact = through_area_spline(bench.image(name), matrix)
            linear = {"interpolation": "area-spline:limit=none"}
            texels = picture(name)
            eight = {"method": "opencv-supersample:n=8", "edge": "clamp"}
            beside = milliseconds(lambda: warp(texels, matrix, SIZE, **eight))  # noqa: B023
            for quality in (1.0, 1.5, 3.0):
                choices = {**linear, "quality": quality}
                image = warp(texels, matrix, SIZE, **choices).image
                time_ms = milliseconds(lambda: warp(texels, matrix, SIZE, quality=quality))  # noqa: B023
                row = {zone: f"{psnr(image, exact, mask):.1f}" for zone, mask in zones.items()}
                yield {
                    "floor": f"{turn}, {name}", "quality": quality, **row, "ms": f"{time_ms:.1f}",
                    "of OpenCV 8x8 cubic": f"{time_ms / beside:.2f}",
                }  # fmt: skip


def through_area_spline(texels: Any, matrix: Any, rays: int = 16) -> Any:
    """Mean of rays × rays per pixel through the default's reconstruction, by SciPy's splines."""
    from scipy.ndimage import map_coordinates, spline_filter

    coefficient = spline_filter(texels, order=5, mode="reflect")  # means of degree 4 are degree 5
    inverse, total = np.linalg.inv(matrix), np.zeros(SIZE)
    for ray in range(rays * rays):
        y, x = (
            np.mgrid[: SIZE[0], : SIZE[1]]
            + (np.array(divmod(ray, rays)) + 0.5)[:, None, None] / rays
        )
        u, v, d = (row[0] * x + row[1] * y + row[2] for row in inverse)
        at = [v / d - 0.5, u / d - 0.5]
        total += map_coordinates(coefficient, at, order=4, prefilter=False, mode="reflect")
    return total / rays**2


TABLES = {
    "scene": scene,
    "maps": maps,
    "trips": trips,
    "own": own,
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
