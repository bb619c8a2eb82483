"""Batches of discs or splats painted tile by tile: what is in front first, then its colors.

Each pixel has to know what is nearest there before what lies on that surface is summed, so a tile
goes through its members twice per surface. A tile belongs to one thread, and its members come in
their own order: the same bits for any number of threads.

What differs between applications are roles: how a member claims to be in front, what it adds where
it is, and where pixels are written.
"""

from typing import Any

from resample.engine.jit import kernel
from resample.engine.roles import called_role
from resample.engine.surfaces.blocks import Block, Surfaces, composed, emptied, new_block
from resample.types import Tiles

Members = Any  # a bundle of all that may be painted
Picture = Any  # a bundle that pixels are written to


@called_role
def claim(members: Members, member: int, block: Block) -> None:
    """Raise the floor of the sub-pixels where a member is in front."""
    raise NotImplementedError


@called_role
def add(members: Members, member: int, group: int, block: Block) -> None:
    """Add a group of three channels of a member where it belongs to the surface in front."""
    raise NotImplementedError


@called_role
def stride(members: Members, tiles: Tiles, tile: int, block: Block) -> int:
    """Of how many sub-pixels of a row one is enough, as one surface fills the tile; else 1."""
    raise NotImplementedError


@called_role
def write(picture: Picture, block: Block, group: int) -> None:
    """Write the pixels of a tile whose surfaces are all composed."""
    raise NotImplementedError


@kernel
def paint_tile(
    members: Members, tiles: Tiles, tile: int, size: tuple[int, int], surfaces: Surfaces,
    picture: Picture,
) -> None:  # fmt: skip
    """Paint one tile of a frame (height, width); one that nothing touches stays as it is."""
    start, end = tiles.start[tile], tiles.start[tile + 1]
    if start == end:
        return
    block = new_block(tile, tiles, size, surfaces)
    for group in range(surfaces.groups):
        if group > 0:
            emptied(block)
        for surface in range(surfaces.most):
            if group == 0:
                for n in range(start, end):
                    claim(members, tiles.member[n], block)
                if surface == 0:
                    block.step[0] = stride(members, tiles, tile, block)
            for n in range(start, end):
                add(members, tiles.member[n], group, block)
            if not composed(block, surface, surfaces):
                break
        write(picture, block, group)
