import numpy as np
import pytest

from resample.engine.tiles import CHUNKS
from resample.painting.scenes import dealt_to_tiles
from resample.types import Screen

BOUNDS = np.dtype([(name, np.float64) for name in ("left", "top", "right", "bottom", "spacing")])


def boxes(rng, count, width, height):
    """Records with random bounds in, across and off a frame; some cannot be seen."""
    record = np.zeros(count, BOUNDS)
    x, y = rng.uniform(-20, width + 20, count), rng.uniform(-20, height + 20, count)
    reach = rng.choice([0.0, 0.3, 3.0, 30.0, 1e6, 1e30], count)
    record["left"], record["right"] = x - reach, x + reach
    record["top"], record["bottom"] = y - reach, y + reach
    hidden = rng.uniform(size=count) < 0.2
    record["left"][hidden], record["right"][hidden] = 1.0, 0.0
    record["top"][hidden], record["bottom"][hidden] = 1.0, 0.0
    record["spacing"] = np.float32(rng.uniform(0.1, 5, count))
    return record


def screen_of(width, height, margin):
    return Screen(width, height, margin)


def naive_members(record, screen, size, column, row):
    """Samples whose bounds meet the tile's pixels and the margin around them."""
    left, right = column * size - screen.margin, (column + 1) * size + screen.margin
    top, bottom = row * size - screen.margin, (row + 1) * size + screen.margin
    return [
        n
        for n, one in enumerate(record)
        if one["left"] <= one["right"]
        and float(one["right"]) >= left
        and float(one["left"]) < right
        and float(one["bottom"]) >= top
        and float(one["top"]) < bottom
    ]


@pytest.mark.some(1)
@pytest.mark.parametrize(("width", "height"), [(64, 48), (33, 7), (1, 1), (8, 100)])
@pytest.mark.parametrize("margin", [0.0, 1.0, 3.0])
@pytest.mark.parametrize("size", [8, 32])
def test_a_tile_has_the_samples_that_overlap_it_and_no_others(width, height, margin, size, rng):
    record, screen = boxes(rng, 150, width, height), screen_of(width, height, margin)
    tiles = dealt_to_tiles(record, screen, size)
    assert tiles.start.size - 1 == -(-width // size) * -(-height // size)
    for tile in range(tiles.start.size - 1):
        member = tiles.member[tiles.start[tile] : tiles.start[tile + 1]]
        row, column = divmod(tile, tiles.columns)
        assert list(member) == naive_members(record, screen, size, column, row)
        assert tiles.spacing[tile] == min(record["spacing"][member], default=np.inf)


@pytest.mark.parametrize("count", [0, 1, CHUNKS - 1, CHUNKS + 1])
def test_any_number_of_samples_can_be_dealt_to_tiles(count, rng):
    record, screen = boxes(rng, count, 40, 40), screen_of(40, 40, 1.0)
    tiles = dealt_to_tiles(record, screen, 8)
    assert (tiles.member >= 0).all()
    for tile in range(25):
        member = tiles.member[tiles.start[tile] : tiles.start[tile + 1]]
        row, column = divmod(tile, 5)
        assert list(member) == naive_members(record, screen, 8, column, row)
