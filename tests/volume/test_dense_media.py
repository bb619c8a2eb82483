"""Several volumes in bricks, painted window by window, have the bits of volumes in memory."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from resample_volume.looks.labels import Labels, Rule
from resample_volume.looks.regions import Region, RegionTransfer
from resample_volume.media.lattices import common_lattice, first_in
from resample_volume.media.together import in_grid
from resample_volume.rendering import Appearance, Subject
from resample_volume.voxels.shading import DepthCue
from resample_volume.windows import Spent, paint_unseen, unseen_together
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


def painted(media, sides, memory, executor=None):
    dense = [
        (in_bricks(volume, side), look) for (volume, look), side in zip(media, sides, strict=True)
    ]
    subject = unseen_together(dense)
    camera = subject.camera(EYE, *SIZE)
    return paint_unseen(dense, subject, camera, SIZE, Spent(memory, executor=executor))


@pytest.mark.parametrize("place", ["same", "within", "beyond"])
@pytest.mark.parametrize("memory", [1_050_000, 1 << 30])
def test_volumes_of_one_lattice_have_the_bits_of_those_in_memory(place, memory, rng):
    look = Appearance("60..190", light=None) if place == "same" else Appearance("60..190", **CUT)
    media = [(smoke(rng), look), (second(rng, place), Appearance(WALLS))]
    found, windows = painted(media, [(8, 8, 8), (8, 7, 9)], memory)
    assert (windows > 1) == (memory < 1 << 30)
    assert_same(found, whole_of(media))


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


def test_volumes_of_other_lattices_and_in_memory_are_refused(rng):
    first, other = in_bricks(smoke(rng), (8, 8, 8)), smoke(rng)
    look = Appearance("60..190", light=None)
    turned = in_bricks(other._replace(spacing=other.spacing * 1.5), (8, 8, 8))
    with pytest.raises(ValueError, match="smoke has voxels beside those of the finest volume"):
        unseen_together([(first, look), (turned, look)])
    with pytest.raises(ValueError, match="smoke, which is in memory as a whole, cannot be painted"):
        unseen_together([(first, look), (other, look)])
