"""The same in another guise compiles nothing anew; see `tests.core.test_kernel_forms`."""

import numpy as np
import pytest

from resample_comparisons.warp3d.scenes import generated
from resample_warp3d import Camera, prepare, warp
from resample_warp3d.sheet.kernels.corners import project_ends
from resample_warp3d.sheet.sheets import sheet_of
from tests.kernels import compiled_only, specialisations

pytestmark = compiled_only


@pytest.mark.sweep
def test_ends_of_any_number_of_surfaces_lie_row_by_row() -> None:
    image = generated(64).depth_image(4)
    ends = sheet_of(prepare(image)).ends
    assert len(ends) > 1
    assert ends.flags.c_contiguous


def test_sheets_with_and_without_ends_are_projected_by_one_kernel() -> None:
    eye, flat = Camera.from_fov(60, 24, 32), np.full((24, 32), 4.0)
    away = eye.moved(np.c_[np.eye(3), [0.1, 0, 0]])
    row, column = np.indices(flat.shape)
    ball = np.maximum(0.0, 1 - ((row - 12) ** 2 + (column - 16) ** 2) / 80)
    color = np.ones((24, 32, 3), np.float32)
    warp(color, flat, eye, away)
    before = specialisations(project_ends)
    warp(color, np.where(ball > 0, 3 - np.sqrt(ball), 6.0), eye, away)
    assert specialisations(project_ends) == before
