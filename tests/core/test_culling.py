"""Blocks that are skipped change no bit of a picture."""

import numpy as np
import pytest

from resample import culling
from resample.cameras.models import Camera, Orthographic
from resample.cameras.poses import look_at
from resample.culling import blocked, bricks
from resample.profiles.filters import Gaussian
from resample.profiles.orders import AxisSheets, EverySample, ImageSheets
from resample.resampler import FOOTPRINTS, Footprint, Primitive, Resampler
from resample.types import Classifier, Field, Lamp, Samples

ARRAYS = ("rgba", "depth", "first_depth", "coverage")
SIZE = {"height": 40, "width": 52}
LATTICE = np.array([[1.0, 0.1, 0.0], [0.0, 1.2, 0.0], [0.0, 0.2, -0.9]])


@pytest.fixture(autouse=True)
def small_passes(monkeypatch):
    monkeypatch.setattr(culling, "SAMPLES_PER_PASS", 100)


def cube(rng, side=18, extinction=3.0):
    """Samples on a sheared lattice around the origin, in no order, some of them left out."""
    index = np.indices((side,) * 3).reshape(3, -1).T - (side - 1) / 2
    index = rng.permutation(index[rng.random(len(index)) < 0.9])
    return Samples(
        (index @ LATTICE.T).astype(np.float32),
        rng.uniform(0, 1, index.shape).astype(np.float32),
        np.full(len(index), extinction, np.float32),
        LATTICE,
    )


def seen_from(eye, focal, near=0.0):
    return Camera.from_intrinsics(focal, focal, 25.0, 21.0, look_at(eye, (0, 0, 0)), near)


CAMERAS = {
    "close": seen_from((8, -34, 15), 90.0),
    "distant": seen_from((8, -72, 15), 90.0),
    "far away": seen_from((100, -950, 200), 90.0),
    "part of it": seen_from((10, -25, 8), 90.0),
    "eye inside": seen_from((3, -2, 1), 20.0),
    "wide": seen_from((3, -18, 1), 15.0),
    "near plane": seen_from((8, -34, 15), 90.0, near=31.0),
    "near plane of points": seen_from((100, -950, 200), 60.0, near=951.0),
    "parallel": Orthographic(1.7, 1.3, 20.0, 18.0, look_at((30, 20, -30), (0, 0, 0)), -5.0),
}
FORMS = [(form, model) for form in Primitive for model in FOOTPRINTS[form]]


def assert_same(first, second):
    for name in ARRAYS:
        assert getattr(first, name).tobytes() == getattr(second, name).tobytes(), name


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS.keys())
@pytest.mark.parametrize("key", ["depth", "distance"])
@pytest.mark.parametrize("extinction", [0.1, 3.0])
def test_the_picture_is_the_same_to_the_bit(rng, camera, key, extinction):
    samples, resample = cube(rng, extinction=extinction), Resampler(order=EverySample(key=key))
    frame, plain = (resample(s, camera, **SIZE) for s in (blocked(samples, 4), samples))
    assert_same(frame, plain)


@pytest.mark.parametrize(("primitive", "model"), FORMS)
@pytest.mark.parametrize("view", ["close", "distant"])
def test_all_primitives_and_footprints_keep_their_bits(rng, primitive, model, view):
    samples, resample = cube(rng), Resampler(primitive=primitive, footprint=model)
    frame = resample(blocked(samples, 4), CAMERAS[view], **SIZE)
    assert_same(frame, resample(samples, CAMERAS[view], **SIZE))
    assert frame.statistics.occluded > 0


def test_filters_that_reach_into_other_tiles_keep_their_bits(rng):
    samples, resample = cube(rng), Resampler(pixel_filter=Gaussian(0.7, 2.0))
    for camera in CAMERAS.values():
        frame = resample(blocked(samples, 4), camera, **SIZE)
        assert_same(frame, resample(samples, camera, **SIZE))


def test_clipped_blocks_are_skipped_and_no_others(rng):
    samples, clip = cube(rng), [[0.3, 1.0, 0.2, 0.0], [1.0, 0.0, 0.0, 5.0]]
    frame = Resampler()(blocked(samples, 4), CAMERAS["close"], clip=clip, **SIZE)
    assert_same(frame, Resampler()(samples, CAMERAS["close"], clip=clip, **SIZE))
    assert frame.statistics.blocks_outside > 0.1 * frame.statistics.blocks


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("size", [1, 3, 8, 100])
def test_neither_threads_nor_blocks_nor_their_order_matter(rng, threads, size):
    samples = cube(rng)
    mixed = rng.permutation(samples.extinction.size)
    other = Samples(*(array[mixed] for array in samples[:3]), samples.lattice)
    frame = Resampler()(blocked(other, size), CAMERAS["close"], threads=threads, **SIZE)
    assert_same(frame, Resampler()(samples, CAMERAS["close"], **SIZE))


def random_scene(rng):
    """A lattice of any shape, blocks of it, and a camera somewhere around or inside."""
    lattice = rng.normal(size=(3, 3)) + 1.5 * np.eye(3)
    index = rng.uniform(-9, 9, (600, 3))
    samples = Samples(
        (index @ lattice.T).astype(np.float32),
        np.ones(index.shape, np.float32),
        np.ones(len(index), np.float32),
        lattice,
    )
    pose = look_at(rng.normal(size=3) * rng.choice([3, 20, 300]), rng.normal(size=3) * 5)
    focal, principal = rng.uniform(10, 100, 2), rng.uniform(0, 40, 2)
    if rng.random() < 0.3:
        return samples, Orthographic(*focal / 20, *principal, pose, rng.normal())
    return samples, Camera.from_intrinsics(
        *focal, *principal, pose, rng.choice([0.0, 1.0, 15.0, 295.0])
    )


@pytest.mark.parametrize(("primitive", "model"), FORMS)
def test_outlines_hold_what_they_say_of_every_sample(rng, primitive, model):
    seen = 0
    for key in ("depth", "distance") * 6:
        samples, camera = random_scene(rng)
        resample = Resampler(primitive=primitive, footprint=model, order=EverySample(key=key))
        given = blocked(samples, 3)
        record = resample.footprints(given.samples, camera, **SIZE)
        scene = resample._scene(samples.lattice, camera.view(), (40, 52), None, None)
        outline = culling._Stage(scene, given, resample.order).outlines
        block = np.repeat(np.arange(len(given.blocks.low)), np.diff(given.blocks.start))
        is_seen = record["left"] <= record["right"]
        record, block = record[is_seen], block[is_seen]
        depth = record["depth"] * (record["obliquity"] if key == "distance" else 1)
        left, top, right, bottom = outline.bounds[block].T
        assert (left <= right).all()  # none is in a block that is left out
        assert (left <= record["left"]).all()
        assert (right >= record["right"]).all()
        assert (top <= record["top"]).all()
        assert (bottom >= record["bottom"]).all()
        assert (outline.front[block] <= depth).all()
        assert (outline.spacing[block] <= record["spacing"]).all()
        seen += record.size
    assert seen > 500


def test_a_wall_hides_the_blocks_behind_it(rng):
    y, x, z = np.indices((70, 70, 4)).reshape(3, -1)
    wall = np.stack([x - 34.5, y - 34.5, z + 40], axis=1)
    crowd = rng.uniform([-20, -20, 70], [20, 20, 110], (20_000, 3))
    place = np.concatenate([wall, crowd]).astype(np.float32)
    samples = Samples(place, np.ones_like(place), np.full(len(place), 5, np.float32), np.eye(3))
    camera = Camera.from_intrinsics(60.0, 60.0, 26.0, 20.0)
    statistics = Resampler()(blocked(samples), camera, **SIZE).statistics
    assert statistics.occluded > 0.95 * len(crowd)
    assert statistics.blocks_occluded > 100
    assert statistics.skipped_fraction > 0.5


def test_few_samples_are_painted_at_once(rng, monkeypatch):
    monkeypatch.setattr(culling, "SAMPLES_PER_PASS", 50_000)
    samples, resample = cube(rng), Resampler(footprint=Footprint.AFFINE)
    frame = resample(blocked(samples, 4), CAMERAS["distant"], **SIZE)
    assert_same(frame, resample(samples, CAMERAS["distant"], **SIZE))
    assert frame.statistics.occluded == 0


def test_half_of_a_volume_outside_the_frame_is_skipped(rng):
    samples = cube(rng)
    beside = Camera.from_intrinsics(90.0, 90.0, 0.0, 20.0, look_at((0, -34, 0), (0, 0, 0)))
    statistics = Resampler()(blocked(samples, 2), beside, **SIZE).statistics
    assert 0.25 < statistics.outside / statistics.samples < 0.5  # kernels reach over the edge


def test_skipped_samples_are_not_counted_as_painted(rng):
    samples = cube(rng)
    plain = Resampler()(samples, CAMERAS["distant"], **SIZE).statistics
    counts = Resampler()(blocked(samples, 4), CAMERAS["distant"], **SIZE).statistics
    painted = counts.points + counts.splats
    assert plain.points + plain.splats == painted + counts.occluded
    assert counts.samples == plain.samples
    assert (plain.outside, plain.occluded, plain.blocks) == (0, 0, 0)


def test_canvases_that_are_too_large_hide_nothing(rng, monkeypatch):
    monkeypatch.setattr(culling, "MOST_CANVASES", 1000)
    samples, resample = cube(rng), Resampler(footprint=Footprint.AFFINE)
    frame = resample(blocked(samples, 4), CAMERAS["part of it"], **SIZE)
    assert_same(frame, resample(samples, CAMERAS["part of it"], **SIZE))
    assert frame.statistics.occluded == 0
    assert frame.statistics.outside > 0


@pytest.mark.parametrize("count", [0, 50])
def test_nothing_in_view_is_an_empty_picture(rng, count):
    behind = rng.uniform(-60, -50, (count, 3)).astype(np.float32)
    samples = Samples(behind, np.ones_like(behind), np.ones(count, np.float32), np.eye(3))
    frame = Resampler()(blocked(samples), Camera.from_intrinsics(60.0, 60.0, 26.0, 20.0), **SIZE)
    assert not frame.rgba.any()
    assert np.isinf(frame.depth).all()
    assert frame.statistics.outside == count


def test_colors_may_be_replaced(rng):
    given = blocked(cube(rng), 4)
    relit = given._replace(samples=given.samples._replace(color=given.samples.color**2))
    frame = Resampler()(relit, CAMERAS["close"], **SIZE)
    assert_same(frame, Resampler()(relit.samples, CAMERAS["close"], **SIZE))


def test_bricks_are_cells_of_the_lattice(rng):
    samples = cube(rng, side=8)
    order, blocks = bricks(samples.position, samples.lattice, 4)
    place = samples.position[order] @ np.linalg.inv(LATTICE).T
    assert len(blocks.low) == 8
    for first, last in zip(blocks.start[:-1], blocks.start[1:], strict=True):
        assert np.ptp(place[first:last], axis=0).max() < 3.001  # 4 cells have 3 steps


def test_far_apart_samples_are_sorted_all_the_same(rng):
    place = (10.0 ** rng.uniform(-30, 30, (100, 3))).astype(np.float32)
    given = blocked(Samples(place, np.ones_like(place), np.ones(100), np.eye(3)))
    assert given.blocks.start[-1] == 100
    assert_same(
        Resampler()(given, CAMERAS["close"], **SIZE),
        Resampler()(given.samples, CAMERAS["close"], **SIZE),
    )


def test_progress_ends_at_one(rng):
    shares = []
    Resampler()(blocked(cube(rng), 4), CAMERAS["close"], progress=shares.append, **SIZE)
    assert shares == sorted(shares)
    assert shares[-1] == 1


@pytest.mark.parametrize("order", [AxisSheets(), ImageSheets()])
def test_other_orders_say_which_can(rng, order):
    with pytest.raises(ValueError, match="every-sample can"):
        Resampler(order=order)(blocked(cube(rng)), CAMERAS["close"], **SIZE)


def test_a_field_says_what_it_needs():
    lamp = Lamp(np.zeros(3), np.zeros(4), 1.0, 0.0, 0.0, 1.0, 0.0)
    look = Classifier(np.ones((1, 2, 4), np.float32), 0.0, 1.0, 1.0, lamp, 0.0, 1.0, 0.0)
    one = np.zeros((1, 3), np.float32)
    with pytest.raises(ValueError, match="a field needs image-sheets"):
        blocked(Field(one, one[:, 0], one, np.eye(3), look))


def test_blocks_of_no_cells_are_refused(rng):
    with pytest.raises(ValueError, match="side of 1 or more"):
        blocked(cube(rng, side=2), 0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda samples: samples._replace(position=samples.position[::-1]), "outside its block"),
        (lambda samples: samples._replace(color=samples.color[1:]), "do not fit"),
        (lambda samples: Samples(*(a[1:] for a in samples[:3]), LATTICE), "blocks do not fit"),
        (lambda samples: samples._replace(extinction=np.nan * samples.extinction), "not finite"),
    ],
)
def test_samples_that_do_not_fit_their_blocks_are_refused(rng, change, message):
    given = blocked(cube(rng), 4)
    with pytest.raises(ValueError, match=message):
        Resampler()(given._replace(samples=change(given.samples)), CAMERAS["close"], **SIZE)
