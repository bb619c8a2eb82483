"""Several volumes in bricks, painted window by window, have the bits of volumes in memory."""

import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from resample import Resampler
from resample.outofcore.passes import PassContext
from resample_volume.classification.labels import Labels, Rule
from resample_volume.classification.regions import Region, RegionTransfer
from resample_volume.media import resampling
from resample_volume.media.appearance import Appearance
from resample_volume.media.lattices import common_lattice, first_in
from resample_volume.outofcore.dense import dense_of, share_lattice
from resample_volume.outofcore.together import in_grid
from resample_volume.rendering import Subject
from resample_volume.types import Volume
from resample_volume.voxels.shading import DepthCue, Light
from resample_volume.voxels.streaming import TooManyVoxelsError
from resample_volume.windows import Budget, paint_streamed, streamed_subject
from tests.volume.dense import EYE, SIZE, assert_same, in_bricks, smoke, whole_of

RAMP = ((0.1, 0.9), (0.2, 0.6, 1.0), 0.4)
WALLS = RegionTransfer((Region(*RAMP, (0.3, 0.9), (0.1, 0.2)),), normalized=True)
CUT = {"crop": "2:29,:,:36", "clip": ("1/0.3/-0.5/-9",), "cue": DepthCue(0.5)}
TISSUE = np.random.default_rng(3).integers(0, 5, (37, 26, 31)).astype(np.uint8)
LABELS = Labels(TISSUE, {1: Rule((1, 0, 0)), 2: Rule(opacity=0.0)})


def second(rng, place):
    """Another volume on the lattice of `smoke`: as large, a part of it, or reaching beyond."""
    volume = smoke(rng)
    if place == "same":
        return volume
    if place == "within":
        values = np.ascontiguousarray(volume.values[3:30, 5:, 2:29])
        return volume._replace(values=values, origin=volume.origin + volume.spacing * [2, 5, 3])
    return volume._replace(origin=volume.origin + volume.spacing * [-4, 5, 3])


def painted(media, sides, memory, executor=None, fit="volume"):
    dense = [
        (in_bricks(volume, side), look) for (volume, look), side in zip(media, sides, strict=True)
    ]
    subject = streamed_subject(dense, fit)
    camera = subject.camera(EYE, *SIZE)
    return paint_streamed(dense, subject, camera, SIZE, Budget(memory, executor=executor))


@pytest.mark.sweep
@pytest.mark.parametrize(
    "place",
    [
        "within",
        "beyond",
        pytest.param(
            "same",
            marks=pytest.mark.sweep,
        ),
    ],
)
@pytest.mark.parametrize("memory", [1_050_000, 1 << 30])
def test_volumes_of_one_lattice_have_the_bits_of_those_in_memory(place, memory, rng):
    look = Appearance("60..190", light=None) if place == "same" else Appearance("60..190", **CUT)
    media = [(smoke(rng), look), (second(rng, place), Appearance(WALLS))]
    found, windows = painted(media, [(8, 8, 8), (8, 7, 9)], memory)
    assert (windows > 1) == (memory < 1 << 30)
    assert_same(found, whole_of(media))


@pytest.mark.sweep
def test_any_number_of_workers_paints_volumes_and_their_labels(rng):
    first = Appearance("60..190", labels=LABELS, **CUT)
    media = [
        (smoke(rng), first),
        (second(rng, "beyond"), Appearance("100..150")),
        (second(rng, "within"), Appearance("0..9")),
    ]
    wanted = whole_of(media)
    for workers in (1, 3):
        with ThreadPoolExecutor(workers) as executor:
            found, _ = painted(media, [(5, 9, 8), (37, 26, 31), (8, 8, 8)], 1 << 30, executor)
        assert_same(found, wanted)


@pytest.mark.sweep
@pytest.mark.parametrize("place", ["same", "within", "beyond"])
def test_volumes_in_bricks_that_fit_have_the_bits_of_those_in_memory(place, rng):
    media = [(smoke(rng), Appearance("60..190", **CUT)), (second(rng, place), Appearance(WALLS))]
    dense = [(in_bricks(volume, (8, 5, 9)), look) for volume, look in media]
    wanted = Subject.of_several(media, None, "volume").facts()
    assert Subject.of_several(dense, None, "volume").facts() == wanted
    dense[1][0].values.memory = 300_000
    with pytest.raises(ValueError, match="visible voxels or more needs"):
        Subject.of_several(dense, None, "volume")


@pytest.mark.parametrize("side", [(8, 8, 8), (5, 40, 3)])
def test_bricks_of_a_part_lie_on_the_grid_of_the_lattice(side, rng):
    volumes = smoke(rng), second(rng, "beyond")
    lattice = common_lattice(volumes)
    x, y, z = lattice.size
    for volume in volumes:
        first = first_in(volume, lattice)
        part = in_grid(in_bricks(volume, (7, 8, 16)).values, first, (z, y, x), side)
        whole = np.full((z, y, x), -1)
        where = tuple(
            slice(n, n + size) for n, size in zip(first, volume.values.shape, strict=True)
        )
        whole[where] = volume.values
        least, greatest = part.ends
        for index in part.all():
            own = part.brick(index)
            assert np.array_equal(own, whole[part.box(index)])
            if own.size:
                assert least[index] <= own.min() <= own.max() <= greatest[index]
            else:
                assert least[index] > greatest[index]


@pytest.mark.sweep
@settings(max_examples=6)
@given(
    shape=st.tuples(*[st.integers(6, 30)] * 3),
    first=st.tuples(*[st.integers(-12, 12)] * 3),
    sides=st.tuples(*[st.tuples(*[st.integers(3, 20)] * 3)] * 2),
    memory=st.sampled_from([1_500_000, 1 << 30]),
    workers=st.integers(1, 3),
    fit=st.sampled_from(["visible", "volume"]),
)
@example((29, 8, 30), (3, -7, 0), ((8, 8, 8), (5, 7, 20)), 1_500_000, 2, "visible")
def test_any_volumes_in_any_bricks_give_the_same_bits(shape, first, sides, memory, workers, fit):
    rng = np.random.default_rng(sum(shape))
    values, label = (rng.integers(0, n, shape).astype(np.uint8) for n in (200, 5))
    spacing = np.array([1.0, 0.8, 1.2])
    volume = Volume(values, spacing, np.zeros(3), np.eye(3), "any")
    light = Light((1, -1, 2), shadows=True, occlusion=True)
    look = Appearance(WALLS, light, labels=Labels(label, LABELS.rules), cue=DepthCue(0.4))
    media = [(volume, look), (volume._replace(origin=spacing * first), Appearance("40..90"))]
    with ThreadPoolExecutor(workers) as executor:
        found, _ = painted(media, sides, memory, executor, fit)
    assert_same(found, whole_of(media, fit))


C, S = np.cos(0.4), np.sin(0.4)
TURNED = np.array([[C, -S, 0], [S, C, 0], [0, 0, 1.0]])


def other(rng, is_missing=False):
    """Volume of larger voxels, turned, which overlaps that of `smoke`."""
    values = rng.integers(0, 200, (20, 22, 18)).astype(np.float32)
    if is_missing:
        values[rng.random(values.shape) < 0.2] = np.nan
    origin = smoke(rng).origin + np.array([4, -3, 2])
    return Volume(values, np.array([1.5, 1.2, 1.9]), origin, TURNED, "other")


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("is_missing", "fit"),
    [
        (True, "visible"),
        *(
            pytest.param(
                *each,
                marks=pytest.mark.sweep,
            )
            for each in [(False, "visible"), (False, "volume"), (True, "volume")]
        ),
    ],
)
def test_volumes_of_other_lattices_are_resampled_in_a_file(
    is_missing, fit, rng, tmp_path, monkeypatch
):
    monkeypatch.setenv("HYBRID_RESAMPLE_CACHE", str(tmp_path))
    monkeypatch.setattr(resampling, "SLAB", 5000)
    media = [
        (smoke(rng), Appearance("60..190", **CUT)),
        (other(rng, is_missing), Appearance("auto", gradient_opacity=(0.1, 0.5))),
    ]
    dense = [(in_bricks(volume, (8, 8, 8)), look) for volume, look in media]
    subject = streamed_subject(dense, fit)
    assert not share_lattice(dense)
    with ThreadPoolExecutor(2) as executor:
        spent = Budget(1_500_000, executor=executor)
        found, windows = paint_streamed(dense, subject, subject.camera(EYE, *SIZE), SIZE, spent)
    assert_same(found, whole_of(media, fit))
    assert windows > 1
    assert not list(tmp_path.iterdir())
    _, found = dense_of(dense, Resampler(), 1 << 20, PassContext())
    with pytest.raises(
        ValueError, match="can only be painted by the process that resampled it; leave workers"
    ):
        pickle.dumps(found.members[1].volume.values)


def test_volumes_in_memory_and_labels_of_resampled_ones_are_refused(rng):
    first, look = in_bricks(smoke(rng), (8, 8, 8)), Appearance("60..190", light=None)
    with pytest.raises(ValueError, match="smoke is in memory as a whole and cannot be painted"):
        streamed_subject([(first, look), (smoke(rng), look)])
    turned = in_bricks(other(rng), (8, 8, 8))
    labels = Labels(np.zeros(turned.values.shape, np.uint8), {})
    media = [(first, look), (turned, Appearance("60..190", labels=labels))]
    with pytest.raises(
        ValueError, match="labels belong to the voxels of other, which is resampled"
    ):
        streamed_subject(media, "visible")


def test_what_does_not_fit_on_the_finest_lattice_says_so(rng):
    look = Appearance("60..190", light=None)
    media = [(in_bricks(volume, (8, 8, 8)), look) for volume in (smoke(rng), other(rng))]
    media[1][0].values.memory = 400_000
    with pytest.raises(TooManyVoxelsError, match="other on the finest lattice needs 4"):
        Subject.of_several(media)
