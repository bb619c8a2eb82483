"""Arguments that take objects by name, enumerations by text, and numbers of plugins."""

import pickle
from typing import Any, get_args

import numpy as np
import pytest

import resample_gradients as differentiable
import resample_points as points
import resample_texture as texture
import resample_volume as volume
import resample_warp3d as warp3d
from resample import Camera, Footprint, Opacity, Primitive, Resampler, Scatter, registry
from resample.cameras.models import LensModel
from resample.painting.choices import FootprintName, Projection, ProjectionName
from resample.painting.ellipsoids import ShapedOrder
from resample.profiles.filters import Box, Gaussian, Mitchell, Tent
from resample.profiles.interpolation import (
    Bilinear,
    InterpolatingCubic,
    InterpolatingGaussian,
    Nearest,
)
from resample.profiles.orders import EverySample, Rays
from resample.profiles.reconstruction import BSplineKernel, GaussianKernel
from resample_comparisons.volume.painting import ImageSheets
from resample_meshes.rendering import MeshStyle
from resample_points.painting.gaussians import GaussianAppearance
from resample_points.painting.rendering import Shading
from resample_texture.geometry.projections import FisheyePicture
from resample_volume.appearance import Classification
from tests.core.test_bad_arguments import complaint

# Arguments that take a plugin by name or as an object: class, keyword, a name, and the object.
BY_NAME: list[tuple[Any, str, str, Any]] = [
    (Resampler, "order", "rays", Rays()),
    (Resampler, "order", "image-sheets:thickness=2", ImageSheets(2)),
    (Resampler, "pixel_filter", "tent", Tent()),
    (Resampler, "reconstruction", "bspline:radius=1.5", BSplineKernel(1.5)),
    (texture.Hybrid, "filter", "tent", Tent()),
    (texture.Hybrid, "interpolation", "bilinear", Bilinear()),
    (texture.Points, "filter", "tent", Tent()),
    (texture.Supersample, "filter", "tent", Tent()),
    (texture.Supersample, "interpolation", "nearest", Nearest()),
    (MeshStyle, "interpolation", "bilinear", Bilinear()),
    (MeshStyle, "pixel_filter", "tent", Tent()),
    (points.ProjectedCamera, "projection", "fisheye:fov=200", FisheyePicture(200)),
    (differentiable.LinearWarp, "interpolation", "bilinear", Bilinear()),
]
# Arguments that take a member of an enumeration, or its text.
MEMBERS: list[tuple[Any, str, Any]] = [
    (Resampler, "primitive", Primitive.POINTS),
    (Resampler, "footprint", Footprint.AFFINE),
    (Resampler, "opacity", Opacity.LINEAR),
    (Resampler, "projection", Projection.COMPOSITE),
    (volume.Appearance, "classification", Classification.POST),
    (points.CloudStyle, "light", Shading.HEADLIGHT),
    (points.GaussianStyle, "appearance", GaussianAppearance.BARE),
    (points.GaussianStyle, "order", ShapedOrder.RAYS),
    (Camera, "model", LensModel.FISHEYE),
]
# Numbers of plugins and methods.
OF_PARTS: list[tuple[Any, str]] = [
    (EverySample, "thickness"), (ImageSheets, "thickness"), (Rays, "step"), (Rays, "sharpness"),
    (Box, "radius"), (Gaussian, "sigma"), (Mitchell, "b"), (Tent, "radius"),
    (GaussianKernel, "sigma"), (GaussianKernel, "radius"), (BSplineKernel, "radius"),
    (InterpolatingCubic, "a"), (InterpolatingGaussian, "sigma"), (MeshStyle, "quality"),
    (texture.Splats, "sigma"), (texture.Paper, "threshold"), (warp3d.Hybrid, "quality"),
]  # fmt: skip
LOOKS = "light gradient gradient_opacity classification labels cue crop clip framing meshes planes"


@pytest.mark.parametrize(("kind", "name", "given", "wanted"), BY_NAME)
def test_plugins_are_taken_by_name(kind: Any, name: str, given: str, wanted: Any) -> None:
    by_name = kind(**{name: given})
    assert getattr(by_name, name) == wanted
    assert getattr(kind(**{name: wanted}), name) is wanted
    assert getattr(pickle.loads(pickle.dumps(by_name)), name) == wanted
    for bad in ("nope", 3, [1], type(wanted)):
        known = registry.names({"pixel_filter": "filters"}.get(name, f"{name}s"))
        assert ", ".join(known) in complaint(lambda bad=bad: kind(**{name: bad}))


def test_a_filter_of_scattered_samples_is_an_object_or_a_name() -> None:
    assert complaint(lambda: Scatter(pixel_filter=3)).startswith("pixel_filter 3; known filters:")


@pytest.mark.parametrize(("kind", "name", "member"), MEMBERS)
def test_members_of_enumerations_are_taken_as_texts(kind: Any, name: str, member: Any) -> None:
    start = (np.eye(3),) if kind is Camera else ()
    found = getattr(kind(*start, **{name: member.value}), name)
    assert found == member
    for bad in ("nope", 3, [1]):
        said = complaint(lambda bad=bad: kind(*start, **{name: bad}))
        assert member.value in said


def test_names_that_type_checkers_know_are_those_of_the_enumerations() -> None:
    for kind, names in ((Footprint, FootprintName), (Projection, ProjectionName)):
        assert get_args(names) == tuple(kind)


def test_a_resampler_by_names_is_one_by_objects() -> None:
    by_name = Resampler(primitive="splats", opacity="linear", reconstruction="bspline")
    by_object = Resampler(Primitive.SPLATS, opacity=Opacity.LINEAR, reconstruction=BSplineKernel())
    assert by_name == by_object
    assert by_name != Resampler("splats", reconstruction="bspline")


@pytest.mark.parametrize(("kind", "name"), OF_PARTS)
def test_numbers_of_plugins_and_methods_are_numbers(kind: Any, name: str) -> None:
    for bad in ("high", [1, 2]):
        assert complaint(lambda bad=bad: kind(**{name: bad})).startswith(name)


@pytest.mark.parametrize("name", [*LOOKS.split(), "surfaces", "slab", "xray"])
def test_what_an_appearance_is_made_of_is_checked(name: str) -> None:
    texts = {"crop", "clip", "framing"}  # read when the volume is known
    for bad in ([1], 3, *([] if name in texts else ["nope"])):
        said = complaint(lambda bad=bad: volume.Appearance("0..1", **{name: bad}))
        assert name.rstrip("s") in said
    with pytest.raises((TypeError, ValueError), match=r"window .*; give two ascending values"):
        volume.XRay(window="nope")


def test_one_plane_mesh_or_surface_of_an_appearance_needs_no_list() -> None:
    look = volume.Appearance("0..1", clip="1/0/0", planes="z=1", surfaces="0.5")
    assert look == volume.Appearance("0..1", clip=("1/0/0",), planes=["z=1"], surfaces=["0.5"])
