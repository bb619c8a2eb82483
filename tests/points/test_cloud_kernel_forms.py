"""The same in another guise compiles nothing anew; see `tests.core.test_kernel_forms`."""

import numpy as np

from resample.engine.surfaces import resolve_rows
from resample_points import Camera, Cloud, render_cloud
from resample_points.kernels.discs import project_discs
from resample_warp3d import warp
from tests.kernels import compiled_only, specialisations

pytestmark = compiled_only


def test_clouds_and_pictures_are_filtered_by_one_kernel() -> None:
    eye, flat = Camera.from_fov(60, 24, 32), np.full((24, 32), 4.0)
    away, smooth = eye.moved(np.c_[np.eye(3), [0.1, 0, 0]]), "gaussian:sigma=0.5"
    warp(np.ones((24, 32, 3), np.float32), flat, eye, away, filter=smooth)
    before = specialisations(resolve_rows)
    place = np.random.default_rng(2).uniform([-1, -1, 4], [1, 1, 5], (50, 3))
    cloud = Cloud(place, np.empty((0, 3)), np.ones((50, 3)), np.empty(0))
    render_cloud(cloud, eye, size=(32, 24), filter=smooth)
    assert specialisations(resolve_rows) == before


def test_clouds_may_lie_in_columns() -> None:
    eye, rng = Camera.from_fov(60, 24, 32), np.random.default_rng(3)
    place, color = rng.uniform([-1, -1, 4], [1, 1, 5], (50, 3)), rng.uniform(0, 1, (50, 3))
    cloud = Cloud(place, np.empty((0, 3)), color, np.empty(0))
    truth = render_cloud(cloud, eye, size=(32, 24)).rgba
    before = specialisations(project_discs)
    columns = cloud._replace(position=np.asfortranarray(place), color=np.asfortranarray(color))
    np.testing.assert_array_equal(render_cloud(columns, eye, size=(32, 24)).rgba, truth)
    assert specialisations(project_discs) == before
