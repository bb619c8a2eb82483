"""Truth 4: a point deposits its energy, no more and no less, wherever it falls."""

import numpy as np
import pytest

from resample import registry
from resample.cameras.models import Camera, Orthographic
from resample.painting.choices import Primitive
from resample.profiles.filters import CatmullRom, Lanczos, Mitchell
from resample.profiles.reconstruction import GaussianKernel
from resample.types import Samples
from tests import naive
from tests.samples import painter

SIDE = 24  # px; tiles meet at 8 px or a multiple of it
DEPTH = 1000.0  # scene units: rays all but parallel, unless a test wants them otherwise
COLOR = (0.9, 0.5, 0.2)
OFFSETS = np.linspace(-0.5, 0.5, 11)  # px, from a corner of tiles
LOBED = [Mitchell(), CatmullRom(), Lanczos(2), Lanczos(3)]


def one_point(position=(0.0, 0.0, DEPTH), *, extinction=0.7, spacing=1.0):
    return Samples(
        np.array([position], np.float32),
        np.array([COLOR], np.float32),
        np.array([extinction], np.float32),
        spacing * np.eye(3),
    )


def bed(spacing_px, *, extinction=0.5):
    """A layer of points that covers the picture seen through `camera(spacing_px)` evenly."""
    reach = int(np.ceil(SIDE / spacing_px)) + 2
    axis = np.arange(-reach, reach + 1.0)
    place = np.stack(np.meshgrid(axis, axis, [DEPTH]), axis=-1).reshape(-1, 3)
    count = len(place)
    return Samples(
        place.astype(np.float32),
        np.full((count, 3), COLOR, np.float32),
        np.full(count, extinction, np.float32),
        np.eye(3),
    )


def together(*groups):
    joined = (np.concatenate([group[n] for group in groups]) for n in range(3))
    return Samples(*joined, lattice=groups[0].lattice)


def camera(spacing_px, right=0.0, down=0.0):
    """Samples are that many pixels apart at `DEPTH`; the axis meets a corner of tiles."""
    focal = spacing_px * DEPTH
    return Camera.from_intrinsics(focal, focal, 8.0 + right, 8.0 + down)


def draw(samples, seen_by, *, side=SIDE, **choices):
    return painter(**choices)(samples, seen_by, height=side, width=side)


def energy(frame):
    return frame.rgba.astype(float).sum(axis=(0, 1))


# Energy.


AS_POINTS = [
    *((Primitive.POINTS, spacing) for spacing in (0.05, 0.1, 0.3)),
    *((Primitive.PAPER, spacing) for spacing in (0.05, 0.1, 0.2, 0.3, 0.7)),
]


@pytest.mark.sweep
@pytest.mark.parametrize(("primitive", "spacing"), AS_POINTS)
def test_a_point_deposits_the_same_wherever_in_a_pixel_it_falls(primitive, spacing):
    point = one_point()
    area = spacing**2  # px² that a sample stands for
    expected = area * (1 - np.exp(-0.7)) * np.array([*COLOR, 1.0])
    for right in OFFSETS:
        for down in OFFSETS[::3]:
            frame = draw(point, camera(spacing, right, down), side=16, primitive=primitive)
            assert frame.statistics.points == 1
            # Colors: exp(-x) from a table, 7e-7. Alpha is 1 − transmittance in float32.
            np.testing.assert_allclose(energy(frame)[:3], expected[:3], rtol=1e-5)
            assert energy(frame)[3] == pytest.approx(expected[3], rel=1e-3)


@pytest.mark.sweep
@pytest.mark.parametrize("spacing", [0.21, 0.25, 0.3])
def test_a_lone_splat_on_sub_pixels_holds_its_energy_to_two_percent(spacing):
    """Hybrid draws these as splats whose neighbours are a sub-pixel apart or more, one ray each.

    A Gaussian of 0.65 sub-pixels summed at unit steps errs by 2 exp(-2 π² 0.65²) per axis.
    """
    point = one_point(extinction=0.01)
    expected = spacing**2 * 0.01
    for right in OFFSETS:
        for down in OFFSETS[::3]:
            frame = draw(point, camera(spacing, right, down), side=16)
            assert frame.statistics.splats == 1
            assert energy(frame)[0] / COLOR[0] == pytest.approx(expected, rel=0.025)


@pytest.mark.sweep
@pytest.mark.parametrize("name", registry.names("filters"))
def test_no_filter_loses_or_adds_energy(name):
    """On a bed that keeps sums under negative lobes above 0, where they are not clamped."""
    choices = {"primitive": Primitive.PAPER, "pixel_filter": registry.build("filters", name)}
    spacing = 0.5
    ground = bed(spacing)
    both = together(ground, one_point(), one_point())
    expected = 2 * spacing**2 * (1 - np.exp(-0.7)) * np.array([*COLOR, 1.0])
    for right, down in zip(OFFSETS, np.roll(OFFSETS, 4), strict=True):
        seen_by = camera(spacing, right, down)
        added = energy(draw(both, seen_by, **choices)) - energy(draw(ground, seen_by, **choices))
        np.testing.assert_allclose(added, expected, rtol=1e-4)  # float32 sums of 576 pixels


@pytest.mark.parametrize("primitive", [Primitive.POINTS, Primitive.PAPER])
@pytest.mark.parametrize("theta", [0, 20, 40, 60])
def test_a_point_off_the_axis_deposits_its_area_times_its_opacity(theta, primitive):
    """The area of a layer as its samples lie, and the way of a slanted ray through it."""
    depth = 10.0
    slant = 1 / np.cos(np.radians(theta))
    aside, focal = depth * np.tan(np.radians(theta)), 0.1
    point = one_point((aside, 0, depth), extinction=0.05)
    seen_by = Camera.from_intrinsics(focal, focal, 12.2 - focal * aside / depth, 11.9)
    frame = draw(point, seen_by, primitive=primitive)
    assert frame.statistics.points == 1
    expected = (focal / depth) ** 2 * (1 - np.exp(-0.05 * slant))
    # exp(-x) from a table: 7e-7 of 0.05.
    assert energy(frame)[0] / COLOR[0] == pytest.approx(expected, rel=5e-5)


@pytest.mark.parametrize("spacing", [0.05, 0.08, 0.2])
def test_a_pixel_that_nothing_touches_is_empty_to_the_last_bit(spacing):
    """Also within a touched tile, whatever its sub-pixels' weights sum to in float32."""
    frame = draw(one_point(), camera(spacing, 0.5, 0.5), side=16)
    away = np.ones((16, 16), bool)
    away[6:11, 6:11] = False
    assert not frame.rgba[away].any()
    assert not frame.coverage[away].any()


# Form.


def points(rng, count=50, *, extinction=2.0):
    return Samples(
        rng.uniform((-40, -40, 30), (40, 40, 50), (count, 3)).astype(np.float32),
        rng.uniform(0, 1, (count, 3)).astype(np.float32),
        rng.uniform(0, extinction, count).astype(np.float32),
        np.eye(3) * 1.5,
    )


THRESHOLD = {Primitive.HYBRID: 0.6, Primitive.POINTS: np.inf}


@pytest.mark.parametrize("primitive", [Primitive.HYBRID, Primitive.POINTS, Primitive.PAPER])
@pytest.mark.parametrize(("right", "down"), [(1, 0), (0, 1), (8, 8), (5, 3)])
def test_points_moved_by_whole_pixels_move_the_image_exactly(right, down, primitive, rng):
    place = rng.integers(-96, 96, (60, 3)) / 16
    samples = Samples(
        place.astype(np.float32),
        rng.uniform(0, 1, (60, 3)).astype(np.float32),
        rng.uniform(0, 3, 60).astype(np.float32),
        np.eye(3),
    )
    # Multiples of 1/64 px, which float32 holds.
    before = draw(samples, Orthographic(0.25, 0.25, 8.0, 8.0, near=-10.0), primitive=primitive)
    there = Orthographic(0.25, 0.25, 8.0 + right, 8.0 + down, near=-10.0)
    after = draw(samples, there, primitive=primitive)
    moved = np.roll(before.rgba, (down, right), axis=(0, 1))
    assert before.rgba[..., 3].max() > 0.01
    np.testing.assert_array_equal(after.rgba, moved)


# Limits.


@pytest.mark.parametrize("primitive", [Primitive.HYBRID, Primitive.POINTS, Primitive.PAPER])
def test_a_crowded_layer_covers_a_pixel_once(primitive):
    ground = bed(0.3, extinction=50.0)
    frame = draw(together(*[ground] * 3), camera(0.3), primitive=primitive)
    middle = frame.rgba[4:-4, 4:-4]
    np.testing.assert_allclose(middle[..., 3], 1.0, atol=1e-4)  # opaque from 1e-4 on
    np.testing.assert_allclose(middle[..., :3], middle[..., 3:] * np.array(COLOR), atol=1e-5)
    np.testing.assert_allclose(frame.coverage[4:-4, 4:-4], 1.0, atol=1e-4)
    assert frame.coverage.max() <= 1.0


@pytest.mark.parametrize("primitive", [Primitive.HYBRID, Primitive.POINTS])
def test_an_even_layer_looks_even(primitive, record):
    frame = draw(bed(0.3, extinction=1.0), camera(0.3, 0.2, 0.3), primitive=primitive)
    middle = frame.rgba[4:-4, 4:-4, 3]
    record.error("ripple", np.ptp(middle))


@pytest.mark.each_value
@pytest.mark.parametrize("lobed", LOBED, ids=repr)
@pytest.mark.parametrize("count", [1, 20, 2000])
@pytest.mark.parametrize("primitive", list(Primitive))
def test_negative_lobes_neither_take_light_nor_make_opacity(primitive, count, lobed, rng):
    samples, seen_by = (
        points(rng, count, extinction=20.0),
        Camera.from_intrinsics(14.0, 14.0, 12.0, 12.0),
    )
    frame = draw(samples, seen_by, primitive=primitive, pixel_filter=lobed)
    assert frame.rgba.min() >= 0.0
    assert frame.rgba[..., 3].max() <= 1.0
    assert frame.coverage.min() >= 0.0
    assert frame.coverage.max() <= 1.0
    assert np.isfinite(frame.rgba).all()


@pytest.mark.parametrize("lobed", LOBED, ids=repr)
@pytest.mark.parametrize("primitive", [Primitive.HYBRID, Primitive.PAPER])
def test_negative_lobes_do_not_move_what_is_plainly_seen(primitive, lobed, rng):
    samples, seen_by = (
        points(rng, 2000, extinction=20.0),
        Camera.from_intrinsics(14.0, 14.0, 12.0, 12.0),
    )
    frame = draw(samples, seen_by, primitive=primitive, pixel_filter=lobed)
    plain = frame.rgba[..., 3] > 0.5
    assert plain.sum() > 30
    overshoot = 2.0  # of a range of 20: sums under negative lobes leave the range of what is summed
    assert frame.depth[plain].min() >= samples.position[:, 2].min() - overshoot
    assert frame.depth[plain].max() <= samples.position[:, 2].max() + overshoot


def light_of_rays(extinction):
    """Light of a lone splat: what fine rays through it lose, in squared sample spacings."""
    point, seen_by = one_point(extinction=extinction), camera(4.0)
    integral = naive.all_line_integrals(point, seen_by, GaussianKernel(), height=16, width=16)
    return (1 - np.exp(-extinction * integral)).sum() / 4.0**2


@pytest.mark.some(1)
@pytest.mark.parametrize("subpixels", [1, 2, 3, 5])
@pytest.mark.parametrize("extinction", [0.01, 0.7, 20.0])
def test_a_chosen_grid_conserves_light_too(subpixels, extinction):
    """A splat smaller than a sub-pixel is as bright as when it was large, wherever it lies."""
    expected = 0.1**2 * light_of_rays(extinction)
    found = []
    for right in OFFSETS:
        point = one_point(extinction=extinction)
        frame = draw(point, camera(0.1, right, 0.3), subpixels=subpixels)
        assert frame.statistics.subpixels == subpixels
        found.append(energy(frame)[0] / COLOR[0])
        assert found[-1] == pytest.approx(expected, rel=1e-3)  # rays of a quarter of a spacing
    assert np.ptp(found) < 1e-5 * expected


@pytest.mark.parametrize("subpixels", [1, 2, 4])
def test_nothing_pops_where_splats_become_larger_than_sub_pixels(subpixels):
    """Light does not step, and no pixel changes by more than a tenth of a splat's peak."""
    for extinction in (0.01, 3.0):
        seen = []
        for spacing in np.geomspace(0.8, 1.1, 33) / subpixels:
            point = one_point(extinction=extinction)
            frame = draw(point, camera(spacing, 0.13, 0.31), subpixels=subpixels)
            seen.append(frame.rgba[..., 0] / COLOR[0])
        light = np.array([picture.sum() for picture in seen]) / np.geomspace(0.8, 1.1, 33) ** 2
        assert np.ptp(light) < 5e-3 * light.mean()  # sums of a Gaussian at unit steps
        assert np.abs(np.diff(seen, axis=0)).max() < 0.13 * np.max(seen)


# Edges.


@pytest.mark.some(2)
@pytest.mark.parametrize("primitive", [form for form in Primitive if form is not Primitive.PAPER])
@pytest.mark.parametrize("scale", [0.05, 0.3, 0.8], ids="{} px".format)
def test_a_picture_is_a_window_of_a_larger_one_on_an_anisotropic_lattice(primitive, scale):
    """A point's filter is round: it may reach the frame where the flat ellipsoid does not."""
    place = np.stack(np.meshgrid(*[np.arange(-30.0, 31.0)] * 2, np.arange(4.0)), axis=-1)
    lattice = np.diag([0.4, 2.0, 1.0])
    position = (place.reshape(-1, 3) @ lattice).astype(np.float32)
    color, extinction = np.ones_like(position), np.full(len(position), 0.4, np.float32)
    scene = Samples(position, color, extinction, lattice)
    resample = painter(primitive=primitive, subpixels=2)
    wide = resample(scene, Orthographic(scale, scale, 24.3, 24.4), height=48, width=48)
    window = resample(scene, Orthographic(scale, scale, 4.3, 4.4), height=8, width=8)
    assert window.rgba[..., 3].max() > 0.5
    # Offsets of sub-pixels are rounded to float32 around other numbers.
    np.testing.assert_allclose(window.rgba, wide.rgba[20:28, 20:28], atol=1e-5)
