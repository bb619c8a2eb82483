"""Windows of a picture have the bits of the whole, whatever of the samples is at hand."""

import itertools
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from resample import Camera, Primitive, Resampler
from resample.outofcore.windows import WindowTask, split_windows
from resample.painting.scenes.plans import MIXTURE, PAPER, POINTS, SPLATS, together
from resample.profiles.orders import ImageSheets
from resample.types import Samples
from resample_comparisons.volume.painting import AxisSheets

HEIGHT, WIDTH = 50, 70
PICTURE = {"height": HEIGHT, "width": WIDTH}
LAYERS = ("rgba", "depth", "first_depth", "coverage")
REACH = 24  # px around a window in which its samples are kept: filters and tiles


def cloud(count, near, seed=3):
    """Samples of a lattice of unit steps, some of them left out, from `near` on."""
    rng = np.random.default_rng(seed)
    place = rng.permutation(14**3)[:count]
    at = np.column_stack(np.unravel_index(place, (14, 14, 14))) - 6.5
    position = (at + np.array([0, 0, near + 7])).astype(np.float32)
    color = rng.uniform(0, 1, (count, 3)).astype(np.float32)
    return Samples(position, color, rng.uniform(0, 1, count).astype(np.float32), np.eye(3))


def some_of(samples, chosen):
    names = ("position", "color", "extinction", "scale", "value", "gradient")
    given = {name: getattr(samples, name, None) for name in names}
    return samples._replace(
        **{name: given[name][chosen] for name in names if given[name] is not None}
    )


def camera():
    return Camera.from_fov(50, HEIGHT, WIDTH)


def those_near(samples, paint, eye, window):
    """Samples whose bounds come near a window."""
    record, (x0, y0, x1, y1) = paint.footprints(samples, eye, **PICTURE), window
    kept = (record["right"] >= x0 - REACH) & (record["left"] <= x1 + REACH)
    kept &= (record["bottom"] >= y0 - REACH) & (record["top"] <= y1 + REACH)
    return some_of(samples, kept)


def assert_same(part, whole, window):
    x0, y0, x1, y1 = window
    for name in LAYERS:
        wanted = np.ascontiguousarray(getattr(whole, name)[y0:y1, x0:x1])
        assert getattr(part, name).tobytes() == wanted.tobytes(), (name, window)


def cut(size, *places):
    return list(itertools.pairwise(sorted({0, size, *places})))


CASES = [
    (Resampler(), 2.0, SPLATS),
    (Resampler(), 90.0, SPLATS),
    (Resampler(threshold=1.5), 60.0, MIXTURE),
    (Resampler(primitive=Primitive.POINTS), 60.0, POINTS),
    (Resampler(primitive=Primitive.PAPER), 60.0, PAPER),
    (Resampler(primitive=Primitive.PAPER), 14.0, PAPER),
    (Resampler(order=AxisSheets()), 14.0, SPLATS),
    (Resampler(order=ImageSheets()), 14.0, SPLATS),
]


@pytest.mark.some(4)
@pytest.mark.parametrize(("paint", "near", "painter"), CASES)
def test_windows_have_the_bits_of_the_whole(paint, near, painter):
    samples, eye = cloud(700, near), camera()
    whole, plan = paint(samples, eye, **PICTURE), paint.plan(samples, eye, **PICTURE)
    assert plan.painter == painter
    for (x0, x1), (y0, y1) in itertools.product(cut(WIDTH, 33), cut(HEIGHT, 9)):
        window = (x0, y0, x1, y1)
        near_it = those_near(samples, paint, eye, window)
        for given_samples in (samples, near_it):
            part = paint.paint_window(given_samples, eye, plan, window)
            assert_same(part, whole, window)


@pytest.mark.sweep
@settings(max_examples=12, derandomize=True, deadline=None)
@given(
    st.lists(st.integers(1, WIDTH - 1), max_size=2),
    st.lists(st.integers(1, HEIGHT - 1), max_size=2),
    st.sampled_from([2.0, 14.0, 40.0]),
    st.integers(1, 4),
    st.integers(1, 2),
)
def test_any_partition_and_any_parts_of_the_samples_give_the_same_bits(
    columns, rows, near, parts, threads
):
    paint, samples, eye = Resampler(), cloud(500, near), camera()
    whole = paint(samples, eye, **PICTURE)
    shares = [some_of(samples, slice(n, None, parts)) for n in range(parts)]
    plan = together([paint.plan(share, eye, **PICTURE) for share in shares])
    plan = pickle.loads(pickle.dumps(plan))
    for (x0, x1), (y0, y1) in itertools.product(cut(WIDTH, *columns), cut(HEIGHT, *rows)):
        window = (x0, y0, x1, y1)
        near_it = those_near(samples, paint, eye, window)
        part = paint.paint_window(near_it, eye, plan, window, threads=threads)
        assert_same(part, whole, window)


def test_a_plan_bounds_what_is_seen():
    samples, eye, paint = cloud(300, 30.0), camera(), Resampler()
    plan, record = paint.plan(samples, eye, **PICTURE), paint.footprints(samples, eye, **PICTURE)
    left, top, right, bottom = plan.bounds
    seen = record[record["left"] <= record["right"]]
    assert plan.visible == len(seen)
    assert left <= seen["left"].min()
    assert top <= seen["top"].min()
    assert right >= seen["right"].max()
    assert bottom >= seen["bottom"].max()


def test_what_is_no_window_or_cannot_have_one_is_refused():
    samples, eye, paint = cloud(50, 20.0), camera(), Resampler()
    plan = paint.plan(samples, eye, **PICTURE)
    for window in ((0, 0, WIDTH + 1, 5), (5, 0, 5, 5), (-1, 0, 5, 5)):
        with pytest.raises(ValueError, match="is not inside a picture of 70 x 50"):
            paint.paint_window(samples, eye, plan, window)
    with pytest.raises(ValueError, match="give x0, y0, x1 and y1"):
        paint.paint_window(samples, eye, plan, (1, 2, 3))
    nothing = samples._replace(**{name: getattr(samples, name)[:0] for name in samples._fields[:3]})
    with pytest.raises(ValueError, match="nothing to plan"):
        paint.plan(nothing, eye, **PICTURE)
    empty = paint.paint_window(nothing, eye, plan, (0, 0, 4, 3))
    assert empty.rgba.shape == (3, 4, 4)
    assert not empty.rgba.any()


EVERY_KIND = [
    *(paint for paint, _, _ in CASES[2:]),
    Resampler(),
    Resampler(primitive=Primitive.POINTS, order=AxisSheets()),
    Resampler(primitive=Primitive.POINTS, order=ImageSheets()),
    Resampler(primitive=Primitive.EWA),
]


@pytest.mark.sweep
@settings(max_examples=20, derandomize=True, deadline=None)
@given(
    st.sampled_from(EVERY_KIND),
    st.sampled_from([2.0, 14.0, 44.0, 60.0, 90.0, 400.0]),
    st.integers(1, 4),
    st.booleans(),
)
def test_plans_of_any_parts_give_the_plan_of_all(paint, near, parts, is_along):
    samples, eye = cloud(500, near), camera()
    if is_along:
        samples = some_of(samples, np.argsort(samples.position[:, 2], kind="stable"))
    plan = paint.plan(samples, eye, **PICTURE)
    shares = [some_of(samples, slice(n, None, parts)) for n in range(parts)]
    if is_along:
        cuts = [500 * n // parts for n in range(parts + 1)]
        shares = [some_of(samples, slice(a, b)) for a, b in itertools.pairwise(cuts)]
    every = [paint.plans(share, eye, **PICTURE) for share in shares]
    found = paint.plan_of(pickle.loads(pickle.dumps(every)), np.eye(3), eye, **PICTURE)
    for name in ("painter", "size", "tile", "margin", "strongest", "layers", "visible"):
        assert getattr(found, name) == getattr(plan, name), name
    fine = paint.with_spacing(plan, samples, eye)
    for share in shares:
        found = paint.with_spacing(found, share, eye)
    whole = paint(samples, eye, **PICTURE)
    assert fine.spacing.shape == found.spacing.shape
    for window in ((0, 0, WIDTH, HEIGHT), (20, 10, 51, 33)):
        assert_same(paint.paint_window(samples, eye, found, window), whole, window)


def test_who_paints_is_not_said_before_all_were_asked():
    paint, eye = Resampler(primitive=Primitive.POINTS), camera()
    part = paint.plans(cloud(100, 60.0), eye, **PICTURE, painters=[SPLATS])
    assert paint.plan_of([part], np.eye(3), eye, **PICTURE) is None


@pytest.mark.parametrize("size", [{"height": 0, "width": 5}, {"height": 5, "width": -1}])
@pytest.mark.parametrize("way", ["__call__", "plan", "plans", "footprints"])
def test_each_way_to_a_picture_refuses_a_size_that_is_none(way, size):
    with pytest.raises(ValueError, match="both sides must be at least 1"):
        getattr(Resampler(), way)(cloud(50, 20.0), camera(), **size)


def test_samples_with_a_scale_each_have_no_footprints():
    samples = cloud(50, 20.0)
    scaled = samples._replace(scale=np.ones(50))
    with pytest.raises(ValueError, match="no records of samples that have a scale each"):
        Resampler().footprints(scaled, camera(), **PICTURE)


NONE = np.zeros(0, np.int32)


@pytest.mark.parametrize("fewest", [1, 2, 3, 5, 16])
@pytest.mark.parametrize("size", [(64, 64), (40, 100), (9, 130)])
def test_as_few_windows_as_are_asked_for_make_up_a_picture(size, fewest):
    """If they do not fit at once (`step` is not 0); each of whole tiles."""
    tasks = split_windows(size, 8, lambda window: WindowTask(window, NONE, NONE, 1), fewest)
    assert len(tasks) == fewest
    count = np.zeros(size, np.int64)
    for x0, y0, x1, y1 in (task.window for task in tasks):
        assert (x0 % 8, y0 % 8) == (0, 0)
        count[y0:y1, x0:x1] += 1
    assert (count == 1).all()


def test_a_window_is_halved_along_its_longer_side_until_it_fits():
    def bounds(window):
        x0, y0, x1, y1 = window
        return WindowTask(window, NONE, NONE) if (x1 - x0) * (y1 - y0) <= 16 * 16 else None

    tasks = split_windows((32, 64), 8, bounds, 100)
    assert sorted(task.window for task in tasks) == [
        (x, y, x + 16, y + 16) for x in range(0, 64, 16) for y in range(0, 32, 16)
    ]


@pytest.mark.parametrize("asked", [(), ("splats",), ("points",), ("mixture",)])
def test_plans_are_made_for_the_painters_that_are_asked_alone(asked):
    found = Resampler().plans(cloud(50, 20.0), camera(), **PICTURE, painters=asked)
    made = {name for name, plan in zip(("splats", "points", "mixture"), found, strict=True) if plan}
    assert made <= set(asked)
