"""Work that is stopped: how soon, with what left behind, and how far it says it is."""

import threading
import time
from collections import Counter
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from resample import Cancel, CancelledError, cancellable
from resample.cameras.viewpoints import Orbit, Sphere
from resample.engine import jit
from resample.painting.choices import Primitive, Projection
from resample.profiles.orders import Rays
from resample.resampler import Resampler
from resample_comparisons.volume.painting import AxisSheets, ImageSheets
from resample_points import Cloud, render_cloud
from resample_texture import BackwardMap, Homography, warp
from resample_volume.appearance import Appearance, Classification
from resample_volume.classification.transfer import from_points
from resample_volume.inputs import as_volume
from resample_volume.rendering import Subject

FAINT = from_points([(0.0, (0.2, 0.5, 0.9), 0.0), (255.0, (1.0, 0.9, 0.4), 0.02)])
SOON = 0.25  # seconds; on a machine that does other things, too
SIZE = 160  # of work that takes longer than that
SMALL = 40

Draw = Callable[..., NDArray[np.float32]]


def volume(
    size: int, resampler: Resampler, classification: Classification = Classification.PRE
) -> Draw:
    """Frames of a volume, which was classified before."""
    z, y, x = np.indices((40, 40, 40)) / 8
    is_composited = resampler.projection is Projection.COMPOSITE  # which paints bytes, and floats
    kind = np.uint8 if is_composited else np.float32
    values = np.rint(127 * (1 + np.sin(x + y * z))).astype(kind)
    look = Appearance(FAINT, None, classification=classification)
    subject = Subject.of(as_volume(values), look, resampler)
    camera = subject.camera(Orbit(30, 20, 1.6), size, size)
    seen = subject.samples_for(camera)

    def draw(progress: Callable[[float], None] | None = None) -> NDArray[np.float32]:
        return resampler(seen, camera, height=size, width=size, progress=progress).rgba

    return draw


def texture(size: int, is_map: bool) -> Draw:
    picture = np.random.default_rng(0).random((8 * size, 8 * size, 3), np.float32)
    shape = (9 * size, 9 * size)
    y, x = np.indices(shape, np.float32)
    matrix = np.array([[1.2, 0.3, 4.0], [-0.2, 1.1, 300.0], [1e-5, 0, 1]])
    geometry = BackwardMap(0.7 * x + 0.1 * y, 0.7 * y - 0.1 * x) if is_map else Homography(matrix)
    return lambda: np.asarray(warp(picture, geometry, shape).image)


def cloud(size: int) -> Draw:
    rng = np.random.default_rng(1)
    points = rng.normal(size=(16 * size**2, 3)).astype(np.float32)
    toward = points / np.linalg.norm(points, axis=1, keepdims=True)
    given = Cloud(points, toward, np.abs(toward), np.full(len(points), 0.02, np.float32))
    camera = Orbit(30, 20, 1.0).around(Sphere(np.zeros(3), 4.0), size, size)
    return lambda: render_cloud(given, camera, size=(size, size)).rgba


POST = Classification.POST
WORK: dict[str, Callable[[int], Draw]] = {  # of pictures so many pixels a side
    "splats": lambda size: volume(size, Resampler(subpixels=4)),
    "mixed": lambda size: volume(size, Resampler(threshold=3.0, subpixels=3)),
    "points": lambda size: volume(size, Resampler(primitive=Primitive.POINTS, subpixels=4)),
    "axis-sheets": lambda size: volume(size, Resampler(order=AxisSheets(), subpixels=3)),
    "image-sheets": lambda size: volume(size, Resampler(order=ImageSheets())),
    "rays": lambda size: volume(size, Resampler(order=Rays(), subpixels=2), POST),
    "maximum": lambda size: volume(
        size, Resampler(order=Rays(), projection=Projection.MAXIMUM, subpixels=6), POST
    ),
    "texture": lambda size: texture(size, is_map=False),
    "map": lambda size: texture(size, is_map=True),
    "cloud": cloud,
}


MIDST = "test_work_stops_in_its_midst_and_leaves_nothing_behind"


def _again_and_again(draw: Draw) -> None:
    while True:
        draw()


@pytest.mark.sweep
@pytest.mark.parametrize("name", WORK)
def test_work_stops_in_its_midst_and_leaves_nothing_behind(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jit, "OFTEN", 0.0002)
    draw, cancel, look, told = WORK[name](SMALL), Cancel(), jit.report, []
    before, counts = draw(), Counter[int]()

    def looked(taken: int, count: int) -> None:
        counts[count] += 0 < taken < count
        look(taken, count)

    def stopping(taken: int, count: int) -> None:
        """Cancel while there are tasks that nobody has taken, of what takes longest."""
        told.append((taken, count))
        if 0 < taken < count == longest:
            cancel.cancel()
        look(taken, count)

    with cancellable(cancel):
        monkeypatch.setattr(jit, "report", looked)
        while not any(counts.values()):
            draw()
        longest = max(counts, key=counts.__getitem__)
        monkeypatch.setattr(jit, "report", stopping)
        with pytest.raises(CancelledError, match="was cancelled"):
            _again_and_again(draw)
    monkeypatch.setattr(jit, "report", look)
    taken, count = told[-1]
    assert 0 < taken < count == longest  # and no look came after that one
    np.testing.assert_array_equal(draw(), before)


@pytest.mark.sweep
@pytest.mark.parametrize(
    "name",
    [name if name == "rays" else pytest.param(name, marks=pytest.mark.sweep) for name in WORK],
)
def test_work_stops_soon_and_leaves_nothing_behind(name: str) -> None:
    draw = WORK[name](SIZE)
    begun = time.perf_counter()
    before = draw()
    took = time.perf_counter() - begun
    begun = time.perf_counter()
    draw()
    took = min(took, time.perf_counter() - begun)
    waits = []
    for share in (0.2, 0.5):
        cancel, asked = Cancel(), []

        def stop(cancel: Cancel = cancel, asked: list[float] = asked) -> None:
            asked.append(time.perf_counter())
            cancel.cancel()

        timer = threading.Timer(share * took, stop)
        timer.start()
        with pytest.raises(CancelledError, match="was cancelled"), cancellable(cancel):
            _again_and_again(draw)
        waits.append(time.perf_counter() - asked[0])
    assert min(waits) < SOON
    np.testing.assert_array_equal(draw(), before)


@pytest.mark.sweep
@pytest.mark.parametrize(
    "name", [*("splats", "image-sheets", "rays"), pytest.param("maximum", marks=pytest.mark.sweep)]
)
def test_progress_rises_to_one_and_moves_often(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jit, "OFTEN", 0.001)  # so that quick machines are looked at, too
    draw, pauses = WORK[name](SIZE), []
    for _ in range(3):  # a busy machine may keep one of them waiting
        told = [(time.perf_counter(), 0.0)]
        draw(progress=lambda share: told.append((time.perf_counter(), share)))  # noqa: B023
        share = [share for _, share in told]
        assert share == sorted(share)
        assert share[-1] == 1.0
        assert len(set(share)) > 3
        pauses.append(np.diff([when for when, _ in told]).max())
        if pauses[-1] < 0.5:
            break
    assert min(pauses) < 0.5


@pytest.mark.sweep
def test_what_progress_raises_stops_the_work() -> None:
    draw = WORK["rays"](SMALL)

    def refuse(share: float) -> None:
        raise OSError(f"enough at {share}")

    with pytest.raises(OSError, match="enough at"):
        draw(progress=refuse)


@pytest.mark.sweep
def test_what_is_cancelled_before_does_not_begin() -> None:
    draw, cancel = WORK["rays"](SMALL), Cancel()
    cancel.cancel()
    with pytest.raises(CancelledError), cancellable(cancel):
        draw()
    with cancellable(None):
        assert draw().any()


@pytest.mark.sweep
def test_others_go_on() -> None:
    draw, cancel = WORK["rays"](SMALL), Cancel()
    seen: list[NDArray[np.float32]] = []
    other = threading.Thread(target=lambda: seen.append(draw()))
    other.start()
    cancel.cancel()
    with pytest.raises(CancelledError), cancellable(cancel):
        draw()
    other.join()
    np.testing.assert_array_equal(seen[0], draw())
