"""What does not go together with rays is refused in one line that says what does."""

import numpy as np
import pytest

from resample.cameras.models import Orthographic
from resample.painting.choices import Footprint, Opacity, Primitive, Projection
from resample.painting.splines import spline_of
from resample.profiles.orders import EverySample, Rays
from resample.profiles.reconstruction import BSplineKernel
from resample.resampler import Resampler
from resample.types import Classifier, LatticeField, Samples
from resample_comparisons.volume.painting import ImageSheets
from tests.samples import DARK, POSE

CAMERA = Orthographic(2.0, 2.0, 8.0, 8.0, POSE)
LOOK = Classifier(np.ones((1, 2, 4), np.float32), 0.0, 1.0, 1.0, DARK, 0.0, 1.0, 0.0)
NOWHERE = np.zeros((0, 3), np.float32)


def on_a_lattice() -> LatticeField:
    spline, bounds = spline_of(np.ones((3, 3, 3), np.float32))
    return LatticeField(spline, bounds, np.zeros(0, np.uint8), np.eye(3), -np.ones(3), LOOK)


def draw(samples: Samples | LatticeField, resampler: Resampler) -> str:
    """Complaint about what a renderer was given."""
    with pytest.raises(ValueError, match="belong together") as caught:
        resampler(samples, CAMERA, height=16, width=16)
    return str(caught.value)


@pytest.mark.parametrize(
    ("choice", "name"),
    [
        ({"primitive": Primitive.SPLATS}, "primitive splats"),
        ({"primitive": Primitive.EWA}, "primitive ewa"),
        ({"footprint": Footprint.CORRECTED}, "footprint corrected"),
        ({"reconstruction": BSplineKernel()}, "reconstruction BSplineKernel"),
        ({"threshold": 2.5}, "threshold 2.5"),
        ({"opacity": Opacity.LINEAR}, "opacity linear"),
    ],
)
def test_rays_paint_no_samples(choice: dict[str, object], name: str) -> None:
    with pytest.raises(ValueError, match=f"paint no samples, so they have no {name}") as caught:
        Resampler(order=Rays(), **choice)  # type: ignore[arg-type]
    assert "take the order every-sample, or leave it out" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("order", [EverySample(), ImageSheets()])
def test_a_field_on_a_lattice_needs_rays(order: EverySample | ImageSheets) -> None:
    said = draw(on_a_lattice(), Resampler(order=order))
    assert "got LatticeField and " + type(order).__name__ in said
    assert "\n" not in said


def test_rays_need_a_field_on_a_lattice() -> None:
    said = draw(
        Samples(NOWHERE, NOWHERE, np.zeros(0, np.float32), np.eye(3)), Resampler(order=Rays())
    )
    assert "got Samples and Rays(" in said
    assert "\n" not in said


def test_projections_need_rays() -> None:
    for order in (EverySample(), ImageSheets()):
        with pytest.raises(ValueError, match="the projection maximum needs the order rays, not"):
            Resampler(projection=Projection.MAXIMUM, order=order)


@pytest.mark.parametrize("iso", [None, np.nan, np.inf])
def test_a_first_hit_needs_a_finite_value(iso: float | None) -> None:
    with pytest.raises(ValueError, match=r"first-hit needs an iso|it must be finite"):
        Resampler(projection=Projection.FIRST_HIT, order=Rays(), iso=iso)


def test_an_iso_value_is_for_first_hits() -> None:
    with pytest.raises(ValueError, match="which no other projection has"):
        Resampler(iso=1.0)


@pytest.mark.parametrize("step", [0.0, 0.009, 4.1, -1.0, float("nan"), float("inf")])
def test_a_step_is_neither_too_short_nor_too_long(step: float) -> None:
    with pytest.raises(ValueError, match=f"a step of {step} voxels; 0.01 to 4 are allowed"):
        Rays(step=step)


@pytest.mark.parametrize("sharpness", [-0.01, 1.01, float("nan")])
def test_sharpness_is_a_share(sharpness: float) -> None:
    with pytest.raises(ValueError, match=f"the sharpness is {sharpness}; 0 to 1 is allowed"):
        Rays(sharpness=sharpness)


@pytest.mark.parametrize("projection", [Projection.MAXIMUM, Projection.MINIMUM])
def test_rays_project_without_other_choices(projection: Projection) -> None:
    assert Resampler(order=Rays(), projection=projection).order == Rays(1.0, 1.0)
