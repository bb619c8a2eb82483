import dataclasses
import math

import numpy as np
import pytest

from resample import registry
from resample.profiles.filters import Area, Box, Gaussian
from resample.profiles.interpolation import AreaSpline, Bilinear, InterpolatingCatmullRom
from resample_texture import BackwardMap, Edge, ForwardMap, Homography, warp
from resample_texture.geometry.mappings import source_coordinates
from resample_texture.methods.forward import Hybrid, Points, Splats, Supersample
from resample_texture.methods.paper import Paper

NAMES = registry.names("methods")
VARIANTS = [
    *NAMES,
    "hybrid:filter=gaussian,interpolation=spline,quality=3",
    "hybrid:magnified=splats",
    "splats:interpolating=true",
    "paper:threshold=0.5",
]
SPLATTED = ["hybrid:magnified=splats", "paper", "splats"]  # of maps by a kernel of their own
OURS = ["hybrid", "hybrid:magnified=splats", "paper", "points", "splats", "supersample"]
SHRUNK = Homography([[0.45, 0.06, 6.0], [-0.04, 0.42, 7.0], [0.001, 0.002, 1.0]])
GROWN = Homography([[2.1, 0.2, -9.0], [-0.1, 1.9, -7.0], [0.001, 0.003, 1.0]])
HUGE = Homography([[6.0, 0.3, -80.0], [-0.2, 6.0, -70.0], [0.0, 0.0, 1.0]])
SHAPE = (24, 26)
SOURCE = (30, 32)


def of_methods(names):
    """A test of methods."""
    return pytest.mark.parametrize("method", names)


def noise(channels):
    return np.random.default_rng(7).random((*SOURCE, channels), np.float32)


def made(method):
    return registry.build("methods", method)


def views(method):
    """Views that a method fills: points leave holes where texels grow."""
    return [SHRUNK] if method == "points" else [SHRUNK, GROWN]


def filled(geometry):
    """Pixels around which, 3 px wide, there is nothing but the source."""
    height, width = SHAPE
    corners = [(column, row) for row in (-2.5, 3.5) for column in (-2.5, 3.5)]
    inside = np.ones(SHAPE, bool)
    y, x = np.mgrid[:height, :width]
    for column, row in corners:
        u, v, d = np.tensordot(
            geometry.inverse(), np.stack([x + column, y + row, np.ones(SHAPE)]), 1
        )
        inside &= (u / d > 0) & (u / d < SOURCE[1]) & (v / d > 0) & (v / d < SOURCE[0])
    assert inside.sum() > 30
    return inside


@pytest.mark.some(6)
@of_methods(VARIANTS)
def test_a_constant_picture_stays_constant(method):
    color = np.float32([0.8, 0.1, 1.0])
    source = np.broadcast_to(color, (*SOURCE, 3)).copy()
    for view in views(method):
        warped = made(method)(source, view, SHAPE, Edge.TRANSPARENT)
        inside = filled(view)
        np.testing.assert_allclose(warped.coverage[inside], 1.0, atol=1e-6)
        np.testing.assert_allclose(warped.image[inside], np.tile(color, (inside.sum(), 1)), 1e-5)
        atol = 1e-3 if method == "oiio" else 1e-5
        np.testing.assert_allclose(warped.image, warped.coverage[..., None] * color, atol=atol)


@pytest.mark.parametrize("channels", [1, 2, 3, 4, 5])
@of_methods(VARIANTS)
def test_pictures_have_the_target_s_shape_and_the_source_s_channels(method, channels):
    source = noise(channels)
    before = source.copy()
    warped = made(method)(source, SHRUNK, SHAPE, Edge.TRANSPARENT)
    assert warped.image.shape == (*SHAPE, channels)
    assert warped.coverage.shape == SHAPE
    assert warped.image.dtype == warped.coverage.dtype == np.float32
    assert warped.coverage.min() >= 0.0
    assert warped.coverage.max() <= 1.0
    assert np.isfinite(warped.image).all()
    np.testing.assert_array_equal(source, before)


@pytest.mark.some(16)
@of_methods(VARIANTS)
def test_channels_do_not_see_each_other(method):
    source = noise(4)
    together = made(method)(source, SHRUNK, SHAPE, Edge.CLAMP).image
    for c in range(4):
        alone = made(method)(source[..., c : c + 1].copy(), SHRUNK, SHAPE, Edge.CLAMP).image
        np.testing.assert_allclose(together[..., c], alone[..., 0], atol=1e-5)


@pytest.mark.parametrize("edge", ["clamp", "wrap", "mirror"])
@of_methods(VARIANTS)
def test_beyond_a_continued_edge_all_is_covered(method, edge):
    for view in views(method):
        white = np.ones((*SOURCE, 1), np.float32)
        warped = made(method)(white, view, SHAPE, Edge(edge))
        np.testing.assert_allclose(warped.coverage, 1.0, atol=1e-6)
        np.testing.assert_allclose(warped.image, 1.0, atol=1e-5)


# Pixels that look at noise see what cells of the default quality do not tell.
FINEST = {"hybrid": {"quality": 6.0, "interpolation": "area-spline:limit=none"}}


@pytest.mark.parametrize(
    "method",
    [pytest.param(name, marks=pytest.mark.sweep) if name in SPLATTED else name for name in OURS],
)
def test_a_map_of_a_matrix_gives_what_the_matrix_gives(method, record):
    source = noise(1)
    finest = dataclasses.replace(made(method), **FINEST.get(method, {}))
    for view in views(method):
        straight = finest(source, view, SHAPE, Edge.TRANSPARENT).image
        v, u = np.mgrid[: SOURCE[0], : SOURCE[1]] + 0.5
        x, y, d = np.tensordot(view.matrix, np.stack([u, v, np.ones_like(u)]), 1)
        mapped = finest(source, ForwardMap(x / d, y / d), SHAPE, Edge.TRANSPARENT).image
        inside = filled(view)
        error = (mapped - straight)[inside]
        # A map is linear between texels; it has no edges, so that a weight below 0.97 is kept.
        record.quality("picture", 10 * np.log10(1 / np.mean(error**2)))


@of_methods(sorted(set(NAMES) - {"oiio", "paper", "splats"}))
def test_backward_maps_are_taken(method):
    white = np.ones((*SOURCE, 2), np.float32)
    geometry = BackwardMap(*source_coordinates(SHRUNK, SHAPE))
    warped = made(method)(white, geometry, SHAPE, Edge.TRANSPARENT)
    inside = filled(SHRUNK)
    np.testing.assert_allclose(warped.image[inside], 1.0, atol=1e-5)
    np.testing.assert_allclose(warped.coverage[inside], 1.0, atol=1e-6)


@pytest.mark.parametrize("method", NAMES)
def test_methods_can_be_compared_and_are_known_by_their_choices(method):
    assert made(method) == made(method)
    assert dataclasses.is_dataclass(made(method))
    with pytest.raises(dataclasses.FrozenInstanceError):
        made(method).anything = 1


def test_plugins_are_built_from_their_names():
    hybrid = Hybrid(filter="gaussian:sigma=0.4", interpolation="bilinear")
    assert hybrid.filter == Gaussian(0.4)
    assert hybrid.interpolation == Bilinear()
    assert Hybrid() == Hybrid(filter=Area(), interpolation=AreaSpline())
    assert Points().filter == Gaussian(0.5)
    assert Supersample(interpolation="catmull-rom").interpolation == InterpolatingCatmullRom()


@pytest.mark.parametrize("kind", [Hybrid, Points, Supersample])
def test_an_unknown_filter_is_answered_with_the_known_ones(kind):
    with pytest.raises(LookupError, match="known filters: area, box"):
        kind(filter="boxx")
    with pytest.raises(ValueError, match=r"filter 0\.5; known filters: area, box"):
        kind(filter=0.5)


@pytest.mark.parametrize("kind", [Hybrid, Supersample])
def test_an_unknown_reconstruction_is_answered_with_the_known_ones(kind):
    with pytest.raises(LookupError, match="known interpolations: area-spline, bilinear"):
        kind(interpolation="quadratic")
    with pytest.raises(ValueError, match="known interpolations: area-spline, bilinear"):
        kind(interpolation=None)


@pytest.mark.parametrize("quality", [0.0, 0.99, 16.1, math.nan, math.inf, -1.0])
@pytest.mark.parametrize("kind", [Hybrid, Supersample])
def test_quality_has_its_range(kind, quality):
    with pytest.raises(ValueError, match="quality lies between 1 and 16, not at"):
        kind(quality=quality)


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
@pytest.mark.parametrize(
    ("kind", "name"),
    [
        (Splats, "sigma"),
        (Splats, "filter_sigma"),
        (Paper, "sigma"),
        (Paper, "filter_sigma"),
        (Paper, "threshold"),
    ],
)
def test_widths_are_positive_numbers(kind, name, bad):
    with pytest.raises(ValueError, match=f"{name} is a positive number, not {bad}"):
        kind(**{name: bad})


def test_magnified_texels_become_one_of_two():
    with pytest.raises(ValueError, match="become cells or splats, not 'points'"):
        Hybrid(magnified="points")


@pytest.mark.parametrize("name", ["tent", "mitchell", "box"])
def test_splats_come_under_a_gaussian(name):
    with pytest.raises(ValueError, match="splats come under a Gaussian pixel filter"):
        warp(noise(1), GROWN, SHAPE, Hybrid(filter=name, magnified="splats"))


def test_only_cells_under_the_area_filter_keep_texels():
    assert Hybrid().keeps_texels
    assert not Hybrid(filter="box").keeps_texels
    assert not Hybrid(magnified="splats").keeps_texels


def test_points_leave_holes_where_texels_grow():
    white = np.ones((*SOURCE, 1), np.float32)
    warped = Points()(white, HUGE, SHAPE, Edge.TRANSPARENT)
    holes = warped.coverage[filled(HUGE)] == 0.0
    assert 0.2 < holes.mean() < 0.6  # points 6 px apart reach 4 × 4 of 36 pixels


@of_methods(sorted(set(NAMES) - {"points"}))
def test_the_others_leave_no_holes(method):
    white = np.ones((*SOURCE, 1), np.float32)
    coverage = made(method)(white, HUGE, SHAPE, Edge.TRANSPARENT).coverage
    np.testing.assert_allclose(coverage[filled(HUGE)], 1.0, atol=1e-6)


def test_a_class_in_place_of_a_filter_is_refused():
    with pytest.raises(ValueError, match="known filters: area"):
        Hybrid(filter=Box)


def test_a_quality_that_is_no_number_is_refused():
    with pytest.raises(ValueError, match="quality lies between 1 and 16, not at '2'"):
        Hybrid(quality="2")


@pytest.mark.parametrize(
    "name",
    [
        "hybrid:clamp=true,interpolation=lanczos",
        "splats:interpolating=true,clamp=true",
        "hybrid:clamp=true,magnified=splats",
    ],
)
def test_a_clamped_picture_stays_in_the_sources_range(name):
    checker = np.kron(np.indices((6, 6)).sum(axis=0) % 2, np.ones((5, 5))).astype(np.float32)
    sharp = warp(checker, GROWN, SHAPE, name.replace("clamp=true", "clamp=false"), edge="mirror")
    assert sharp.image.max() > 1.01
    clamped = warp(checker, GROWN, SHAPE, name, edge="mirror")
    assert clamped.image.min() >= 0.0
    assert clamped.image.max() <= 1.0
    inside = (sharp.image > 0.0) & (sharp.image < 1.0)
    np.testing.assert_array_equal(clamped.image[inside], sharp.image[inside])


@pytest.mark.parametrize("method", [Hybrid, Splats])
def test_totals_are_not_clamped(method):
    with pytest.raises(ValueError, match="totals are conserved"):
        method(total=True, clamp=True)
