"""Slopes of any type and layout are found by kernels of two types, with the same bits."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from resample.types import Floats
from resample_volume.data import values as volume_values
from resample_volume.files.headers import KEPT
from resample_volume.kernels.voxels import BRICK, brick_order, find_gradients
from resample_volume.types import Volume
from resample_volume.voxels.visible import gradients_at
from tests.kernels import compiled_only, specialisations

GRADIENTS = ["central", "sobel"]
SHAPE = (3 * BRICK + 3, 7, 9)
LAYOUTS = {
    "rows": np.ascontiguousarray,
    "columns": np.asfortranarray,
    "strided": lambda values: np.repeat(values, 2, axis=2)[:, :, ::2],
    "swapped": lambda values: values.astype(values.dtype.newbyteorder()),
}
TURN = np.array([[1.0, 0.5, 0.0], [0.0, 2.0, 0.1], [0.3, 0.0, 1.5]])


def values_of(kind: str) -> NDArray[Any]:
    values = np.random.default_rng(1).integers(0, 100, SHAPE).astype(kind)
    if kind == "float32":
        values[values < 20] = np.nan
    return values


def slopes(values: NDArray[Any], index: NDArray[np.int64], gradient: str) -> Floats:
    direction = np.linalg.inv(TURN).T  # of which steps from voxel to voxel are columns
    volume = Volume(values, np.ones(3), np.zeros(3), direction, "turned")
    return gradients_at(volume, index, gradient)


def asked(order: str) -> NDArray[np.int64]:
    """Half of the voxels, none of some layers, in the order of an array or of bricks."""
    index = np.flatnonzero(np.random.default_rng(2).random(SHAPE) < 0.5)
    index = index[index // (SHAPE[1] * SHAPE[2]) // BRICK != 1]
    if order == "array":
        return index
    bricks = np.empty_like(index)
    brick_order(index, SHAPE, bricks)
    return index[bricks]


@pytest.mark.parametrize("gradient", GRADIENTS)
@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
@pytest.mark.parametrize("order", ["array", "bricks"])
@pytest.mark.parametrize("planes", [1, 1 << 22], ids=["layer by layer", "at once"])
@pytest.mark.each_value
def test_slopes_do_not_depend_on_type_layout_and_parts(
    gradient: str, layout: Any, order: str, planes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    index = asked(order)
    monkeypatch.setattr(volume_values, "CHUNK", planes)
    for kind in KEPT:
        values = values_of(kind)
        wide = values.astype(np.float64)
        truth = slopes(wide, index, gradient)
        found = slopes(layout(values), index, gradient)
        np.testing.assert_array_equal(found, truth, err_msg=kind)


@compiled_only
@pytest.mark.parametrize("gradient", GRADIENTS)
def test_slopes_of_all_types_are_found_by_two_forms_of_a_kernel(gradient: str) -> None:
    index = asked("array")
    for kind in ("float32", "float64"):
        slopes(values_of(kind), index, gradient)
    before = specialisations(find_gradients)
    for kind in KEPT:
        for layout in LAYOUTS.values():
            slopes(layout(values_of(kind)), index, gradient)
    assert specialisations(find_gradients) == before


def test_of_no_voxels_there_are_no_slopes() -> None:
    nobody = np.zeros(0, np.int64)
    assert slopes(values_of("uint8"), nobody, "central").shape == (0, 3)
