import numpy as np
import pytest

from resample_texture import BackwardMap, Homography, warp
from resample_texture.geometry.mappings import source_coordinates


def sampled(image, grid, align_corners):
    """What `torch.nn.functional.grid_sample` gives by its documentation: bilinear, zeros beyond."""
    height, width = image.shape
    result = np.zeros(grid.shape[:2])
    for row, column in np.ndindex(grid.shape[:2]):
        x, y = grid[row, column]
        if align_corners:
            u, v = (x + 1) / 2 * (width - 1), (y + 1) / 2 * (height - 1)
        else:
            u, v = ((x + 1) * width - 1) / 2, ((y + 1) * height - 1) / 2
        for i in (int(np.floor(v)), int(np.floor(v)) + 1):
            for j in (int(np.floor(u)), int(np.floor(u)) + 1):
                if 0 <= i < height and 0 <= j < width:
                    result[row, column] += (1 - abs(u - j)) * (1 - abs(v - i)) * image[i, j]
    return result


@pytest.mark.parametrize("align_corners", [True, False])
def test_a_grid_is_torch_s(align_corners):
    v, u = np.mgrid[:16, :20]
    image = 0.5 + 0.3 * np.sin(u / 4) * np.cos(v / 5)
    y, x = np.mgrid[-0.8:0.8:60j, -0.9:0.7:70j]
    grid = np.stack([x + 0.02 * y, y - 0.05 * x], axis=2)
    places = BackwardMap.from_grid_sample(grid, (16, 20), align_corners=align_corners)
    ours = warp(image, places, (60, 70), interpolation="bilinear").image
    expected = sampled(image, grid, align_corners)
    np.testing.assert_allclose(ours, expected, atol=0.01)  # means, not values at centers
    batch = BackwardMap.from_grid_sample(grid[None], (16, 20), align_corners=align_corners)
    np.testing.assert_array_equal(batch.x, places.x)


def test_one_reaches_to_the_edge_or_to_the_last_center():
    corners = np.array([[[-1.0, -1.0], [1.0, 1.0]]])
    edges = BackwardMap.from_grid_sample(corners, (16, 20))
    np.testing.assert_array_equal([edges.x, edges.y], [[[0, 20]], [[0, 16]]])
    centers = BackwardMap.from_grid_sample(corners, (16, 20), align_corners=True)
    np.testing.assert_array_equal([centers.x, centers.y], [[[0.5, 19.5]], [[0.5, 15.5]]])


@pytest.mark.parametrize("shape", [(4, 5), (2, 4, 5, 2), (4, 5, 3)])
def test_a_grid_of_another_form_is_refused(shape):
    with pytest.raises(ValueError, match="a grid of one picture holds two numbers per pixel"):
        BackwardMap.from_grid_sample(np.zeros(shape), (16, 20))


@pytest.mark.parametrize("first", [0.5, 0.0])
def test_a_function_s_map_is_that_of_its_values(first):
    x, y = source_coordinates(Homography(np.diag([2.0, 4.0, 1.0])), (5, 6))

    def places(x, y):
        at = 0.5 - first
        return (x + at) / 2 - at, (y + at) / 4 - at

    made = BackwardMap.from_function(places, (5, 6), first=first)
    np.testing.assert_allclose(made.x, x)
    np.testing.assert_allclose(made.y, y)
