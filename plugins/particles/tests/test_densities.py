"""Column densities, means and slices of particles against sums written out in NumPy."""

import numpy as np
import pytest
from scipy import integrate

from resample import look_at
from resample.cameras.models import Camera, Orthographic
from resample.engine import jit
from resample_particles import Particles, column_density
from resample_particles import density as module
from resample_particles.density import DensityMap
from resample_particles.mapping import map_picture
from resample_particles.smoothing import KERNELS, found_smoothing

NAMES = sorted(KERNELS)
SHAPES = {  # kernels of support radius 1, as they are published
    "cubic": lambda q: 8 / np.pi * np.where(q < 0.5, 1 - 6 * q**2 + 6 * q**3, 2 * (1 - q) ** 3),
    "wendland": lambda q: 21 / (2 * np.pi) * (1 - q) ** 4 * (1 + 4 * q),
}


def shape_of(name, away):
    """A kernel in space; Gaussians have no other formula than ours."""
    away = np.minimum(away, 1.0)
    return SHAPES.get(name, KERNELS[name].density)(away)


def columns(name):
    """A kernel's integrals along lines, at 1,001 distances, by adaptive quadrature."""
    distance = np.linspace(0, 1, 1001)
    half = np.sqrt(1 - distance**2)
    values = [
        2 * integrate.quad(lambda s, b=b: shape_of(name, np.hypot(s, b)), 0, end, epsrel=1e-9)[0]
        for b, end in zip(distance, half, strict=True)
    ]
    return distance, np.array(values)


COLUMNS = {name: columns(name) for name in NAMES}


def column_at(name, away, reach):
    return np.interp(away / reach, *COLUMNS[name], right=0.0) / reach**2


def grid(side, fine):
    """Coordinates of samples in a square picture of `side` px, and what averages them to pixels."""
    place = (np.arange(side * fine) + 0.5) / fine
    return place, lambda values: values.reshape(side, fine, side, fine).mean(axis=(1, 3))


def seen(x, y, reach, kernel, side):
    """A map with 1 px per unit of one particle, x to the right and y down from the corner."""
    smoothing = reach / KERNELS[kernel].gamma
    one = Particles([[x, side - y, 0]], 1.0, smoothing)
    region = [[0, 0, -1e9], [side, side, 1e9]]
    return column_density(one, "z", size=(side, side), kernel=kernel, region=region).value


def error(found, truth):
    return np.sqrt(((found - truth) ** 2).mean() / (truth**2).mean())


@pytest.mark.some(1)
@pytest.mark.parametrize("kernel", NAMES)
@pytest.mark.parametrize("reach", [0.4, 1.3, 5.0, 7.9, 8.1, 20.0])
def test_a_particle_is_the_integral_of_its_kernel_over_lines_and_pixels(kernel, reach, record):
    side, x = int(2 * reach) + 4, reach + 1.83
    place, pixels = grid(side, int(np.clip(160 / reach, 8, 120)))
    truth = pixels(column_at(kernel, np.hypot(place - x, place[:, None] - x + 0.4), reach))
    found = seen(x, x - 0.4, reach, kernel, side)
    record.error("rms", error(found, truth))
    record.error("largest", abs(found - truth).max())


@pytest.mark.some(25)
@pytest.mark.parametrize("kernel", NAMES)
@pytest.mark.parametrize("reach", [1e-3, 0.01, 0.3, 0.9, 3.0, 8.0, 8.5, 13.0, 100.0])
def test_mass_is_kept_at_any_zoom(kernel, reach):
    side = int(2 * reach) + 6
    for place in (side / 2, side / 2 + 0.37, side / 2 - 0.499):
        assert seen(place, place, reach, kernel, side).sum() == pytest.approx(1, abs=2e-5)


def test_a_point_on_an_edge_is_shared_by_both_pixels():
    found = seen(3, 2.5, 1e-5, "cubic", 6)
    assert found[2, 2] == pytest.approx(0.5)
    assert found[2, 3] == pytest.approx(0.5)
    assert np.count_nonzero(found) == 2


def test_pixels_beside_a_particle_are_empty():
    side, x, y = 20, 9.3, 10.1
    found = seen(x, y, 5.0, "cubic", side)
    corner = np.arange(side)
    nearest = np.hypot(
        np.clip(x, corner, corner + 1) - x, (np.clip(y, corner, corner + 1) - y)[:, None]
    )
    assert not found[nearest > 5.0].any()
    assert (found[nearest < 4.5] > 0).all()


def several(count=20, seed=1):
    rng = np.random.default_rng(seed)
    place, mass = rng.uniform(0, 1, (count, 3)), rng.uniform(1, 2, count)
    heat = rng.uniform(10, 20, count)
    return Particles(place, mass, rng.uniform(0.04, 0.12, count), {"Temperatures": heat})


UNIT = [[0, 0, 0], [1, 1, 1]]


def brute(particles, kernel, side, fine=16, *, plane=None):
    """Masses, and masses times temperatures, of pixels of the unit square seen along z."""
    place, pixels = grid(side, fine)
    x, y = place / side, 1 - place[:, None] / side
    sums = np.zeros((2, side, side))
    reaches = KERNELS[kernel].gamma * particles.smoothing
    heat = particles.quantities["Temperatures"]
    for at, mass, reach, q in zip(particles.position, particles.mass, reaches, heat, strict=True):
        away = np.hypot(x - at[0], y - at[1])
        if plane is None:
            values = column_at(kernel, away, reach)
        else:
            values = shape_of(kernel, np.hypot(away, at[2] - plane) / reach) / reach**3
        part = pixels(mass * values)
        sums += np.stack([part, q * part])
    return sums


@pytest.mark.sweep
@pytest.mark.parametrize("kernel", NAMES)
def test_columns_and_means_are_the_sums_over_all_particles(kernel, record):
    given = several()
    mass, heated = brute(given, kernel, 32)
    found = column_density(given, "z", size=(32, 32), kernel=kernel, region=UNIT)
    record.error("rms", error(found.value, mass))
    mean = column_density(
        given, "z", size=(32, 32), kernel=kernel, region=UNIT, quantity="temperature"
    )
    known = mass > 1e-3 * mass.max()
    np.testing.assert_allclose(mean.value[known], (heated / np.maximum(mass, 1e-9))[known], 2e-3)
    assert mean.name == "Temperatures"
    assert np.isnan(mean.value[found.value == 0]).all()


@pytest.mark.sweep
@pytest.mark.parametrize("kernel", NAMES)
def test_a_slice_is_the_kernel_in_the_plane(kernel, record):
    given = several()
    mass, _ = brute(given, kernel, 32, fine=16, plane=0.4)
    found = column_density(given, "z", size=(32, 32), kernel=kernel, region=UNIT, slice_at=0.4)
    record.error("rms", error(found.value, mass))
    assert found.name == "density"


def test_slices_far_from_all_particles_are_empty():
    with pytest.warns(UserWarning, match="no particle reaches the slice at 30"):
        found = column_density(several(), "z", size=(8, 8), slice_at=30.0)
    assert not found.value.any()


@pytest.mark.parametrize(("axis", "turn"), [("x", [1, 2, 0]), ("y", [0, 2, 1]), ("z", [0, 1, 2])])
def test_axes_show_the_other_two_to_the_right_and_up(axis, turn):
    given = several()
    turned = Particles(given.position[:, turn], given.mass, given.smoothing)
    found = column_density(given, axis, size=(24, 24), region=UNIT).value
    np.testing.assert_array_equal(
        found, column_density(turned, "z", size=(24, 24), region=UNIT).value
    )
    high = Particles([[0.9, 0.9, 0.9]], 1.0, 0.01)
    assert column_density(high, axis, size=(8, 8), region=UNIT).value[0, 7] > 0


@pytest.mark.parametrize("quantity", [None, "temperature"])
def test_bits_depend_neither_on_threads_nor_on_the_order_of_particles(quantity):
    given = several(400)
    other = given.some(np.random.default_rng(2).permutation(400))
    maps = []
    for particles, threads in ((given, 1), (given, 2), (other, 2)):
        with jit.threads(threads):
            found = column_density(particles, "z", size=(90, 70), quantity=quantity)
        maps.append(found.value)
    np.testing.assert_array_equal(maps[0], maps[1])
    np.testing.assert_array_equal(maps[0], maps[2])


def test_lists_in_parts_give_the_same_bits(monkeypatch):
    given = several(200)
    whole = column_density(given, "z", size=(90, 70)).value
    monkeypatch.setattr(module, "LISTED", 40)
    np.testing.assert_array_equal(whole, column_density(given, "z", size=(90, 70)).value)


def test_a_periodic_box_continues_at_its_sides():
    given = several()
    smoothing = given.smoothing.copy()
    smoothing[0] = 0.9  # reaches around the box
    boxed = Particles(given.position, given.mass, smoothing, box=1.0)
    moved = Particles(given.position + np.array([0.5, 0.25, 7.0]), given.mass, smoothing, box=1.0)
    found = column_density(boxed, "z", size=(32, 32)).value
    again = column_density(moved, "z", size=(32, 32)).value
    np.testing.assert_allclose(np.roll(found, (-8, 16), axis=(0, 1)), again, rtol=1e-6)
    assert found.mean() == pytest.approx(given.mass.sum(), rel=1e-5)
    near = column_density(boxed, "z", size=(32, 32), slice_at=0.98).value
    np.testing.assert_allclose(
        near, column_density(boxed, "z", size=(32, 32), slice_at=-0.02).value, rtol=1e-9
    )


def test_a_region_in_depth_wraps_with_the_box():
    boxed = Particles([[0.5, 0.5, 0.95], [0.5, 0.5, 0.5]], [2.0, 5.0], 0.05, box=1.0)
    found = column_density(boxed, "z", size=(20, 20), region=[[0, 0, -0.1], [1, 1, 0.1]])
    assert found.value.mean() == pytest.approx(2.0, rel=1e-5)


def test_a_parallel_camera_measures_masses_per_area():
    given = several()
    camera = Orthographic(40, 20, 32, 24, look_at((3, 4, 2), (0.5, 0.5, 0.5)))
    found = column_density(given, camera, size=(64, 48)).value
    assert found.sum() / (40 * 20) == pytest.approx(given.mass.sum(), rel=1e-5)


@pytest.mark.sweep
def test_perspective_is_the_column_along_each_ray(record):
    place = np.array([[0.0, 0.0, 10.0], [4.0, -2.0, 12.0], [-2.5, 1.5, 4.0]])
    mass, reach = np.array([1.0, 2.0, 3.0]), np.array([1.0, 0.9, 1.5])
    given = Particles(place, mass, reach / KERNELS["cubic"].gamma)
    side, focal = 64, 50.0
    camera = Camera.from_intrinsics(focal, focal, side / 2, side / 2)
    at, pixels = grid(side, 12)
    x, y = np.meshgrid((at - side / 2) / focal, (at - side / 2) / focal)
    ray = np.stack([x, y, np.ones_like(x)], axis=-1)
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    truth = np.zeros((side, side))
    for p, m, r in zip(place, mass, reach, strict=True):
        away = np.linalg.norm(np.cross(p, ray), axis=-1)
        truth += pixels(m * column_at("cubic", away, r))
    found = column_density(given, camera, size=(side, side)).value
    record.error("rms", error(found, truth))
    assert found.sum() == pytest.approx(truth.sum(), rel=2e-4)


def test_a_slice_in_perspective_has_the_scale_of_its_depth():
    given = several()
    pose = look_at((0.5, 0.5, -3), (0.5, 0.5, 0.5), up=(0, -1, 0))
    camera = Camera.from_intrinsics(100, 100, 20, 20, pose)
    found = column_density(given, camera, size=(40, 40), slice_at=3.5).value
    flat = Orthographic(100 / 3.5, 100 / 3.5, 20, 20, pose)
    truth = column_density(given, flat, size=(40, 40), slice_at=3.5).value
    assert found.any()
    np.testing.assert_allclose(found, truth, rtol=1e-12)


def test_particles_behind_the_eye_or_around_it_are_left_out():
    camera = Camera.from_fov(60, 16, 16)
    place = [[0, 0, -5], [0, 0, 0.1], [0, 0, 0]]
    assert not column_density(Particles(place, 1.0, 0.2), camera, size=(16, 16)).value.any()


def test_smoothing_lengths_are_found_from_48_neighbours():
    rng = np.random.default_rng(5)
    place = rng.uniform(0, 1, (300, 3))
    offset = place[:, None] - place
    offset -= np.round(offset)
    away = np.sort(np.sqrt((offset**2).sum(axis=2)), axis=1)
    truth = away[:, 48] / KERNELS["cubic"].gamma
    np.testing.assert_allclose(found_smoothing(place, np.ones(3)), truth, 1e-9)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_few_particles_have_smoothing_lengths(count):
    place = np.arange(3.0 * count).reshape(count, 3)
    found = column_density(Particles(place), "z", size=(16, 16)).value
    assert np.isfinite(found).all()
    assert found.any()


@pytest.mark.parametrize("kernel", NAMES)
def test_kernels_have_mass_1_and_half_a_smoothing_length_of_deviation(kernel):
    one = KERNELS[kernel]
    mass, square = (
        integrate.quad(lambda q, p=p: 4 * np.pi * q**p * one.density(np.array(q)), 0, 1)[0]
        for p in (2, 4)
    )
    assert mass == pytest.approx(1, abs=1e-9)
    assert one.gamma == pytest.approx(0.5 / np.sqrt(square / 3), rel=1e-6)


@pytest.mark.parametrize(
    ("choices", "message"),
    [
        ({"view": "w"}, "axis x, y or z"),
        ({"kernel": "quartic"}, "known: cubic, wendland, gaussian"),
        ({"region": [[0, 0], [1, 1]]}, "lowest and highest"),
        ({"region": [[0, 0, 2], [1, 1, 1]]}, "lowest and highest"),
        ({"region": [[0, 0, 5], [1, 1, 6]]}, "no particle is between 5 and 6"),
        ({"view": Camera.from_fov(60, 8, 8), "region": UNIT}, "belongs to a view along an axis"),
        ({"slice_at": np.nan}, "finite"),
    ],
)
def test_invalid_choices_are_refused(choices, message):
    choices = {"view": "z", "size": (8, 8)} | choices
    with pytest.raises(ValueError, match=message):
        column_density(several(3), **choices)


def test_an_unknown_quantity_lists_those_there_are():
    with pytest.raises(LookupError, match="'pressure'; known: Temperatures"):
        column_density(several(3), "z", size=(8, 8), quantity="pressure")


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        (((3, 2), 1.0), r"shape \(3, 2\); give \(N, 3\)"),
        (((0, 3), 1.0), "no particles"),
        (((3, 3), [1, 2]), r"mass of particles has the shape \(2,\)"),
        (((3, 3), np.inf), "mass of particles holds numbers that are not finite"),
        (((3, 3), 1.0, -1.0), "below 0"),
        (((3, 3), 1.0, None, {"u": np.zeros(2)}), "quantity 'u'"),
        (((3, 3), 1.0, None, {}, {}, 0.0), "a box of 0.0"),
    ],
)
def test_parts_that_do_not_fit_are_refused(parts, message):
    with pytest.raises(ValueError, match=message):
        Particles(np.zeros(parts[0]), *parts[1:])


def test_a_tiny_box_in_a_large_region_is_refused():
    boxed = Particles(np.zeros((1, 3)), 1.0, 1e-3, box=1e-3)
    with pytest.raises(ValueError, match="copies of the periodic box"):
        column_density(boxed, "z", size=(8, 8), region=UNIT)


@pytest.mark.parametrize("least", [1e-3, 50.0])
def test_a_map_of_densities_shows_five_powers_of_ten_at_most(least):
    """Other quantities, and maps whose scale is asked not to be logarithmic, show all values."""
    value = np.array([[0.0, least], [2e4, 3e5]])
    density = DensityMap(value, "column density", "g")
    assert map_picture(density).span == pytest.approx((max(least, 3.0), 3e5))
    assert map_picture(density, log=False).span == (0.0, 3e5)
    assert map_picture(DensityMap(value, "temperature", "K")).span == (0.0, 3e5)
    for empty in (DensityMap(0 * value, "density", "g"), DensityMap(np.nan * value, "age", "s")):
        with pytest.raises(ValueError, match=r"is nowhere above 0|the map is empty"):
            map_picture(empty)
