import math

import pytest

from resample.cameras import Pinhole, look_at
from resample.filters import Gaussian
from resample.resampler import Footprint, Primitive, Resampler
from resample_volume.choices import Look
from resample_volume.compare import compare, variants
from resample_volume.generated import checker_box
from resample_volume.session import Session


@pytest.fixture(scope="module")
def scene():
    """Samples and a camera for pictures of 24 × 32 px."""
    return Session().samples(checker_box(16, 4), Look(camera="30/20/0.5"), (24, 32))


def test_there_is_a_variant_for_each_pair():
    choice = variants(Resampler(), ["points", "hybrid"], ["exact", "affine"])
    assert list(choice) == ["points exact", "points affine", "hybrid exact", "hybrid affine"]
    assert choice["points affine"].primitive is Primitive.POINTS
    assert choice["points affine"].footprint is Footprint.AFFINE


def test_names_show_only_what_differs_and_the_rest_is_kept():
    given = Resampler(pixel_filter=Gaussian(0.7), footprint=Footprint.CORRECTED)
    choice = variants(given, ["splats"], [])
    assert list(choice) == ["splats"]
    assert choice["splats"].pixel_filter == Gaussian(0.7)
    assert choice["splats"].footprint is Footprint.CORRECTED


@pytest.mark.parametrize(
    ("primitives", "footprints", "complaint"),
    [
        (["dots"], [], "primitive 'dots'; known: hybrid, points, splats, paper"),
        (["points"], ["round"], "footprint 'round'; known: affine, corrected, small-angle, exact"),
        ([], [], "give a primitive to compare; known: hybrid, points"),
    ],
)
def test_unknown_names_list_the_known(primitives, footprints, complaint):
    with pytest.raises(ValueError, match=complaint):
        variants(Resampler(), primitives, footprints)


def test_the_reference_comes_first_and_every_picture_has_a_row(scene):
    rows, pictures = compare(variants(Resampler(), ["points", "splats"], []), *scene, (24, 32), 4)
    assert list(pictures) == ["reference, 4 x 4 rays", "points", "splats"]
    assert [row["picture"] for row in rows] == ["points", "splats"]
    assert all(picture.shape == (24, 32, 4) for picture in pictures.values())
    assert all(20 < row["psnr"] < 90 and row["ms"] > 0 for row in rows)
    assert [row["splats"] for row in rows] == ["0.0 %", "100.0 %"]


def test_what_the_reference_is_made_of_equals_it(scene):
    rows, _ = compare(variants(Resampler(), ["splats"], []), *scene, (24, 32), 1)
    assert rows[0]["psnr"] == math.inf
    assert rows[0]["ssim"] == pytest.approx(1)


def test_more_rays_do_not_change_what_is_measured_much(scene):
    few, many = (
        compare(variants(Resampler(), ["splats"], []), *scene, (24, 32), rays)[0][0]["psnr"]
        for rays in (8, 16)
    )
    assert abs(few - many) < 2  # dB


def test_a_view_of_nothing_is_compared(scene):
    away = Pinhole.from_fov(
        30, height=24, width=32, world_to_camera=look_at((0, -90, 0), (0, -99, 0))
    )
    rows, _ = compare(variants(Resampler(), ["hybrid"], []), scene[0], away, (24, 32), 2)
    assert rows[0]["psnr"] == math.inf
