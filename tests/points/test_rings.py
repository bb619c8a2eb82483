"""Clouds of spinning scanners: neighbours are taken across rings, so that surfaces close."""

from functools import cache

import numpy as np
import pytest

from resample.cameras.models import Camera
from resample_points import Cloud, prepare_cloud, render_cloud
from resample_points.geometry import spacing
from tests.points import spinning

NONE = np.empty((0, 3), np.float32)
WIDTH, HEIGHT = 96, 64
PITCH = np.radians(-11.0)


def cloud_of(place, normal=NONE):
    return Cloud(place, normal, NONE, np.empty(0))


def camera_at(azimuth):
    """Camera of the scanner's place, and the rays (H × W, 3) through its pixels."""
    c, s = np.cos(PITCH), np.sin(PITCH)
    forward = np.array([np.cos(azimuth) * c, np.sin(azimuth) * c, s])
    right = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
    pose = np.eye(4)
    pose[:3, :3] = right, np.cross(forward, right), forward
    camera = Camera.from_fov(24, HEIGHT, WIDTH).moved(pose)
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    ray = np.linalg.inv(camera.matrix) @ [x.ravel(), y.ravel(), np.ones(x.size)]
    return camera, ray.T @ pose[:3, :3]


@cache
def measured(noise):
    """Discs of the street."""
    return prepare_cloud(cloud_of(spinning.street(noise).place))


@pytest.mark.sweep
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_the_ground_is_closed_as_the_scanner_sees_it(noise, record):
    camera, ray = camera_at(np.radians(100.0))
    found = spinning.hits(ray)
    depth = np.where(found.is_ground, found.away, np.nan)  # of rays whose third coordinate is 1
    frame = render_cloud(measured(noise), camera, size=(WIDTH, HEIGHT))
    reach = depth * np.hypot(ray[:, 0], ray[:, 1])
    for near, far in ((4, 8), (8, 12), (12, 25)):
        among = (reach > near) & (reach < far)
        assert among.sum() > 300
        record.error(
            f"not covered from {near} m", 1 - frame.coverage.ravel()[among].mean()
        )  # 0.02 to 0.9 by nearest neighbours
        seen = frame.depth.ravel()[among]
        wrong = ~(np.abs(seen - depth[among]) < 0.1 * depth[among])
        record.error(f"wrong depths from {near} m", wrong)


@pytest.mark.sweep
def test_discs_of_the_ground_lie_flat(record):
    surfels = measured(0.02)
    place = surfels.position + surfels.origin
    reach = np.hypot(place[:, 0], place[:, 1])
    is_ground = spinning.street(0.02).is_ground[surfels.source] & (reach > 8) & (reach < 12)
    normal = np.cross(surfels.axes[:, 0], surfels.axes[:, 1])[is_ground]
    upright = np.abs(normal[:, 2]) < 0.7 * np.linalg.norm(normal, axis=1)
    record.error("discs that stand", upright)


@pytest.mark.parametrize("azimuth", [-45, 65, 140])  # degrees, toward each of the boxes
def test_edges_are_where_the_scanner_sees_them(azimuth):
    found = spinning.street(0.015)
    color = np.where(found.is_ground[:, None], np.float32([0, 1, 0]), np.float32([1, 0, 0]))
    camera, ray = camera_at(np.radians(azimuth))
    frame = render_cloud(Cloud(found.place, NONE, color, np.empty(0)), camera, size=(WIDTH, HEIGHT))
    truth = spinning.hits(ray)
    elevation = np.degrees(np.arctan2(ray[:, 2], np.hypot(ray[:, 0], ray[:, 1])))
    is_box = np.isfinite(truth.away) & ~truth.is_ground
    is_box &= (elevation > spinning.LOWEST) & (elevation < spinning.HIGHEST)
    assert is_box.sum() > 300
    red, green, _, alpha = frame.rgba.reshape(-1, 4)[is_box].T
    assert ((alpha > 0.9) & (red > 0.8) & (green < 0.2)).mean() > 0.95  # 0.97 to 0.98


def test_scans_of_other_coordinates_have_discs_too():
    place = spinning.street(0.01, rings=16, steps=256).place + np.array([500.0, 0, 0])
    surfels = prepare_cloud(cloud_of(place))
    assert np.isfinite(surfels.axes).all()
    assert (np.linalg.norm(surfels.axes, axis=2) > 0).all()


@pytest.mark.sweep
def test_given_normals_are_kept_and_discs_reach_the_next_ring(record):
    found = spinning.street(steps=1024)
    surfels = prepare_cloud(cloud_of(found.place, found.normal.astype(np.float32)))
    place = surfels.position + surfels.origin
    reach = np.hypot(place[:, 0], place[:, 1])
    ground = (np.abs(place[:, 2] + spinning.HEIGHT) < 1e-4) & (reach > 8) & (reach < 9)
    axes = surfels.axes[ground]
    np.testing.assert_allclose(axes[:, :, 2], 0, atol=1e-6)
    outward = place[ground] / np.linalg.norm(place[ground], axis=1, keepdims=True)
    half = np.linalg.norm((axes * outward[:, None, :].astype(np.float32)).sum(axis=2), axis=1)
    step = np.radians((spinning.HIGHEST - spinning.LOWEST) / (spinning.RINGS - 1))
    gap = step * (reach[ground] ** 2 + spinning.HEIGHT**2) / spinning.HEIGHT
    record.error("discs that do not reach", half <= 0.5 * gap)


@pytest.mark.sweep
def test_discs_depend_neither_on_threads_nor_on_the_order_of_points(monkeypatch):
    place = spinning.street(0.01, rings=32, steps=1024).place
    whole = prepare_cloud(cloud_of(place), threads=1)
    monkeypatch.setattr("resample_points.data.parts.STEP", 1000)
    other = prepare_cloud(cloud_of(np.random.default_rng(1).permutation(place)), threads=2)
    np.testing.assert_array_equal(whole.position, other.position)
    np.testing.assert_array_equal(whole.axes, other.axes)


def test_surfaces_without_lines_are_measured_once(monkeypatch):
    measured = []
    monkeypatch.setattr(spacing, "widened", lambda *_: measured.append(1))
    place = np.random.default_rng(2).normal(size=(3000, 3))
    prepare_cloud(cloud_of(place / np.linalg.norm(place, axis=1, keepdims=True)))
    assert measured == []


def test_a_wire_stays_a_wire():
    along = np.linspace(0, 1, 5000)
    place = np.stack([along, 0.2 * np.sin(9 * along), 0 * along], axis=1)
    size = np.linalg.norm(prepare_cloud(cloud_of(place)).axes, axis=2).max()
    assert size < 3 * np.linalg.norm(np.diff(place, axis=0), axis=1).max()
