"""Cameras around what is visible of volumes in bricks stand where those of volumes in memory do."""

from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest

from resample.outofcore.passes import PassContext
from resample_volume.classification.regions import Faded
from resample_volume.media.appearance import Appearance
from resample_volume.outofcore import ball, dense
from resample_volume.rendering import Subject
from resample_volume.voxels.framing import SOME
from resample_volume.windows import Budget, paint_streamed, streamed_subject
from tests.volume.dense import EYE, SIZE, assert_same, in_bricks, smoke, whole_of

CUT = {"crop": "2:29,:,:36", "clip": ("1/0.3/-0.5/-9",)}


def with_strays(rng):
    """A block of smoke in nothing, and two voxels far from it."""
    volume = smoke(rng)
    values = np.zeros((70, 60, 90), np.uint8)
    values[12:58] = rng.integers(0, 200, (46, 60, 90))
    values[3, 20, 30] = values[2, 2, 2] = 150
    return volume._replace(values=values)


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("workers", "side"),
    [
        (2, (16, 5, 33)),
        *(
            pytest.param(*each, marks=pytest.mark.sweep)
            for each in [(None, (8, 8, 8)), (2, (8, 8, 8)), (None, (16, 5, 33))]
        ),
    ],
)
@pytest.mark.parametrize(
    "has_strays",
    [
        False,
        pytest.param(True, marks=pytest.mark.sweep),
    ],
)
def test_a_ball_is_found_brick_by_brick(has_strays, workers, side, rng, monkeypatch):
    told = []
    is_filled = ball._is_filled
    # Strays are looked for in any case.
    monkeypatch.setattr(ball, "_is_filled", lambda *given: told.append(is_filled(*given)))
    monkeypatch.setattr(ball, "BATCH_SIZE", 1000)
    volume = with_strays(rng) if has_strays else smoke(rng)
    for look in (Appearance("60..190"), Appearance("60..190", **CUT)):
        wanted = Subject.of(volume, look).sphere
        with ThreadPoolExecutor(workers or 1) as executor:
            spent = Budget(1 << 30, executor=executor if workers else None)
            found = streamed_subject([(in_bricks(volume, side), look)], "visible", None, spent)
        assert found.sphere.radius == wanted.radius
        assert found.sphere.center.tolist() == wanted.center.tolist()
    assert len(told) == 2


@pytest.mark.some(1)
@pytest.mark.parametrize("has_strays", [False, True])
def test_every_voxel_is_asked_in_the_order_of_the_painter(has_strays, rng, monkeypatch):
    volume = with_strays(rng) if has_strays else smoke(rng)
    told = []
    is_filled = ball._is_filled
    monkeypatch.setattr(
        ball, "_is_filled", lambda *given: told.append(is_filled(*given)) or told[-1]
    )
    found = streamed_subject([(in_bricks(volume, (8, 9, 32)), Appearance("60..190"))], "visible")
    assert told == [not has_strays]
    assert found.sphere.radius == Subject.of(volume, Appearance("60..190")).sphere.radius


@pytest.mark.sweep
@pytest.mark.parametrize(
    "several",
    [
        True,
        pytest.param(
            False,
            marks=pytest.mark.sweep,
        ),
    ],
)
def test_pictures_of_what_is_visible_have_the_bits_of_those_in_memory(several, rng):
    media = [(smoke(rng), Appearance("60..190", **CUT))]
    if several:
        moved = media[0][0]._replace(origin=media[0][0].origin + media[0][0].spacing * [3, 0, -5])
        media.append((moved, Appearance("0..30")))
    dense = [(in_bricks(volume, (8, 8, 8)), look) for volume, look in media]
    subject = streamed_subject(dense, "visible")
    reads = [volume.values.reads for volume, _ in dense]
    assert streamed_subject(dense, "visible").sphere == subject.sphere
    assert reads == [volume.values.reads for volume, _ in dense]
    spent = Budget(1_300_000 if several else 700_000)
    found, windows = paint_streamed(dense, subject, subject.camera(EYE, *SIZE), SIZE, spent)
    assert windows >= 1
    assert_same(found, whole_of(media, "visible"))


def test_where_nothing_is_visible_cameras_are_around_the_volume(rng):
    volume, look = smoke(rng), Appearance("250..255")
    found = streamed_subject([(in_bricks(volume, (8, 8, 8)), look)], "visible")
    wanted = Subject.of(volume, look).sphere
    assert (found.sphere.radius, found.is_empty) == (wanted.radius, True)
    media = [(in_bricks(volume, (8, 8, 8)), look)]
    camera = found.camera(EYE, *SIZE)
    frame, windows = paint_streamed(media, found, camera, SIZE, Budget(1 << 30))
    assert (windows, float(frame.coverage.max())) == (0, 0.0)


def test_the_sample_of_blocks_is_that_of_all_voxels_in_a_row(monkeypatch):
    """One in 64, as in memory, whichever blocks are read together."""
    visible, taken = np.array([50, 70, 40, 1]), []
    ends = np.split(np.arange(visible.sum(), dtype=float), np.cumsum(visible)[:-1])

    def ordered(_seen, _lattice, number, _bricks):
        return np.concatenate([ends[n] for n in number])[:, None] * np.ones(3)

    def near_ends(some, _low, _extent):
        taken.extend(some[:, 0])
        return np.zeros((2, 3), np.int64)

    bricks = SimpleNamespace(shape=(8, 8, 8))
    monkeypatch.setattr(ball, "bricks_of", lambda _: bricks)
    monkeypatch.setattr(ball, "_reach", lambda *_: (np.zeros((4, 3)), np.ones((4, 3))))
    monkeypatch.setattr(
        ball, "_groups", lambda *_: [np.array([0]), np.array([1, 2]), np.array([3])]
    )
    monkeypatch.setattr(ball, "_ordered", ordered)
    monkeypatch.setattr(ball, "near_ends", near_ends)
    outline = SimpleNamespace(
        low=np.zeros(3), high=np.full(3, 160.0), fine=np.arange(4), fine_visible=visible
    )
    assert not ball._is_filled(SimpleNamespace(volume=None), outline, int(visible.sum()))
    assert taken == list(range(SOME // 2, visible.sum(), SOME))


def test_bricks_are_classified_as_voxels_in_memory(rng):
    """Ramps of gradients fade what the transfer function shows."""
    volume = in_bricks(smoke(rng), (8, 8, 8))
    plain = dense._classifying(volume, Appearance("60..190"), PassContext())
    faded = Appearance("60..190", gradient_opacity=(0.2, 0.6))
    found = dense._classifying(volume, faded, PassContext())
    assert found.transfer == Faded(plain.transfer, (0.2, 0.6))
    assert found.gradient == faded.gradient
    assert found.steep > 0 == plain.steep
