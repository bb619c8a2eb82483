"""Voxels of fields: the picture of those that are kept equals that of all."""

from dataclasses import replace

import numpy as np
import pytest

from resample.cameras.viewpoints import Orbit
from resample.painting.choices import Projection
from resample.resampler import Resampler
from resample.types import Field, Frame
from resample_comparisons.volume.painting import ImageSheets
from resample_volume.classification.automatic import LEVELS
from resample_volume.classification.presets import load_transfer
from resample_volume.classification.transfer import TransferFunction, from_points
from resample_volume.files.generated import vessel_tree
from resample_volume.types import Volume
from resample_volume.voxels.fields import FieldVoxels, field_voxels, framed, lit_field
from resample_volume.voxels.framing import centered, sphere_around
from resample_volume.voxels.shading import Light

SLABS = Resampler(order=ImageSheets(0.5))
TREE = centered(vessel_tree(16))[0]
FRONT = np.array([0.0, -1.0, 0.0, 0.0])
LATE = from_points([(40, (1, 1, 1), 0.0), (80, (1, 0.5, 0.2), 0.9)])
SHELL = from_points([(20, (1, 1, 1), 0), (40, (1, 0, 0), 0.9), (80, (1, 1, 1), 0)])


def whole(volume: Volume, transfer: TransferFunction, gradient: str | None) -> FieldVoxels:
    """All voxels, as nothing else is needed of an average."""
    return field_voxels(volume, transfer, replace(SLABS, projection=Projection.AVERAGE), gradient)


def painted(voxels: FieldVoxels, resampler: Resampler, light: Light | None) -> Frame:
    """Picture of the volume around the tree's middle."""
    ball = sphere_around(whole(TREE, LATE, None), TREE)
    camera = Orbit(30, 20).around(ball, 32, 32)
    seen = lit_field(voxels, light, FRONT)
    return resampler(seen, camera, height=32, width=32)


# Which voxels are needed


@pytest.mark.some(2)
@pytest.mark.parametrize("thickness", [0.5, 1.5])
@pytest.mark.parametrize("transfer", [LATE, SHELL, load_transfer("surfaces")])
def test_a_composite_of_the_kept_voxels_is_that_of_all(transfer, thickness):
    resampler = replace(SLABS, order=ImageSheets(thickness))
    kept = field_voxels(TREE, transfer, resampler, "central")
    every = whole(TREE, transfer, "central")._replace(table=kept.table)
    assert 0 < len(kept.value) < len(every.value)
    some, all_ = (painted(voxels, resampler, Light()).rgba for voxels in (kept, every))
    assert some[..., 3].max() > 0.3
    np.testing.assert_allclose(some, all_, atol=1e-6)  # sums of float32 in another order


@pytest.mark.sweep
@pytest.mark.parametrize("iso", [30.0, 60.0])
def test_a_first_hit_among_the_kept_voxels_is_that_among_all(iso):
    resampler = replace(SLABS, projection=Projection.FIRST_HIT, iso=iso)
    kept = field_voxels(TREE, LATE, resampler, "central")
    every = whole(TREE, LATE, "central")
    assert 0 < len(kept.value) < len(every.value)
    some, all_ = (painted(voxels, resampler, None) for voxels in (kept, every))
    assert some.rgba[..., 3].max() > 0.3
    np.testing.assert_allclose(some.rgba, all_.rgba, atol=1e-5)
    np.testing.assert_allclose(some.depth, all_.depth, atol=1e-3)  # float32 of about 60


@pytest.mark.sweep
def test_the_largest_of_the_kept_voxels_is_that_of_all():
    resampler = replace(SLABS, projection=Projection.MAXIMUM)
    kept = field_voxels(TREE, LEVELS, resampler, None)
    every = whole(TREE, LEVELS, None)
    assert 0 < len(kept.value) < len(every.value)
    some, all_ = (painted(voxels, resampler, None) for voxels in (kept, every))
    np.testing.assert_allclose(some.rgba, all_.rgba, atol=1e-5)
    seen = all_.value > 1
    np.testing.assert_allclose(some.value[seen], all_.value[seen], atol=1e-3)  # of up to 255


def test_an_x_ray_needs_no_zeros():
    resampler = replace(SLABS, projection=Projection.ADDITIVE)
    kept = field_voxels(TREE, LEVELS, resampler, None)
    assert np.array_equal(np.sort(kept.value), np.sort(TREE.values[TREE.values > 0]))
    some, all_ = (
        np.nan_to_num(painted(voxels, resampler, None).value)
        for voxels in (kept, whole(TREE, LEVELS, None))
    )
    np.testing.assert_allclose(some, all_, atol=2e-4 * all_.max())  # tables of kernels


def test_values_that_are_missing_are_left_out():
    values = np.arange(64, dtype=np.float32).reshape(4, 4, 4)
    values[0, 0, 0], values[1, 1, 1] = np.nan, np.inf
    volume = TREE._replace(values=values)
    assert len(whole(volume, LATE, "central").value) == 62


# What they hold


def test_positions_values_and_gradients_belong_together():
    z, y, x = np.indices((5, 6, 7))
    ramp = (10 * x + 3 * y + z).astype(np.int16)
    volume = Volume(ramp, np.array([2.0, 1.0, 0.5]), np.array([1.0, 2, 3]), np.eye(3), "ramp")
    voxels = whole(volume, LATE, "central")
    place = (voxels.position - volume.origin) / volume.spacing
    assert np.allclose(place @ [10, 3, 1], voxels.value)
    inner = ((place > 0) & (place < [6, 5, 4])).all(axis=1)
    assert np.allclose(voxels.gradient[inner], [5, 3, 2])


def test_whole_numbers_fall_on_columns_of_the_table():
    looks = whole(TREE, LATE, None).table
    step = (looks.table.shape[1] - 1) / (looks.high - looks.low)
    assert step == int(step)
    opacity = LATE.opacities(np.arange(193), (0, 192))
    assert np.allclose(
        1 - np.exp(-looks.table[0, :: int(step), 3]), np.minimum(opacity, 1 - 1e-6), atol=1e-6
    )


@pytest.mark.parametrize("iso", [-1.0, 0.0, 193.0])
def test_a_value_that_is_never_passed_is_refused(iso):
    resampler = replace(SLABS, projection=Projection.FIRST_HIT, iso=iso)
    with pytest.raises(ValueError, match=r"no surface of the value .*: vessel-tree holds 0 to 192"):
        field_voxels(TREE, LATE, resampler, None)


# What a camera looks at


def test_what_is_looked_at_can_be_seen():
    voxels = field_voxels(TREE, LATE, SLABS, None)
    assert len(framed(voxels, SLABS).position) == (voxels.value > 40).sum()
    hit = replace(SLABS, projection=Projection.FIRST_HIT, iso=30.0)
    assert len(framed(field_voxels(TREE, LATE, hit, None), hit).position) == (
        (TREE.values >= 30).sum()
    )


def test_a_mean_is_of_all_that_is_there():
    average = replace(SLABS, projection=Projection.AVERAGE)
    voxels = whole(TREE, LATE, None)
    assert framed(voxels, average) is voxels


# Light


def test_without_light_colors_are_as_they_are():
    voxels = whole(TREE, LATE, "central")
    plain, lit = (lit_field(voxels, light, FRONT) for light in (None, Light()))
    assert plain.classifier.lamp.ambient + plain.classifier.lamp.diffuse == 1
    assert plain.classifier.lamp.specular == plain.classifier.lamp.diffuse == 0
    assert (lit.classifier.lamp.ambient, lit.classifier.lamp.diffuse) == (0.3, 0.7)
    assert np.array_equal(lit.value, plain.value)


def test_a_field_knows_who_looks_and_how_light_fades():
    field = lit_field(whole(TREE, LATE, None), None, FRONT, (3.0, 9.0, 0.4))
    assert isinstance(field, Field)
    look = field.classifier
    assert np.array_equal(look.lamp.viewer, FRONT)
    assert (look.near, look.far, look.dimmed) == (3.0, 9.0, 0.4)
