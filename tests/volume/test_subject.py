"""Subjects: what is classified once, seen by any camera, and told apart from others."""

from dataclasses import replace

import numpy as np
import pytest

from resample.cameras.models import Orthographic
from resample.cameras.viewpoints import Orbit
from resample.painting.choices import Projection
from resample.profiles.orders import EverySample, Rays
from resample.resampler import Resampler
from resample.types import LatticeField, Samples
from resample_comparisons.volume.painting import AxisSheets
from resample_volume.appearance import Appearance, Classification
from resample_volume.calls import render
from resample_volume.classification.labels import Labels, Rule
from resample_volume.files.generated import checker_box, vessel_tree
from resample_volume.rendering import Subject
from resample_volume.voxels.gathered import Gathered
from resample_volume.voxels.shading import DepthCue, Light
from resample_volume.voxels.visible import Voxels
from tests.volume.of_voxels import of_voxels

TREE = vessel_tree(16)
PLAIN = Appearance()
POST = Appearance(classification=Classification.POST)
SPLATS, FIELD = Resampler(), Resampler(order=Rays())
SIZE = {"height": 32, "width": 32}
SQUARE = (32, 32)
PROJECTIONS = [
    replace(FIELD, projection=Projection.MAXIMUM),
    replace(FIELD, projection=Projection.AVERAGE),
    replace(FIELD, projection=Projection.ADDITIVE),
    replace(FIELD, projection=Projection.FIRST_HIT, iso=60.0),
]


def test_voxels_are_of_what_is_reconstructed():
    assert isinstance(Subject.of(TREE, PLAIN).voxels, Gathered)
    assert isinstance(Subject.of(TREE, of_voxels()).voxels, Voxels)
    assert isinstance(Subject.of(TREE, PLAIN, SPLATS).voxels, Voxels)
    for resampler in (FIELD, *PROJECTIONS):
        assert isinstance(Subject.of(TREE, PLAIN, resampler).voxels, Gathered)


@pytest.mark.parametrize("camera", [Orbit(), Orbit(fov=0)])
def test_a_camera_sees_samples_or_a_field(camera):
    for resampler, kind in ((SPLATS, Samples), (FIELD, LatticeField)):
        subject = Subject.of(TREE, PLAIN, resampler)
        assert isinstance(subject.samples_for(subject.camera(camera, 32, 32)), kind)


@pytest.mark.parametrize("order", [EverySample(), AxisSheets()])
def test_a_field_needs_rays(order):
    with pytest.raises(ValueError, match="post needs the order rays, not"):
        Subject.of(TREE, POST, Resampler(order=order))


def test_what_a_projection_does_not_show_is_refused():
    labels = Labels(np.zeros(TREE.values.shape, np.uint8), {0: Rule(opacity=0)})
    largest, hit = PROJECTIONS[0], PROJECTIONS[3]
    for look, resampler, complaint in (
        (replace(PLAIN, labels=labels), hit, "labels color voxels"),
        (replace(PLAIN, cue=DepthCue()), largest, "depth-cue dims light"),
        (replace(PLAIN, gradient_opacity=(0.1, 0.5)), hit, "gradient-opacity fades voxels"),
        (Appearance("surfaces"), hit, "take one of values alone"),
        (Appearance("surfaces"), largest, "take one of values alone"),
    ):
        with pytest.raises(ValueError, match=complaint):
            Subject.of(TREE, look, resampler)


@pytest.mark.some(1)
@pytest.mark.parametrize("look", [PLAIN, POST])
@pytest.mark.parametrize(
    "change",
    [
        {"transfer": "gray"},
        {"light": Light((1, 0, 0))},
        {"light": None},
        {"gradient_opacity": (0.1, 0.5)},
        {"cue": DepthCue(0.5)},
        {"crop": "2:,:,:"},
        {"clip": ("1/0/0",)},
    ],
)
def test_facts_change_with_all_that_changes_the_picture(look, change):
    painter = FIELD if look is POST else SPLATS
    there = Subject.of(TREE, look, painter)
    other = Subject.of(TREE, replace(look, **change), painter)
    assert there.facts() == Subject.of(TREE, look, painter).facts()
    assert there.facts() != other.facts()
    pictures = [
        render(TREE, look, Orbit(30, 20), resampler=painter, size=SQUARE).rgba,
        render(TREE, replace(look, **change), Orbit(30, 20), resampler=painter, size=SQUARE).rgba,
    ]
    assert np.abs(pictures[0] - pictures[1]).max() > 1e-3


def test_facts_change_with_the_values():
    bright = TREE._replace(values=np.maximum(TREE.values, 40))
    for resampler in (FIELD, *PROJECTIONS):
        there, other = (Subject.of(volume, PLAIN, resampler).facts() for volume in (TREE, bright))
        assert there != other


def test_planes_are_carried_to_the_renderer():
    box = checker_box(16, 4)
    look = of_voxels(clip=("0/0/1",))
    whole, upper = Subject.of(box, of_voxels()), Subject.of(box, look)
    assert np.allclose(upper.clip, [[0, 0, 1, 0]])
    camera = whole.camera(Orbit(0, 0, fov=0), 32, 32)
    full, cut = (
        Resampler()(subject.samples_for(camera), camera, **SIZE, clip=subject.clip).rgba
        for subject in (whole, upper)
    )
    assert full[17:].max() > 0.5
    assert cut[16:].max() == 0
    # Kernels, and what is lit as the cut, are beyond; parts are of tables of 256 × 256 steps.
    np.testing.assert_allclose(cut[:10], full[:10], atol=2e-5)


def test_cameras_of_the_users_own_are_in_the_volumes_scene():
    box = checker_box(16, 4)
    front = np.array([[1.0, 0, 0, -7.5], [0, 0, -1, 7.5], [0, 1, 0, 30], [0, 0, 0, 1]])
    own = render(box, PLAIN, Orthographic(1.0, 1.0, 16, 16, front), size=SQUARE).rgba[..., 3]
    assert np.allclose(own, own[:, ::-1], atol=1e-2)
    assert np.allclose(own, own[::-1], atol=1e-2)  # in the middle of the picture


@pytest.mark.sweep
def test_a_dimmed_surface_is_darker_the_farther_it_is():
    for look, resampler in ((PLAIN, SPLATS), (POST, FIELD), (PLAIN, PROJECTIONS[3])):
        bright, dim = (
            render(TREE, replace(look, cue=cue), resampler=resampler, size=SQUARE)
            for cue in (None, DepthCue(0.9))
        )
        assert np.allclose(dim.rgba[..., 3], bright.rgba[..., 3], atol=1e-6)
        seen = bright.rgba[..., 0] > 0.1
        kept = dim.rgba[seen][:, 0] / bright.rgba[seen][:, 0]
        assert kept.max() < 1
        assert np.corrcoef(kept, bright.depth[seen])[0, 1] < -0.8


# The library's one call


@pytest.mark.some(1)
@pytest.mark.parametrize("resampler", PROJECTIONS)
def test_arrays_can_be_projected(resampler):
    frame = render(TREE.values, "gray", resampler=resampler, size=SQUARE)
    assert np.isfinite(frame.rgba).all()
    assert frame.rgba[..., 3].max() > 0.1
    measured = resampler.projection is not Projection.FIRST_HIT
    assert (frame.value is not None) == measured


@pytest.mark.sweep
def test_what_is_measured_is_in_data_units():
    values = np.full((12, 12, 12), 7.0, np.float32)
    values[6, 6, 6] = 8.0
    largest, mean = (
        render(values, camera=Orbit(fov=0), resampler=one, size=SQUARE).value
        for one in PROJECTIONS[:2]
    )
    assert 7 < np.nanmax(largest) < 8
    inside = np.s_[14:18, 14:18]
    assert np.allclose(mean[inside], 7.1, atol=0.05)


def test_colors_after_reconstruction_make_narrower_surfaces():
    """Of a smooth edge, pre shows the kernels of all voxels beyond it, post the edge itself."""
    before, after = (
        render(TREE, look, Orbit(30, 20), resampler=resampler, size=SQUARE).rgba[..., 3]
        for look, resampler in ((PLAIN, SPLATS), (POST, FIELD))
    )
    assert 0 < after.sum() < 0.9 * before.sum()
