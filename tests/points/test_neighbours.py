"""Neighbours of points, found block by block: those that a k-d tree finds."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from resample_points.data.cloud import Cloud
from resample_points.data.curves import curve_through
from resample_points.geometry import sorting, spacing
from resample_points.geometry.sorting import canonical
from resample_points.geometry.spacing import prepare_cloud
from resample_points.kernels.neighbours import blocks_of, measure_all

RNG = np.random.default_rng(5)
FEW, MANY = spacing.NEIGHBOURS, spacing.MORE_NEIGHBOURS


def sphere(count):
    place = np.random.default_rng(6).normal(size=(count, 3))
    return place / np.linalg.norm(place, axis=1)[:, None]


def clumps(count):
    return RNG.normal(size=(count, 3)) * 10.0 ** RNG.integers(-4, 2, (count, 1))


CLOUDS = {
    "surface": sphere(3000),
    "solid": RNG.random((3000, 3)),
    "clumps": clumps(2000),
    "line": RNG.random((500, 1)) * (1.0, 2.0, 3.0),
    "few": RNG.random((14, 3)),
    "fewer": RNG.random((5, 3)),
    "two": RNG.random((2, 3)),
}


def sorted_along(place):
    place = np.unique(place.astype(np.float32), axis=0)
    return np.ascontiguousarray(place[np.argsort(curve_through(place).codes(place), kind="stable")])


def nearest_of(place):
    """Neighbours (N, k) of places in order, without themselves."""
    count = len(place)
    few, many = min(FEW, count), min(MANY, count)
    normal, axes = np.zeros((count, 3), np.float32), np.zeros((count, 2, 3), np.float32)
    spacing, nearest = np.zeros(count, np.float32), np.zeros((count, few - 1), np.int32)
    measure_all(blocks_of(place), few, many, normal, axes, spacing, nearest)
    return nearest


@pytest.mark.parametrize("name", CLOUDS)
def test_neighbours_are_those_of_a_tree(name):
    place = sorted_along(CLOUDS[name])
    count = min(FEW, len(place))
    expected = cKDTree(place).query(place, np.arange(1, count + 1))[1]
    np.testing.assert_array_equal(nearest_of(place), expected[:, 1:])


def lattice(side):
    line = np.arange(-side, side + 1.0)
    return np.stack(np.meshgrid(line, line, line), axis=-1).reshape(-1, 3)


def shell():
    """The origin, and hundreds of places that are equally far from it, more than are held."""
    place = lattice(54)
    square = (place**2).sum(axis=1).astype(int)
    return np.concatenate([np.zeros((1, 3)), place[square == np.bincount(square)[:2916].argmax()]])


@pytest.mark.some(1)
@pytest.mark.parametrize("place", [lattice(4), shell()], ids=["lattice", "shell"])
def test_of_points_that_are_equally_far_the_first_come_first(place):
    place = sorted_along(place)
    square = ((place[:, None].astype(np.float64) - place) ** 2).sum(axis=2)
    index = np.broadcast_to(np.arange(len(place)), square.shape)
    expected = np.lexsort((index, square), axis=1)[:, 1:FEW]
    np.testing.assert_array_equal(nearest_of(place), expected)


def canonical_order(place):
    nothing = np.zeros((0, 3), np.float32)
    return canonical(Cloud(place, nothing, nothing, np.zeros(0)), curve_through(place))


FAR = np.array([[9.0, 9.0, 9.0], [-9.0, 9.0, 9.0]])
MANY_PLACES = {
    "spread": np.random.default_rng(8).random((120_000, 3)),
    "few places": np.random.default_rng(8).integers(0, 9, (120_000, 3)),
    "one place": np.ones((70_000, 3)),
    "strays": np.concatenate([1e-4 * np.random.default_rng(8).random((70_000, 3)), FAR]),
}


@pytest.mark.some(1)
@pytest.mark.parametrize("name", MANY_PLACES)
def test_many_points_come_in_the_order_of_one_sort(name, monkeypatch):
    place = MANY_PLACES[name].astype(np.float32)
    order, code = canonical_order(place), curve_through(place).codes(place)
    np.testing.assert_array_equal(order, np.lexsort([*place.T[::-1], code]))
    monkeypatch.setattr(sorting, "NEAR", 1000)
    np.testing.assert_array_equal(canonical_order(place), order)


def test_a_stray_point_far_away_changes_no_disc():
    place = sphere(4000).astype(np.float32)
    far = np.concatenate([place, np.full((1, 3), 1e9, np.float32)])

    def axes_of(position):
        order = canonical_order(position)
        ordered, count = position[order], len(position)
        normal, axes = np.zeros((count, 3), np.float32), np.zeros((count, 2, 3), np.float32)
        spacing._measured(ordered, normal, axes, np.inf, np.zeros(3))
        return axes[np.argsort(order)][: len(place)]

    order = canonical_order(far)
    assert spacing._is_crowded(far[order])
    np.testing.assert_array_equal(axes_of(far), axes_of(place))


def test_a_prepared_cloud_has_the_discs_that_its_points_alone_say():
    place = sphere(3000).astype(np.float32)
    nothing = np.zeros((0, 3), np.float32)
    one = prepare_cloud(Cloud(place, nothing, nothing, np.zeros(0)), threads=1)
    two = prepare_cloud(Cloud(place[::-1], nothing, nothing, np.zeros(0)), threads=3)
    np.testing.assert_array_equal(one.axes, two.axes)
    # Ellipses around the parts of the surface that are nearest to each point: those are all of it.
    area = np.pi * np.linalg.norm(np.cross(one.axes[:, 0], one.axes[:, 1]), axis=1)
    assert 4 * np.pi < area.sum() < 3 * 4 * np.pi


@pytest.mark.parametrize("is_crowded", [True, False])
@pytest.mark.parametrize("repeated", [1, 2])
def test_discs_are_widened_where_points_lie_along_the_curve_through_all(
    monkeypatch, is_crowded, repeated
):
    """Not where a few far away squeeze the others into one cell of it."""
    asked = []

    def measured(position, _normal, axes, _largest, _zero, is_along=True):
        asked.append((len(position), is_along))
        axes[:] = position[:, None]

    monkeypatch.setattr(spacing, "_is_crowded", lambda _: is_crowded)
    monkeypatch.setattr(spacing, "_measured_places", measured)
    place = sphere(50).astype(np.float32)
    place = np.repeat(place[canonical_order(place)], repeated, axis=0)
    axes = np.zeros((len(place), 2, 3), np.float32)
    spacing._measured(place, np.zeros_like(place), axes, 1.0, np.zeros(3))
    assert asked == [(50, not is_crowded)]
    np.testing.assert_array_equal(axes, np.repeat(place[:, None], 2, axis=1))
