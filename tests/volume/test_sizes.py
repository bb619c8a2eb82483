"""Things are as large in pictures as in the scene: spheres in slices, labels, colors."""

import numpy as np
import pytest

from resample.cameras.viewpoints import Orbit
from resample_volume import Appearance, as_volume, render
from resample_volume.classification.labels import Labels, Rule
from resample_volume.classification.transfer import from_points
from resample_volume.rendering import Subject

WIDE, PARTS = 36.0, 4  # diameter of a sphere; parts of a voxel's side whose means it is of
SIDE = 320  # px
WHITE = (1.0, 1.0, 1.0)
SOLID = from_points([(127.5, WHITE, 0.0), (127.5, WHITE, 1.0)])
HIDE_OTHERS = {0: Rule(opacity=0)}
PLACE = np.indices((48, 48, 48)) - 23.5
BALL = (PLACE**2).sum(axis=0) < 15**2
BLOCK = np.abs(PLACE).max(axis=0) < 12
WALL = np.abs(PLACE[2] - 0.5) < 0.5


def sphere(thickness):
    """Means of a sphere over voxels, 0 to 255, in slices of that thickness."""
    count = int(np.ceil(48 / thickness))
    side = (np.arange(48 * PARTS) + 0.5) / PARTS - 24
    height = ((np.arange(count * PARTS) + 0.5) / PARTS - count / 2) * thickness
    away = height[:, None, None] ** 2 + side[:, None] ** 2 + side**2
    inside = (away < (WIDE / 2) ** 2).reshape(count, PARTS, 48, PARTS, 48, PARTS)
    values = np.rint(255 * inside.mean(axis=(1, 3, 5))).astype(np.uint8)
    return as_volume(values)._replace(spacing=np.array([1.0, 1.0, thickness]))


def seen(volume, look, orbit):
    """Width, height and diameter of the disk of equal area, scene units, of what is seen."""
    camera = Subject.of(volume, look).camera(orbit, SIDE, SIDE)
    frame = render(volume, look, orbit, size=(SIDE, SIDE))
    assert frame.statistics.rays > 0
    opacity, view = frame.rgba[..., 3].astype(np.float64), camera.view()
    away = np.sqrt(view.translation[2] ** 2 - (WIDE / 2) ** 2) if view.perspective else 1.0
    per = away / view.focal[0]
    across, down = opacity.max(axis=0).sum(), opacity.max(axis=1).sum()
    return per * np.array([across, down, 2 * np.sqrt(opacity.sum() / np.pi)])


@pytest.mark.sweep
@pytest.mark.parametrize("fov", [0, 30])
@pytest.mark.parametrize("thickness", [1, 2, 3])
@pytest.mark.parametrize("turn", [(0, 0), (0, 90), (30, 40)])
def test_a_sphere_in_slices_is_as_wide_as_it_is_high(thickness, turn, fov, record):
    look = Appearance(SOLID, light=None)
    size = seen(sphere(thickness), look, Orbit(*turn, fov=fov))
    record.error("diameter", np.abs(size[2] / WIDE - 1))
    record.error("width and height", np.abs(size[:2] - WIDE).max())
    record.error("roundness", abs(size[1] / size[0] - 1))


@pytest.mark.sweep
@pytest.mark.parametrize("thickness", [5, 7])
def test_a_sphere_in_thick_slices_is_as_wide_as_in_thin_ones(thickness, record):
    look = Appearance(SOLID, light=None)
    front, top = (seen(sphere(thickness), look, Orbit(0, up, fov=0)) for up in (0, 90))
    record.error("width from the front", abs(front[0] - WIDE))
    record.error(
        "height from the front", abs(front[1] - WIDE)
    )  # slices end before or after its poles
    record.error("width and height from above", np.abs(top[:2] - WIDE).max())
    record.error("diameter from the front", abs(front[2] - WIDE))
    record.error("diameter from above", abs(top[2] - WIDE))


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("mask", "wide", "area"),
    [(BALL, 30, BALL.any(axis=1).sum()), (BLOCK, 24, 24**2), (WALL, 1, 48)],
    ids=["ball", "block", "wall"],
)
def test_what_has_a_label_is_as_large_as_its_voxels(mask, wide, area):
    look = Appearance(SOLID, light=None, labels=Labels(mask.astype(np.uint8), HIDE_OTHERS))
    volume = as_volume(np.full(mask.shape, 200, np.uint8))
    assert_wide(seen(volume, look, Orbit(0, 0, fov=0)), wide, area)


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("mask", "wide", "area"),
    [(BALL, 30, BALL.any(axis=1).sum()), (BLOCK, 24, 24**2), (WALL, 1, 48)],
    ids=["ball", "block", "wall"],
)
def test_what_has_a_color_is_as_large_as_its_voxels(mask, wide, area):
    colors = np.where(mask[..., None], np.uint8((0, 0, 255, 255)), np.uint8(0))
    assert_wide(seen(as_volume(colors), Appearance(light=None), Orbit(0, 0, fov=0)), wide, area)


def assert_wide(size, wide, area):
    """Within a tenth of a voxel, of a ball of voxels within 0.15."""
    assert abs(size[0] - wide) < (0.15 if wide == 30 else 0.1)
    assert abs(np.pi / 4 * size[2] ** 2 - area) < max(0.01 * area, 0.1 * 48)


def test_labels_touch_without_a_color_between_them():
    values, labels = np.full((16, 16, 16), 200, np.uint8), np.zeros((16, 16, 16), np.uint8)
    labels[:, :, 8:] = 1
    rules = {0: Rule((1.0, 0.0, 0.0)), 1: Rule((0.0, 0.0, 1.0))}
    look = Appearance(SOLID, light=None, labels=Labels(labels, rules))
    light = render(as_volume(values), look, Orbit(0, 0, fov=0), size=(64, 64)).rgba[32, 20:44, :3]
    assert (np.abs(light.sum(axis=1) - light[0, 0]) < 1e-3).all()
    assert ((light.min(axis=1) < 1e-6) & (light[:, 1] == 0)).all()
    mixed = (light[:, 0] > 1e-3) & (light[:, 2] > 1e-3)
    assert mixed.sum() <= 1


def test_a_color_is_that_of_what_is_seen_not_of_what_is_beside_it():
    colors = np.zeros((16, 16, 16, 4), np.uint8)
    colors[..., 1] = 255  # green where nothing is seen
    colors[4:12, 4:12, 4:12] = (255, 0, 0, 255)
    light = render(as_volume(colors), Appearance(light=None), Orbit(20, 30), size=(48, 48)).rgba
    assert light[..., 0].max() > 0.9
    assert light[..., 1].max() < 1e-3
