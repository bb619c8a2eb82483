"""Interpolate sparse depth, of scattered samples or scan lines, guided by color.

Each sample extends the plane fitted to its neighbours on the same surface. Pixels take the votes of
the samples around them, by distance and color, as in `conditioning`.
"""

import math

import numpy as np

from resample.types import Doubles, Floats
from resample_warp3d.depth.refining.kernels.voting import Voters, VotingWindow, vote_rows

NEIGHBOURS = 8  # of a sample, to which its plane is fitted
APART = 0.2  # of the larger nearness: neighbours that differ by more are on other surfaces
BENT = 0.01  # relative nearness: neighbours farther from a plane weigh less than half
ROUNDS = 3  # of fitting a plane
FLAT = 0.3  # weight of a plane without slope, in neighbours at the usual distance
LINES = 0.7  # of the rows or columns that scattered samples fill: scan lines fill fewer
MOST_APART = 5.0  # px: samples farther apart are interpolated in a smaller picture
REACH = 1.8  # distances between samples from which votes come
FAR, NEAR = 0.7, 0.35  # of these, standard deviations of the weights for a surface and nearness
LEAST = 2.0  # px: samples closer together vote as if at this distance
LOWEST = 0.3  # of a sample's nearness: least value that its plane may lead to


def spacing_of(nearness: Floats) -> Doubles:
    """Return the usual distance (2,) between samples along columns and rows, px."""
    row, column = np.nonzero(nearness)
    height, width = int(np.ptp(row)) + 1, int(np.ptp(column)) + 1
    rows, columns = np.unique(row).size / height, np.unique(column).size / width
    share = row.size / (height * width)
    # Compare with the rows that as many scattered samples fill.
    few_rows, few_columns = (
        filled < LINES * (1.0 - (1.0 - share) ** count)
        for filled, count in ((rows, width), (columns, height))
    )
    if few_rows == few_columns:
        return np.full(2, 1.0 / math.sqrt(share))
    return np.array([1.0 / rows, rows / share] if few_rows else [columns / share, 1.0 / columns])


def scale_of(nearness: Floats) -> int:
    """Return the factor by which a picture is reduced to interpolate its sparse depth."""
    return max(1, math.ceil(math.sqrt(float(spacing_of(nearness).prod())) / MOST_APART))


def dense_at(color: Floats, nearness: Floats, made_up: float) -> tuple[Floats, Floats]:
    """Interpolate sparse nearness in a picture of its size or a smaller one.

    `color`: (H, W, C) in units of the difference between similar colors. Result: nearness (H, W), 0
    where no sample is near, and confidence: 1 at samples, elsewhere `made_up` times the votes.
    """
    shape = color.shape[0], color.shape[1]
    spacing = spacing_of(nearness)
    values, slope = _gathered(nearness, _planes(nearness, spacing), shape)
    trust = (values > 0).astype(np.float32)
    found, agreed = values.copy(), trust.copy()
    window = _window(np.maximum(spacing * shape / nearness.shape, LEAST))
    voters, unknown = Voters(color, values, trust, slope), (values <= 0).astype(np.uint8)
    for apart in (4, 2, 1):
        vote_rows(voters, window, unknown, apart, False, found, agreed)
    share = np.where(values > 0, agreed, np.float32(made_up) * agreed)
    return found, np.where(found > 0, share, np.float32(0)).astype(np.float32)


def _planes(nearness: Floats, spacing: Doubles) -> Doubles:
    """Return the slopes (N, 2) along rows and columns of planes through the samples, per px."""
    from scipy.spatial import cKDTree

    place = np.argwhere(nearness) / spacing
    value = nearness[nearness > 0].astype(np.float64)
    count = min(NEIGHBOURS + 1, len(value))
    _, near = cKDTree(place).query(place, k=np.arange(2, count + 1), workers=-1)
    down, across = np.moveaxis(place[near] - place[:, None], 2, 0)
    change = value[near] - value[:, None]
    same = np.abs(change) < APART * np.maximum(value[near], value[:, None])
    weight = same.astype(np.float64)
    for _ in range(ROUNDS):
        yy, xx = ((weight * part**2).sum(axis=1) + FLAT for part in (down, across))
        xy = (weight * down * across).sum(axis=1)
        y, x = ((weight * part * change).sum(axis=1) for part in (down, across))
        slope = np.stack([yy * x - xy * y, xx * y - xy * x]) / (xx * yy - xy**2)
        off = change - slope[0, :, None] * across - slope[1, :, None] * down
        weight = same / (1.0 + (off / (BENT * value[:, None])) ** 2)
    return np.asarray((slope / spacing[::-1, None]).T)


def _gathered(nearness: Floats, plane: Doubles, shape: tuple[int, int]) -> tuple[Floats, Floats]:
    """Move samples to the centers of pixels; return nearness and slopes (H, W, 4) of the voters.

    Of several samples in a pixel, the one closest to its center stays.
    """
    place = np.argwhere(nearness) + 0.5
    ratio = np.array(shape) / nearness.shape
    pixel = np.floor(place * ratio).astype(np.int64)
    away = (pixel + 0.5) / ratio - place
    moved = nearness[nearness > 0] + (plane * away[:, ::-1]).sum(axis=1)
    value = np.maximum(moved, LOWEST * nearness[nearness > 0])
    order = np.argsort(-np.square(away).sum(axis=1), kind="stable")
    row, column = pixel[order].T
    values, slope = np.zeros(shape, np.float32), np.zeros((*shape, 4), np.float32)
    values[row, column] = value[order]
    slope[row, column, :2] = (plane / ratio[::-1])[order]
    return values, slope


def _window(spacing: Doubles) -> VotingWindow:
    """Return the window of voters for samples at a distance (2,) along columns and rows, px."""
    rows, columns = np.ceil(REACH * spacing).astype(np.int64)
    offset = np.mgrid[-rows : rows + 1, -columns : columns + 1].reshape(2, -1).T
    squared = np.square(offset / spacing).sum(axis=1)
    return VotingWindow(
        np.ascontiguousarray(offset, np.int64),
        np.exp(-0.5 * squared / FAR**2),
        np.exp(-0.5 * squared / NEAR**2),
        len(offset),
    )
