"""Cameras around what is visible of volumes in bricks stand where those of volumes in memory do."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from resample_volume.media.appearance import Appearance
from resample_volume.outofcore import ball
from resample_volume.rendering import Subject
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
