"""Texture warps: the floor workload, beside other image warpers."""

import atexit
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.contest import AbsentError, Contender, Goal, Options, Workload, contest
from benchmarks.measure import Run, Spread, take_turns
from benchmarks.tables import Row, Section
from resample_texture import warp
from tests.benchmarks import texture_table as floor

OPENCV = "OpenCV 8 × 8 cubic"  # the reference
TIMED = "brick"  # picture whose warp is timed; quality is the mean of two
MAGICK_TIMEOUT = 120  # s

BASELINES: dict[str, dict[str, Any]] = {
    OPENCV: {"method": "opencv-supersample:n=8"},
    "OpenCV bilinear": {"method": "bilinear"},
    "OpenCV 2 × 2 cubic": {"method": "opencv-supersample:n=2"},
    "OpenCV 4 × 4 linear": {"method": "opencv-supersample:n=4,kernel=linear"},
    "OpenCV 4 × 4 cubic": {"method": "opencv-supersample:n=4"},
    "OpenCV 8 × 8 linear": {"method": "opencv-supersample:n=8,kernel=linear"},
    "mip-mapped": {"method": "mipmap"},
    "anisotropic, 16 taps": {"method": "anisotropic"},
    "OpenImageIO, lanczos3": {"method": "oiio"},
    "OpenImageIO, mitchell": {"method": "oiio:filter=mitchell"},
}
# Targets of quality and time; Gaussian ones against Gaussian truth.
GOALS = {
    "hybrid, quality 1": Goal(share=0.2, decibels=56.8),
    "hybrid, quality 1.05": Goal(12, decibels=60),
    "hybrid, quality 2": Goal(27, decibels=66),
    "hybrid, Gaussian, quality 1": Goal(26, decibels=71),
    "hybrid, Gaussian, quality 2": Goal(42, decibels=82),
}
QUICK = ("hybrid", "hybrid, Gaussian", OPENCV, "OpenCV bilinear", "mip-mapped")


def workloads(options: Options) -> Sequence[Workload]:
    """The floor."""
    chosen = [*_baseline_times(), *_ours(), _magick()]
    if options.quick:
        chosen = [each for each in chosen if each.name in (*QUICK, "ImageMagick EWA")]
    return [
        Workload(
            "Texture: the floor, 1024² gray float32 to 512²",
            "Quality is the mean PSNR of two photographs over the whole frame, against the pixel "
            "filter named\nin the row (a box, if none is) over a Catmull-Rom surface.",
            chosen,
            has_memory=not options.quick,
            further=_per_millisecond,
        )
    ]


def _per_millisecond(name: str, median: float, decibels: float | None) -> Row:  # noqa: ARG001
    return {} if decibels is None else {"dB per ms": decibels / (1000 * median)}


def _baseline_times() -> Iterator[Contender]:
    for name, choices in BASELINES.items():
        clamped = {**choices, "edge": "clamp"}
        yield Contender(name, _warp(clamped), _quality(clamped))


def _ours() -> Iterator[Contender]:
    cheapest = [("hybrid, quality 1.05", {"quality": 1.05})]  # that has 60 dB
    for name, choices in [*cheapest, *floor.OURS]:
        yield Contender(name, _warp(choices), _quality(choices), GOALS.get(name))


def _warp(choices: dict[str, Any]) -> Callable[[], Run]:
    def prepare() -> Run:
        _require_floor()
        picture, matrix = floor.picture(TIMED), floor.floor().H_floor()
        return lambda: warp(picture, matrix, floor.SIZE, **choices)

    return prepare


def _quality(choices: dict[str, Any]) -> Callable[[], float]:
    truth = 1 if choices.get("filter") == "gaussian" else 0

    def quality() -> float:
        found = [floor.decibels(name, choices)["all"][truth] for name in floor.NATURAL]
        return float(np.mean(found))

    return quality


def _require_floor() -> None:
    if not floor.BENCH.is_dir():
        raise AbsentError(f"the workload is not here: {floor.BENCH.resolve()}")


@cache
def _magick_command() -> str:
    """Find ImageMagick's command; other programs are called `convert` too."""
    for name in ("magick", "convert"):
        path = shutil.which(name)
        if path is None:
            continue
        said = subprocess.run([path, "-version"], capture_output=True, text=True, check=False)
        if said.stdout.startswith("Version: ImageMagick"):
            return path
    raise AbsentError("there is no ImageMagick (`magick` or `convert`) on the PATH")


def _magick() -> Contender:
    return Contender(
        "ImageMagick EWA",
        _prepared_magick,
        lambda: float(np.mean([_magick_decibels(name) for name in floor.NATURAL])),
        remark=lambda: (
            "ImageMagick EWA: 16 bits; the time is that of its command, of which "
            f"{_magick_overhead():.0f} ms are start, reading and writing"
        ),
    )


def _prepared_magick() -> Run:
    _require_floor()
    command = _magick_command()
    return lambda: _magick_run(command, TIMED, _distortion())


def _magick_decibels(name: str) -> float:
    image = _magick_run(_magick_command(), name, _distortion())
    bench = floor.floor()
    score = bench.score(image, bench.H_floor(), *floor.truth(name))
    return float(score["all"][0])


def _magick_overhead() -> float:
    """Milliseconds of the command without warping."""
    command = _magick_command()
    crop = ("-crop", "512x512+0+0", "+repage")
    times = take_turns({"command": lambda: _magick_run(command, TIMED, crop)}, 3)["command"]
    return 1000 * Spread.of(times).median


def _distortion() -> tuple[str, ...]:
    """Options for the floor, from its frame's corners in the source."""
    height, width = floor.SIZE
    corners = np.array([(0, 0, 1), (width, 0, 1), (width, height, 1), (0, height, 1.0)])
    placed = corners @ np.linalg.inv(floor.floor().H_floor()).T
    pairs = zip(placed[:, :2] / placed[:, 2:], corners, strict=True)
    points = " ".join(f"{u:.9g},{v:.9g} {x:g},{y:g}" for (u, v), (x, y, _) in pairs)
    viewport = f"distort:viewport={width}x{height}+0+0"
    return ("-virtual-pixel", "edge", "-define", viewport, "-distort", "Perspective", points)


def _magick_run(command: str, name: str, options: Sequence[str]) -> Any:
    """Picture (512, 512) in 0..1."""
    source, target = _source(name), _folder() / "out.pgm"
    subprocess.run(
        [command, str(source), *options, "-depth", "16", str(target)],
        check=True,
        timeout=MAGICK_TIMEOUT,
    )
    values = np.frombuffer(target.read_bytes()[-2 * floor.SIZE[0] * floor.SIZE[1] :], ">u2")
    return values.reshape(floor.SIZE) / 65535.0


@cache
def _source(name: str) -> Path:
    """Write the picture as a 16-bit file that every ImageMagick reads."""
    picture = floor.picture(name)
    path: Path = _folder() / f"{name}.pgm"
    head = f"P5\n{picture.shape[1]} {picture.shape[0]}\n65535\n".encode()
    path.write_bytes(head + np.round(picture * 65535).astype(">u2").tobytes())
    return path


@cache
def _folder() -> Path:
    """Temporary folder, removed at exit."""
    kept = tempfile.TemporaryDirectory(prefix="benchmark-")
    atexit.register(kept.cleanup)
    return Path(kept.name)


def sections(options: Options) -> Iterator[Section]:
    """The table."""
    for workload in workloads(options):
        yield contest(__name__, workload, options)
