"""The same in another guise compiles nothing anew; see `tests.core.test_kernel_forms`."""

from typing import Any

import numpy as np
import pytest

from resample.engine.cells.bands import finish
from resample.engine.levels import decode
from resample_texture import ForwardMap, Hybrid, Splats, warp
from resample_texture.texels.encoding import light
from resample_texture.texels.kernels.blocks import (
    split_map,
    split_plane,
    view_bounds,
    view_bounds_of,
)
from resample_texture.texels.kernels.placing import paint_blocks
from resample_texture.texels.kernels.splats import blocks_on_map, blocks_on_plane, splat_blocks
from resample_texture.texels.splatting import Splatting
from resample_texture.types import Edge
from tests.kernels import compiled_only, specialisations

pytestmark = compiled_only

SIZE = (8, 8)
PICTURE = np.random.default_rng(1).random((12, 12, 3)).astype(np.float32)
GROWN = np.array([[1.2, 0.1, -1.0], [0.0, 1.1, 0.3], [0.0, 0.001, 1.0]])
LANCZOS = "lanczos:a=3"


def forms(*kernels: Any) -> list[int]:
    return [specialisations(kernel) for kernel in kernels]


def test_a_quality_may_be_a_whole_number() -> None:
    warp(PICTURE, GROWN, SIZE, method=Hybrid(filter=LANCZOS, quality=2.0))
    before = forms(split_plane, paint_blocks)
    warp(PICTURE, GROWN, SIZE, method=Hybrid(filter=LANCZOS, quality=2))
    assert forms(split_plane, paint_blocks) == before


@pytest.mark.parametrize("threshold", [1, np.float32(1)])
def test_what_splats_are_may_be_said_in_whole_numbers(threshold: Any) -> None:
    from resample_texture.geometry.mappings import Homography
    from resample_texture.texels.splatting import splat

    def painted(splatting: Splatting) -> Any:
        return splat(PICTURE, Homography(GROWN), SIZE, Edge.TRANSPARENT, splatting).image

    painted(Splatting(threshold=1.0))
    before = forms(blocks_on_plane, splat_blocks)
    painted(Splatting(sigma=1, filter_sigma=1, threshold=threshold))
    assert forms(blocks_on_plane, splat_blocks) == before


def test_that_values_are_totals_may_be_said_in_numbers() -> None:
    warp(PICTURE, GROWN, SIZE, method=Splats(total=True))
    before = forms(splat_blocks, finish)
    warp(PICTURE, GROWN, SIZE, method=Splats(total=1))  # type: ignore[arg-type]
    assert forms(splat_blocks, finish) == before


@pytest.mark.parametrize(
    ("method", "kernel"),
    [("points", split_map), pytest.param(*("splats", blocks_on_map), marks=pytest.mark.sweep)],
)
def test_maps_may_be_frozen_and_lie_in_columns(method: str, kernel: Any) -> None:
    row, column = np.mgrid[:12, :12] + 0.5
    x, y = 0.6 * column + 0.1 * row, 0.6 * row
    truth = warp(PICTURE, ForwardMap(x.copy(), y.copy()), SIZE, method=method).image
    before = specialisations(kernel)
    for given in (x, y):
        given.setflags(write=False)
    columns = ForwardMap(np.asfortranarray(x), np.asfortranarray(y))
    for geometry in (ForwardMap(x, y), columns):
        found = warp(PICTURE, geometry, SIZE, method=method).image
        np.testing.assert_array_equal(found, truth)
    assert specialisations(kernel) == before


def test_levels_of_both_types_are_looked_up_by_one_kernel() -> None:
    light(np.zeros((2, 3, 1), np.uint8), is_encoded=True)
    before = specialisations(decode)
    levels = np.arange(6, dtype=np.uint16).reshape(2, 3, 1) * 13107
    assert np.array_equal(light(levels, is_encoded=False).ravel(), np.float32(np.arange(6) / 5))
    assert specialisations(decode) == before


# It compiles what nothing else does.
@pytest.mark.sweep
def test_lines_of_sight_are_found_without_a_kernel_and_are_those_of_the_kernel() -> None:
    np.testing.assert_array_equal(view_bounds_of(GROWN, SIZE, 1.5), view_bounds(GROWN, *SIZE, 1.5))
