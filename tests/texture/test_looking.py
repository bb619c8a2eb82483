"""Pixels that look at a source, against rays so many that no rule of boxes matters."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from resample import registry
from resample.profiles.interpolation import (
    AreaSpline,
    Bilinear,
    InterpolatingCatmullRom,
    InterpolatingLanczos,
    Nearest,
)
from resample_texture import BackwardMap, Edge, Homography, warp
from resample_texture.geometry.mappings import source_coordinates
from resample_texture.methods.forward import Hybrid
from resample_texture.texels import gather
from resample_texture.texels.forward import CellGrid
from tests.bits import assert_threads_change_nothing

SHAPE = (14, 17)
LINEAR = AreaSpline(limit="none")


def look(source, geometry, shape, edge, cells):
    """Picture of pixels that look."""
    return gather.gather(gather.planned(source.shape[:2], geometry, shape, edge, cells), source)


def noise(height=23, width=26, channels=2):
    return np.random.default_rng(7).random((height, width, channels), np.float32)


def about(angle=0.0, scale=1.0, tilt=0.0):
    """Homography about the middles of source and target, in degrees and 1 / px."""
    turn = np.radians(angle)
    cosine, sine = scale * np.cos(turn), scale * np.sin(turn)
    matrix = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [tilt, 0.5 * tilt, 1.0]])
    there = np.array([[1.0, 0.0, SHAPE[1] / 2], [0.0, 1.0, SHAPE[0] / 2], [0.0, 0.0, 1.0]])
    back = np.array([[1.0, 0.0, -13.0], [0.0, 1.0, -11.5], [0.0, 0.0, 1.0]])
    return Homography(there @ matrix @ back)


def rays(source, geometry, shape, edge, interpolation, count=16):
    """Mean (h, w, C) of count × count rays per pixel, and the share of rays that hit the source."""
    height, width, channels = source.shape
    fine = Homography(np.diag([count, count, 1.0]) @ geometry.matrix)
    u, v = source_coordinates(fine, (shape[0] * count, shape[1] * count), source.shape[:2])
    hit = np.isfinite(u)
    if edge is Edge.TRANSPARENT:
        hit &= (u >= 0) & (u <= width) & (v >= 0) & (v <= height)
    weight_u, index_u = along(u[hit], width, edge, interpolation)
    weight_v, index_v = along(v[hit], height, edge, interpolation)
    values = np.zeros((*u.shape, channels))
    values[hit] = sum(
        (weight_u[n] * weight_v[m])[:, None]
        * coefficients(source, edge, interpolation)[index_v[m], index_u[n]]
        for n in range(len(weight_u))
        for m in range(len(weight_v))
    )
    split = shape[0], count, shape[1], count
    coverage = hit.reshape(split).mean(axis=(1, 3))
    return values.reshape(*split, channels).mean(axis=(1, 3)), coverage


MARGIN = 40


def coefficients(source, edge, interpolation):
    """Coefficients of the source with a margin, by solving for them in the frequency domain."""
    mode = {Edge.CLAMP: "edge", Edge.WRAP: "wrap"}.get(edge, "symmetric")
    wide = np.pad(source.astype(float), ((MARGIN, MARGIN), (MARGIN, MARGIN), (0, 0)), mode=mode)
    reach = int(np.ceil(interpolation.radius)) + 1
    for axis, size in enumerate(wide.shape[:2]):
        ring = np.zeros(size)
        for step in range(-reach, reach + 1):
            # What a sample has of the coefficient so many steps away: the value there, or the mean
            is_mean = getattr(interpolation, "is_mean", False)
            at = np.abs(step + ((np.arange(2000) + 0.5) / 2000 - 0.5 if is_mean else np.zeros(1)))
            ring[step % size] = np.where(at <= interpolation.radius, interpolation(at), 0.0).mean()
        shape = [1, 1, 1]
        shape[axis] = size
        response = np.fft.fft(ring / ring.sum()).reshape(shape)
        wide = np.fft.ifft(np.fft.fft(wide, axis=axis) / response, axis=axis).real
    return wide


def along(at, size, edge, interpolation):
    """Weights and indices (with a margin) of the texels around places, (K, N) each."""
    nearest = np.floor(at).astype(int)
    reach = int(np.ceil(interpolation.radius))
    weights, indices = [], []
    for step in range(-reach, reach + 1):
        distance = np.abs(at - nearest - step - 0.5)
        inside = np.minimum(distance, interpolation.radius)
        weights.append(np.where(distance <= interpolation.radius, interpolation(inside), 0.0))
        indices.append(nearest + step)
    indices = np.array(indices)
    if edge is Edge.WRAP:
        indices %= size
    elif edge is Edge.CLAMP:
        indices = np.clip(indices, -MARGIN + 1, size + MARGIN - 1)
    else:
        indices %= 2 * size
        indices = np.minimum(indices, 2 * size - 1 - indices)
    weights = np.array(weights)
    return weights / weights.sum(axis=0), indices + MARGIN


def decibels(found, truth):
    return -10 * np.log10(np.mean((found - truth) ** 2))


VIEWS = {
    "grown": about(10.0, 3.1, 1e-3),
    "turned": about(7.0, 1.0),
    "by 45": about(45.0, 0.9),
    "leaning": Homography(
        about(20.0, 0.8).matrix @ [[1.0, 0.6, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    ),
    "uneven": Homography(np.array([[2.0, 0.4, -20.0], [-0.3, 0.5, 6.0], [0.002, 0.003, 1.0]])),
    "shrunk": about(30.0, 0.45, 2e-3),
}


@pytest.mark.sweep
@pytest.mark.parametrize("edge", Edge)
@pytest.mark.parametrize(
    "view",
    [
        pytest.param(
            view,
            marks=pytest.mark.sweep
            if view in ("turned", "by 45")  # parts of others
            else (),
        )
        for view in VIEWS
    ],
)
def test_pixels_see_what_rays_see(view, edge, record):
    source, geometry = noise(), VIEWS[view]
    warped = look(source, geometry, SHAPE, edge, CellGrid(interpolation=LINEAR, quality=4.0))
    image, coverage = rays(source, geometry, SHAPE, edge, AreaSpline())
    inside = coverage == 1
    record.quality("picture", decibels(warped.image[inside], image[inside]))
    np.testing.assert_allclose(warped.coverage, coverage, atol=0.04)  # 256 rays
    record.error("coverage", np.sqrt(np.mean((warped.coverage - coverage) ** 2)))


@pytest.mark.some(1)
@pytest.mark.parametrize("name", registry.names("interpolations"))
def test_every_interpolation_is_what_rays_see(name, record):
    interpolation = LINEAR if name == "area-spline" else registry.build("interpolations", name)
    source, geometry = noise(), VIEWS["turned"]
    cells = CellGrid(interpolation=interpolation, quality=6.0)
    warped = look(source, geometry, SHAPE, Edge.MIRROR, cells)
    image, _ = rays(source, geometry, SHAPE, Edge.MIRROR, interpolation)
    record.quality("picture", decibels(warped.image, image))


@pytest.mark.sweep
@pytest.mark.parametrize(
    "interpolation",
    [
        Nearest(),
        Bilinear(),
        InterpolatingCatmullRom(),
        InterpolatingLanczos(),
        AreaSpline(3, "none"),
    ],
    ids=repr,
)
@pytest.mark.parametrize(
    "scale", [(3.0, 2.5), (1 / 1.7, 1 / 2.3), (1 / 3.7, 1 / 6.1), (1 / 11, 1 / 9)]
)
@pytest.mark.parametrize("channels", [1, 2, 3])
def test_along_the_axes_means_are_exact(interpolation, channels, scale):
    source = noise(90, 80, channels)
    geometry = Homography(np.diag([*scale, 1.0]))
    shape = (8, 7)
    warped = look(source, geometry, shape, Edge.MIRROR, CellGrid(interpolation=interpolation))
    image, _ = rays(source, geometry, shape, Edge.MIRROR, interpolation, 64)
    np.testing.assert_allclose(
        warped.image, image, atol=0.015 if interpolation == Nearest() else 1e-3
    )  # rays skip steps


def test_whole_texels_shrink_to_their_means():
    source = noise(120, 90, 3)
    image = look(
        source, Homography(np.diag([1 / 30, 1 / 30, 1.0])), (4, 3), Edge.TRANSPARENT, CellGrid()
    ).image
    means = source.reshape(4, 30, 3, 30, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(image, means, atol=2e-6)


@pytest.mark.parametrize("degree", [2, 3, 4, 5])
def test_the_identity_is_the_picture_and_near_it_nothing_jumps(degree, record):
    source, shape = noise(), (23, 26)
    cells = CellGrid(interpolation=AreaSpline(degree))
    still = look(source, Homography(np.eye(3)), shape, Edge.CLAMP, cells)
    np.testing.assert_allclose(still.image, source, atol=5e-6)
    moved = Homography([[1.0, 0.0, 1e-4], [0.0, 1.0, -1e-4], [0.0, 0.0, 1.0]])
    image = look(source, moved, shape, Edge.CLAMP, cells).image
    record.error("step", np.abs(image - still.image).max())


@pytest.mark.parametrize("edge", Edge)
def test_a_map_is_the_homography_it_is_made_of(edge):
    source, geometry = noise(), VIEWS["turned"]
    mapped = BackwardMap(*source_coordinates(geometry, SHAPE, source.shape[:2]))
    straight = look(source, geometry, SHAPE, edge, CellGrid())
    found = look(source, mapped, SHAPE, edge, CellGrid())
    np.testing.assert_allclose(found.image, straight.image, atol=2e-4)
    np.testing.assert_allclose(found.coverage, straight.coverage, atol=1e-6)


@pytest.mark.parametrize("edge", [Edge.CLAMP, Edge.WRAP, Edge.MIRROR])
def test_far_beyond_an_edge_is_what_stands_there(edge):
    source = noise(9, 11, 1)
    far = Homography([[1.0, 0.0, 0.3], [0.0, 1.0, 0.2], [0.0, 0.0, 1.0]])
    period = np.array([[1.0, 0.0, 11.0 * 200], [0.0, 1.0, -9.0 * 300], [0.0, 0.0, 1.0]])
    image = look(source, Homography(period @ far.matrix), SHAPE, edge, CellGrid()).image
    if edge is Edge.CLAMP:
        np.testing.assert_allclose(image[..., 0], source[-1, 0, 0], atol=1e-5)
    else:
        near = look(source, far, SHAPE, edge, CellGrid()).image
        np.testing.assert_allclose(image, near, atol=1e-5)


@pytest.mark.sweep
def test_a_pixel_sees_the_share_of_it_that_the_source_covers(record):
    geometry = about(30.0, 0.7)
    white = np.ones((23, 26, 1), np.float32)
    warped = look(white, geometry, SHAPE, Edge.TRANSPARENT, CellGrid())
    _, coverage = rays(white, geometry, SHAPE, Edge.TRANSPARENT, Bilinear(), 64)
    record.error("coverage", np.sqrt(np.mean((warped.coverage - coverage) ** 2)))
    np.testing.assert_allclose(warped.image[..., 0], warped.coverage, atol=5e-6)


def test_threads_change_nothing():
    source = noise(200, 180, 3)
    assert_threads_change_nothing(lambda: warp(source, VIEWS["shrunk"].matrix, (120, 140)).image)


@pytest.mark.parametrize("channels", [1, 2, 3, 4, 7])
def test_channels_do_not_see_each_other(channels):
    source = noise(channels=channels)
    together = look(source, VIEWS["turned"], SHAPE, Edge.WRAP, CellGrid()).image
    for c in range(channels):
        channel = np.ascontiguousarray(source[..., c : c + 1])
        alone = look(channel, VIEWS["turned"], SHAPE, Edge.WRAP, CellGrid()).image
        np.testing.assert_allclose(together[..., c], alone[..., 0], atol=1e-6)


number = st.floats(-3, 3, allow_subnormal=False)


@pytest.mark.sweep
@settings(max_examples=80)
@given(st.tuples(number, number, number, number), st.tuples(number, number), st.sampled_from(Edge))
def test_any_affine_map_stays_near_the_range_of_a_constant(sides, place, edge):
    matrix = np.array([[*sides[:2], 5 * place[0]], [*sides[2:], 5 * place[1]], [0.0, 0.0, 1.0]])
    if abs(np.linalg.det(matrix)) < 1e-3:
        return
    warped = look(
        np.full((9, 8, 1), 0.25, np.float32), Homography(matrix), (6, 7), edge, CellGrid()
    )
    np.testing.assert_allclose(warped.image[..., 0], 0.25 * warped.coverage, atol=1e-5)
    assert (warped.coverage >= 0).all()
    assert (warped.coverage <= 1).all()
    if edge is not Edge.TRANSPARENT:
        assert (warped.coverage == 1).all()


@pytest.mark.sweep
@pytest.mark.parametrize(
    "error",
    [0.002, *(pytest.param(error, marks=pytest.mark.sweep) for error in (0.02, 0.007, 0.001))],
)
def test_an_error_that_is_asked_for_holds(error):
    source = noise(60, 60, 1)
    worst = about(45.0, 0.3)
    for geometry in (worst, about(15.0, 1.0), VIEWS["uneven"], VIEWS["shrunk"]):
        matrix = geometry.matrix @ [[1.0, 0.0, -17.0], [0.0, 1.0, -18.5], [0.0, 0.0, 1.0]]
        exact, _ = rays(source, Homography(matrix), SHAPE, Edge.MIRROR, LINEAR, 24)
        method = Hybrid(interpolation=LINEAR, error=error)
        found = method(source, Homography(matrix), SHAPE, Edge.MIRROR).image
        assert np.sqrt(np.mean((found - exact) ** 2)) < error


@pytest.mark.parametrize("error", [0.0, 0.0001, -1.0, np.nan, np.inf, "small"])
def test_an_error_that_cannot_be_held_is_refused(error):
    with pytest.raises(ValueError, match=r"error is a share of the range, 0\.0007 or more, not"):
        Hybrid(error=error)


@pytest.mark.sweep
@pytest.mark.parametrize("name", registry.names("interpolations"))
def test_gray_is_what_each_channel_is(name):
    interpolation = registry.build("interpolations", name)
    source = noise(90, 80, 1)
    for scale in np.geomspace(0.06, 3.0, 30):
        geometry, shape = Homography(np.diag([scale, scale, 1.0])), (6, 5)
        gray, both = (
            look(each, geometry, shape, Edge.CLAMP, CellGrid(interpolation=interpolation)).image
            for each in (source, np.repeat(source, 2, axis=2))
        )
        np.testing.assert_allclose(gray[..., 0], both[..., 1], atol=3e-6)
