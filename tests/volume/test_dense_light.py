"""Shadows and occlusion in windows of volumes in bricks have the bits of volumes in memory."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from resample_volume.voxels import transmittance
from resample_volume.voxels.shading import DepthCue, Light
from resample_volume.voxels.transmittance import LightCells, cells_around, exact_in_sums
from resample_volume.windows import Budget, paint_streamed, streamed_subject
from tests.volume.dense import EYE, SIZE, assert_same, in_bricks, smoke, whole_of
from tests.volume.of_voxels import of_voxels

CUT = {"crop": "2:29,:,:36", "clip": ("1/0.3/-0.5/-9",), "cue": DepthCue(0.5)}
BOTH = Light((1, -1, 2), shadows=True, occlusion=True)


def painted(media, fit, spent):
    dense = [(in_bricks(volume, (8, 7, 16)), look) for volume, look in media]
    subject = streamed_subject(dense, fit)
    return paint_streamed(dense, subject, subject.camera(EYE, *SIZE), SIZE, spent)


@pytest.mark.sweep
@pytest.mark.parametrize("finest", [40, 13, 9])  # cells of 1, 3 and 5 voxels a side
@pytest.mark.parametrize(
    ("look", "fit", "memory"),
    [
        (of_voxels("60..190", Light((1, -1, 2), shadows=True), **CUT), "visible", 1_100_000),
        (of_voxels("60..190", Light(occlusion=True)), "volume", 1_100_000),
        (of_voxels("30..190", BOTH, gradient_opacity=(0.1, 0.6)), "visible", 1 << 30),
    ],
)
def test_blocked_light_has_the_bits_of_a_volume_in_memory(
    finest, look, fit, memory, rng, monkeypatch
):
    monkeypatch.setattr(transmittance, "FINEST", finest)
    media = [(smoke(rng), look)]
    found, windows = painted(media, fit, Budget(memory))
    assert_same(found, whole_of(media, fit))
    assert windows >= 1


@pytest.mark.parametrize(
    "workers",
    [
        3,
        pytest.param(1, marks=pytest.mark.sweep),
    ],
)
def test_volumes_shade_each_other_whoever_paints_them(workers, rng, tmp_path, monkeypatch):
    monkeypatch.setattr(transmittance, "FINEST", 12)
    volume = smoke(rng)
    moved = volume._replace(origin=volume.origin + volume.spacing * [3, 0, -5])
    media = [(volume, of_voxels("60..190", BOTH)), (moved, of_voxels("0..40"))]
    with ThreadPoolExecutor(workers) as executor:
        found, _ = painted(media, "volume", Budget(1 << 30, 1, tmp_path, executor))
    assert_same(found, whole_of(media))
    assert (tmp_path / "light.npy").exists()


def test_sums_of_cells_do_not_depend_on_the_order(rng):
    cells = LightCells(5, (1, 1, 1))
    depth = (10.0 ** rng.uniform(-12, 1, 125)).astype(np.float32)
    exact = exact_in_sums(depth, float(depth.max()), cells)
    assert len({exact[rng.permutation(125)].cumsum()[-1] for _ in range(50)}) == 1
    np.testing.assert_allclose(exact, depth, rtol=0, atol=1e-8 * depth.max())
    near = rng.uniform(0.01, 1, 125).astype(np.float32)  # nothing is rounded
    assert (exact_in_sums(near, float(near.max()), cells) == near).all()
    assert cells_around(np.array([1, 321, 5])) == LightCells(2, (1, 161, 3))


def test_a_grid_of_light_that_does_not_fit_is_refused(rng):
    look = of_voxels("60..190", BOTH)
    with pytest.raises(ValueError, match="are allowed; give more memory, or leave shadows"):
        painted([(smoke(rng), look)], "volume", Budget(500_000))
    nothing = of_voxels("250..255", BOTH)
    frame, _ = painted([(smoke(rng), nothing)], "volume", Budget(500_000))
    assert not frame.coverage.any()
