"""What must not change: mass, total opacity, even walls, pictures that turn (notes/quality.md)."""

from dataclasses import replace

import numpy as np
import pytest

from resample.cameras.models import Camera
from resample.painting.choices import Footprint
from resample.profiles.orders import EverySample
from resample.profiles.reconstruction import GaussianKernel
from resample.resampler import Resampler
from resample_comparisons.volume.painting import AxisSheets, ImageSheets
from resample_volume.classification.presets import load_transfer
from resample_volume.files.generated import vessel_tree
from resample_volume.voxels.framing import centered
from tests.benchmarks import volume_scenes as scenes
from tests.benchmarks.volume_scenes import SPLATS, Scene, Shot
from tests.naive import all_line_integrals, composite, in_camera


@pytest.fixture(scope="module")
def tree():
    return Scene(centered(vessel_tree(32))[0], load_transfer("vessels"))


@pytest.mark.parametrize("scale", [2.0, 1.0, 0.7, 0.4, 0.25])
def test_total_opacity_does_not_depend_on_the_zoom(tree, scale):
    totals = []
    for each in (4.0, scale):
        shot = scenes.across(each, 28)
        totals.append(scenes.total_opacity(Resampler(), tree.samples(shot), shot))
    assert totals[1] == pytest.approx(totals[0], rel=1e-3)


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.parametrize(
    "order",
    [
        pytest.param(ImageSheets(), id="slabs"),
        pytest.param(EverySample(), marks=pytest.mark.sweep, id="every-sample"),
    ],
)
def test_total_opacity_does_not_depend_on_how_finely_a_smooth_field_is_sampled(order):
    shot = scenes.across(1.5, 22)
    coarse, fine = (
        scenes.total_opacity(
            Resampler(order=order), scenes.ball(20, each, 0.25).samples(shot), shot
        )
        for each in (1.0, 0.5)
    )
    assert fine == pytest.approx(
        coarse, rel=1e-3
    )  # wider kernels blur more: denser fields need to be smoother


@pytest.mark.parametrize("oblique", [False, True])
@pytest.mark.parametrize("kind", ["thin", "thick", "gentle"])
def test_an_evenly_colored_wall_is_even(kind, oblique):
    shot = scenes.wall_shot(oblique=oblique)
    picture = shot.by(Resampler(), scenes.wall(kind).samples(shot))
    assert picture[..., 3].min() > 0.5
    assert scenes.unevenness(picture) < 1.0  # levels of 255; not to be seen


@pytest.mark.sweep
def test_slabs_do_not_pop_where_sheets_along_the_lattice_do():
    azimuths = np.arange(44.7, 45.31, 0.1)
    scene = scenes.checker(16, 4, 0.9)
    axis, image = (
        scenes.turned(scene, Resampler(order=order), azimuths).max()
        for order in (AxisSheets(), ImageSheets())
    )
    assert image < axis / 100  # measured: a 500th on the larger box of the tables


@pytest.mark.sweep
@pytest.mark.slow
def test_samples_ordered_by_distance_pop_less_than_a_twentieth_of_sheets_along_the_lattice():
    azimuths = np.arange(44.7, 45.31, 0.1)
    scene = scenes.checker(32, 4, 0.9)
    axis, every = (
        scenes.turned(scene, Resampler(order=order), azimuths).max()
        for order in (AxisSheets(), EverySample(key="distance"))
    )
    assert every < axis / 20


@pytest.mark.sweep
def test_exact_footprints_are_far_above_affine_ones_at_45_degrees(record):
    side = 120
    camera = Camera.from_fov(100, height=side, width=side)
    samples = scenes.off_axis(45)
    shot = Shot(camera, side, side)
    integrals = all_line_integrals(samples, camera, GaussianKernel(), height=side, width=side)
    depth = in_camera(camera, samples.position)[:, 2]
    truth = composite(1 - np.exp(-1.5 * integrals), samples.color, depth)
    exact, affine = (
        scenes.object_psnr(shot.by(replace(SPLATS, footprint=footprint), samples), truth)
        for footprint in (Footprint.EXACT, Footprint.AFFINE)
    )
    assert exact > affine + 20  # dB
    record.quality("exact", exact)
