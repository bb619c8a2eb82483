"""Orthogonal slices and profiles of a volume: orientation, proportions, windows, values."""

import numpy as np
import pytest

from resample_volume import as_volume
from resample_volume.slicing import profile, slice_levels, slice_planes

VALUES = np.arange(3 * 4 * 5, dtype=np.float32).reshape(3, 4, 5)  # z, y, x
VOLUME = as_volume(VALUES)


def levels(values, low, high):
    return np.rint(255 * np.clip((values - low) / (high - low), 0, 1)).astype(np.uint8)


def test_slices_are_oriented_as_radiologists_have_them():
    axial, coronal, sagittal = slice_planes(VOLUME)
    of = {"axial": VALUES[1], "coronal": VALUES[::-1, 2], "sagittal": VALUES[::-1, :, 3]}
    for plane, at in ((axial, 1), (coronal, 2), (sagittal, 3)):
        expected = levels(of[plane.name], 0, 60)
        shown = slice_levels(VOLUME, plane, at, expected.shape[::-1], (0, 60))
        for channel in range(3):
            np.testing.assert_array_equal(shown[..., channel], expected)


def test_slices_follow_the_axes_of_the_scene_whatever_the_order_of_voxels():
    # Voxel axes x, y, z run along scene axes -z, x and -y.
    direction = np.array([[0, 1, 0], [0, 0, -1], [-1, 0, 0]], np.float64)
    turned = VOLUME._replace(direction=direction)
    axial = slice_planes(turned)[0]
    assert (axial.across, axial.right, axial.down) == (0, 1, 2)
    expected = levels(VALUES[::-1, :, 4], 0, 60)  # rows downward along y: against z of voxels
    np.testing.assert_array_equal(slice_levels(turned, axial, 4, (4, 3), (0, 60))[..., 0], expected)


def test_slices_have_the_proportions_of_the_scene():
    thick = VOLUME._replace(spacing=np.array([1.0, 1.0, 5.0]))
    coronal = slice_planes(thick)[1]
    assert slice_levels(thick, coronal, 0, (100, 90)).shape == (90, 30, 3)
    assert slice_levels(thick, coronal, 0, (10, 90)).shape == (30, 10, 3)


def test_missing_values_are_transparent():
    values = VALUES.copy()
    values[0, 1, 2] = np.nan
    shown = slice_levels(as_volume(values), slice_planes(VOLUME)[0], 0, (5, 4), (0, 60))
    expected = np.full((4, 5), 255)
    expected[1, 2] = 0
    np.testing.assert_array_equal(shown[..., 3], expected)


def test_slices_outside_of_the_volume_are_refused():
    with pytest.raises(ValueError, match="slice 3 of 3 axial ones; give 0 to 2"):
        slice_levels(VOLUME, slice_planes(VOLUME)[0], 3, (5, 4))


def test_a_profile_interpolates_a_linear_field_exactly():
    spacing, origin = np.array([0.5, 1.0, 2.0]), np.array([3.0, -1.0, 7.0])
    volume = VOLUME._replace(spacing=spacing, origin=origin, space="lps")
    start, end = origin + spacing * (0, 0, 0), origin + spacing * (4, 3, 2)
    distance, values = profile(volume, start, end)
    assert distance == pytest.approx(np.hypot(np.hypot(2, 3), 4))
    share = np.linspace(0, 1, len(values))
    np.testing.assert_allclose(values, share * VALUES[2, 3, 4], rtol=1e-12)
    _, beyond = profile(volume, start - spacing * (2, 0, 0), end)
    assert np.isnan(beyond[0])
    assert np.isfinite(beyond[-1])
