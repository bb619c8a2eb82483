import math
from dataclasses import replace

import numpy as np
import pytest

from resample.cameras.models import Camera
from resample.cameras.poses import look_at
from resample.colors import to_srgb
from resample.command.settings import Resampling
from resample.painting.choices import Footprint, Primitive
from resample.profiles.filters import Gaussian
from resample.resampler import Resampler
from resample_comparisons.volume.command import Projecting
from resample_comparisons.volume.compare import Contest, variants
from resample_comparisons.volume.painting import ImageSheets
from resample_volume.command.choices import AppearanceChoices
from resample_volume.files.generated import checker_box
from resample_volume.rendering import Subject
from resample_volume.voxels.framing import centered

SPLATS = Resampler(primitive=Primitive.SPLATS)


BOX, LOOK, SIZE = checker_box(16, 4), AppearanceChoices(camera="30/20/0.5"), (24, 32)


def contest(rays: int, resampler: Resampler = SPLATS) -> Contest:
    """View of a box whose reference is there."""
    subject = Subject.of(BOX, LOOK.appearance(BOX), resampler)
    made = Contest(subject, None, subject.camera(LOOK.viewpoint(), *SIZE), SIZE)
    made.splatted(resampler, rays)
    return made


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
        (["dots"], [], "method 'dots'; known: hybrid, points, splats, paper, inflate, ewa"),
        (
            ["points"],
            ["round"],
            "footprint 'round'; known: affine, corrected, exact, equation, projected",
        ),
        ([], [], "give a method to compare; known: hybrid, points"),
    ],
)
def test_unknown_names_list_the_known(primitives, footprints, complaint):
    with pytest.raises(ValueError, match=complaint):
        variants(Resampler(), primitives, footprints)


def test_orders_are_variants_too():
    choice = variants(Resampler(), ["hybrid"], orders=["axis-sheets", "image-sheets:thickness=0.5"])
    assert list(choice) == ["hybrid axis-sheets", "hybrid image-sheets:thickness=0.5"]
    assert choice["hybrid image-sheets:thickness=0.5"].order == ImageSheets(0.5)


def test_what_does_not_go_together_is_refused():
    with pytest.raises(ValueError, match="the primitive ewa goes with the footprint exact, not"):
        variants(Resampler(), ["ewa"], ["affine"])


def test_the_reference_comes_first_and_every_picture_has_a_row(record):
    made = contest(4)
    for name, resampler in variants(Resampler(), ["points", "splats"]).items():
        made.draw(name, resampler)
    assert list(made.pictures) == ["reference, 4 x 4 splats", "points", "splats"]
    assert [row["picture"] for row in made.rows] == ["points", "splats"]
    assert all(picture.shape == (24, 32, 4) for picture in made.pictures.values())
    for row in made.rows:
        record.quality(row["picture"], row["psnr"])
        assert row["ms"] > 0
    assert [row["splats"] for row in made.rows] == ["0.0 %", "100.0 %"]


def test_what_the_reference_is_made_of_equals_it():
    made = contest(1)
    made.draw("splats", SPLATS)
    assert made.rows[0]["psnr"] == math.inf
    assert made.rows[0]["ssim"] == pytest.approx(1)


def test_more_rays_do_not_change_what_is_measured_much(record):
    made = [contest(rays) for rays in (8, 16)]
    for one in made:
        one.draw("splats", SPLATS)
    record.error("change, dB", abs(made[0].rows[0]["psnr"] - made[1].rows[0]["psnr"]))


@pytest.mark.sweep
def test_slabs_come_to_what_rays_through_the_field_see(record):
    thin = replace(SPLATS, subpixels=2, order=ImageSheets(0.25))
    made = contest(2, thin)
    made.pictures.clear()
    made.cast(thin, 2)
    made.draw("slabs", thin)
    record.quality("slabs", made.rows[0]["psnr"])


def test_vtk_is_measured_where_it_is_installed(record):
    pytest.importorskip("vtkmodules", exc_type=ImportError)
    made = contest(2)
    made.draw_vtk(centered(BOX)[0], 2)
    assert made.rows[0]["picture"] == "VTK, 2 x 2 rays"
    record.quality("VTK", made.rows[0]["psnr"])  # it reconstructs by other kernels


def test_differences_are_gray_where_there_are_none():
    made = contest(1)
    made.draw("splats", SPLATS)
    (error,) = made.differences().values()
    assert np.allclose(to_srgb(error), 0.5, atol=1e-6)


def test_a_view_of_nothing_is_compared():
    made = contest(2)
    away = Camera.from_fov(
        30, height=24, width=32, world_to_camera=look_at((0, -90, 0), (0, -99, 0))
    )
    empty = Contest(made.subject, None, away, SIZE)
    empty.splatted(SPLATS, 2)
    empty.draw("hybrid", Resampler())
    assert empty.rows[0]["psnr"] == math.inf


def test_a_projection_is_what_the_renderer_takes() -> None:
    assert Projecting(projection="maximum").resampling() == Resampling(projection="maximum")
