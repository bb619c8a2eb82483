"""Latency for users of scenes: pictures, previews, changed looks, and cancellation."""

import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.contest import Options
from benchmarks.measure import Run, Spread, take_turns
from benchmarks.scenes import squares
from benchmarks.tables import Row, Section
from resample import Cancel, CancelledError, cancellable

SIDE = 400  # px
SHARES = (0.2, 0.4, 0.6)  # fractions of a picture's time after which it is cancelled
PREVIEW_GOAL, LOOK_GOAL, CANCEL_GOAL = 0.15, 0.30, 0.05  # share, share, seconds


def sections(options: Options) -> Iterator[Section]:
    """Scenes of all applications, then the latency of cancellation."""
    yield _scenes(options)
    yield _cancelled(options)


def _scenes(options: Options) -> Section:
    text = (
        "CPU milliseconds on all threads, kernels compiled. A share is of the final picture; a new "
        f"look is what it costs beyond its painting. Goals: previews ≤ {PREVIEW_GOAL:.0%}, new "
        f"looks ≤ {LOOK_GOAL:.0%}."
    )
    section = Section("Scenes", text)
    for what, prepare in _workloads(options).items():
        runs = prepare()
        times = take_turns(runs, options.rounds, clock=time.process_time)
        final = Spread.of(times["final"])
        row: Row = {"": what, "final": final.times(1000)}
        row["preview"] = Spread.of(times["preview"]).times(1000)
        row["share of the final"] = f"{min(times['preview']) / min(times['final']):.0%}"
        if "new look" in times:
            beyond = min(times["new look"]) - min(times["final"])
            row["new look, beyond painting"] = f"{beyond / min(times['final']):.0%}"
        section.rows.append(row)
    return section


def _workloads(options: Options) -> dict[str, Callable[[], dict[str, Run]]]:
    """Scenes by name, opened on demand."""
    side = 100 if options.quick else SIDE
    engine = options.volumes / "engine.nhdr"
    volume = str(engine) if engine.is_file() else "vessel-tree:size=96"
    name = Path(volume).stem
    return {
        f"volume {name}, splats": lambda: _volume(volume, side, "pre"),
        f"volume {name}, along rays": lambda: _volume(volume, side, "post"),
        f"picture, {2 * side}² to {2 * side}²": lambda: _picture(2 * side),
        f"depth image, {2 * side}²": lambda: _depth(2 * side),
        f"depth image, {4 * side}²": lambda: _depth(4 * side),
    }


def _volume(name: str, side: int, classification: str) -> dict[str, Run]:
    from resample_volume import Appearance, Scene
    from resample_volume.appearance import Classification
    from resample_volume.classification.transfer import from_points

    scene = Scene(name)

    def look(at: float) -> Appearance:
        dark, light = (0.5, 0.2, 0.1), (1.0, 0.9, 0.4)
        points = [(0.0, dark, 0.0), (at, dark, 0.0), (at + 60, light, 0.3), (255.0, light, 0.5)]
        return Appearance(from_points(points), classification=Classification(classification))

    kept, turns = look(60), iter(range(1, 1000))
    seen = partial(scene.render, camera=(31, 20), size=(side, side))
    return {
        "final": lambda: seen(kept),
        "preview": lambda: seen(kept, quality="preview"),
        "new look": lambda: seen(look(60 + 1e-3 * next(turns))),
    }


def _picture(side: int) -> dict[str, Run]:
    from resample_texture import PictureScene

    scene = PictureScene(squares(side))
    turn = np.deg2rad(20)
    matrix = np.array([[np.cos(turn), -np.sin(turn), side / 3], [np.sin(turn), np.cos(turn), 0]])
    matrix = np.vstack([matrix, [0, 2e-4, 1]])
    return {
        "final": lambda: scene.render(matrix),
        "preview": lambda: scene.render(matrix, quality="preview"),
    }


def _depth(side: int) -> dict[str, Run]:
    from benchmarks.scenes import waves
    from resample_warp3d import Camera, DepthScene

    color, depth = waves(side)
    scene = DepthScene(color, depth, Camera.from_fov(60, side, side))
    pose = np.eye(4)
    pose[:3, 3] = (-0.2, 0.0, 0.1)
    return {
        "final": lambda: scene.render(pose),
        "preview": lambda: scene.render(pose, quality="preview"),
    }


def _cancelled(options: Options) -> Section:
    from tests.core.test_watching import SIZE, WORK

    text = (
        "Milliseconds from `cancel()` in another thread until `CancelledError` is raised, asked at "
        f"{', '.join(f'{share:.0%}' for share in SHARES)} of a picture's time. Goal: median ≤ "
        f"{CANCEL_GOAL * 1000:.0f} ms."
    )
    section = Section("Work that is stopped", text)
    for name, prepare in WORK.items():
        draw = prepare(SIZE)
        draw()
        start = time.perf_counter()
        draw()
        took = time.perf_counter() - start
        waits = [_wait(draw, share * took) for _ in range(options.rounds) for share in SHARES]
        found = Spread.of(waits)
        met = "yes" if found.median <= CANCEL_GOAL else "no"
        section.rows.append(
            {"": name, "picture": 1000 * took, "until it stops": found.times(1000), "met": met}
        )
    return section


def _wait(draw: Run, seconds: float) -> float:
    """Seconds until cancelled work ends; it is cancelled after some seconds."""
    cancel, asked = Cancel(), list[float]()

    def stop() -> None:
        asked.append(time.perf_counter())
        cancel.cancel()

    timer = threading.Timer(seconds, stop)
    timer.start()
    try:
        with cancellable(cancel):
            while True:
                draw()
    except CancelledError:
        return time.perf_counter() - asked[0]
