"""Pixel filters of clouds: surfaces are composited on parts of pixels first, filtered after."""

import math
from functools import cache

import numpy as np
import pytest

from resample import registry
from resample.cameras.models import Camera
from resample.engine.jit import threads
from resample.measuring.quality import psnr
from resample_points import Cloud, CloudStyle, render_cloud
from tests.filtered import FILTERS, FINE, plain_filtered, window

SHAPE = 32, 40


@cache
def ball():
    n = np.arange(4000) + 0.5
    z, angle = 1 - 2 * n / 4000, math.pi * (1 + math.sqrt(5)) * n
    around = np.sqrt(1 - z * z)
    place = np.stack([around * np.cos(angle), around * np.sin(angle), z - 4.0], axis=1)
    color = (0.5 + 0.5 * np.sin(4.0 * place)).astype(np.float32)
    normal = place - [0, 0, -4.0]
    return Cloud(-place, -normal.astype(np.float32), color, np.zeros(0, np.float32))


def cloud_seen(pixel_filter=None, n=1, margin=0, **style):
    """The ball on n sub-pixels per side of a pixel, and px around it."""
    matrix = np.array(
        [[45.0 * n, 0, (20 + margin) * n], [0, 45.0 * n, (16 + margin) * n], [0, 0, 1]]
    )
    size = (SHAPE[1] + 2 * margin) * n, (SHAPE[0] + 2 * margin) * n
    camera = Camera(matrix, np.eye(4))
    return render_cloud(ball(), camera, size=size, style=CloudStyle(**style), filter=pixel_filter)


@pytest.mark.sweep
@pytest.mark.parametrize("name", FILTERS)
def test_a_cloud_under_every_filter_is_the_truth_filtered(name, record):
    weight, margin = window(registry.build("filters", name))
    fine = cloud_seen(n=FINE, margin=margin, subpixels=1)
    wanted = plain_filtered(fine.rgba.astype(np.float64), weight, SHAPE)
    rgba = np.where(wanted[..., 3:] > 0, wanted, 0.0)
    rgba /= np.maximum(rgba[..., 3:], 1.0)
    # Rims are known to a sixteenth of a pixel only, on 4 × 4 sub-pixels.
    record.quality("picture", psnr(cloud_seen(name).rgba, rgba.astype(np.float32)))
    whole = np.abs(wanted[..., 3] - 1.0) < 1e-6
    given = cloud_seen(name).rgba
    record.quality("inside", psnr(given, rgba.astype(np.float32), mask=whole))


@pytest.mark.some(1)
@pytest.mark.parametrize("name", FILTERS)
def test_a_cloud_of_one_color_keeps_it(name):
    one = ball()._replace(color=np.full((4000, 3), 0.6, np.float32))
    camera = Camera(np.array([[45.0, 0, 20], [0, 45, 16], [0, 0, 1.0]]), np.eye(4))
    frame = render_cloud(one, camera, size=SHAPE[::-1], filter=name)
    there = frame.coverage > 1e-3
    color = frame.rgba[there][:, :3] / frame.coverage[there][:, None]
    np.testing.assert_allclose(color, 0.6, rtol=1e-3)  # sums of float32 with both signs
    assert 0.0 <= frame.coverage.min() <= frame.coverage.max() <= 1.0


@pytest.mark.parametrize("name", ["area", "box"])
def test_a_cloud_under_the_mean_of_a_pixel_keeps_its_bits(name):
    given, usual = cloud_seen(name), cloud_seen()
    np.testing.assert_array_equal(given.rgba, usual.rgba)
    np.testing.assert_array_equal(given.depth, usual.depth)


def test_a_filtered_cloud_is_the_same_for_any_threads_and_order():
    pictures = []
    for count, order in ((1, slice(None)), (2, slice(None, None, -1))):
        cloud = Cloud(*(part[order] for part in ball()[:4]))
        camera = Camera(np.array([[45.0, 0, 20], [0, 45, 16], [0, 0, 1.0]]), np.eye(4))
        with threads(count):
            pictures.append(render_cloud(cloud, camera, size=SHAPE[::-1], filter="mitchell"))
    np.testing.assert_array_equal(pictures[0].rgba, pictures[1].rgba)
    np.testing.assert_array_equal(pictures[0].depth, pictures[1].depth)


def test_a_filtered_cloud_knows_its_discs_and_its_nearest_depth(record):
    usual, given = cloud_seen(), cloud_seen("tent")
    assert given.statistics[:3] == usual.statistics[:3]
    both = np.isfinite(usual.first_depth) & np.isfinite(given.first_depth)
    near = np.abs(given.first_depth[both] / usual.first_depth[both] - 1.0)
    record.error("wrong depths", ~(near < 0.02))  # rims are seen at other places of a pixel
