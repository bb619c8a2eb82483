"""Batches of discs or triangles painted tile by tile: what is in front, then its colors.

Each pixel has to know what is nearest there before what lies on that surface is summed, so a tile
goes through its members twice per surface. A tile belongs to one thread, and its members come in
their own order: the same bits for any number of threads.

What differs between applications are roles: how a member claims to be in front, what it adds where
it is, and where pixels are written. Sub-pixels are `blocks.Block`s, unless an application has its
own (`begun`), and then says itself how what was added is seen (`composed`).
"""

from typing import Any

from resample.engine.jit import kernel
from resample.engine.roles import called_role, making_role, plays
from resample.engine.surfaces.blocks import Surfaces, new_block, put_behind
from resample.types import Tiles

Members = Any  # a bundle of all that may be painted
Picture = Any  # a bundle that pixels are written to
Block = Any  # the sub-pixels of a tile; `sums` are what the surface at hand leaves there


@making_role
def begun(
    members: Members, tiles: Tiles, tile: int, size: tuple[int, int], surfaces: Surfaces
) -> Block:
    """A tile that nothing has touched yet, of a frame (height, width)."""
    raise NotImplementedError


@plays(begun, object)
def _begun(
    members: Members,  # noqa: ARG001
    tiles: Tiles,
    tile: int,
    size: tuple[int, int],
    surfaces: Surfaces,
) -> Block:
    return new_block(tile, tiles, size, surfaces)


@called_role
def claim(members: Members, member: int, block: Block) -> None:
    """Raise the floor of the sub-pixels where a member is in front."""
    raise NotImplementedError


@called_role
def add(members: Members, member: int, block: Block) -> None:
    """Add the color of a member where it belongs to the surface in front."""
    raise NotImplementedError


@called_role
def claimed(members: Members, tiles: Tiles, tile: int, block: Block) -> None:
    """Note what is to be known of a tile when its first surface is, before anything is added."""
    raise NotImplementedError


@plays(claimed, object)
def _claimed(members: Members, tiles: Tiles, tile: int, block: Block) -> None:
    pass


@called_role
def composed(members: Members, block: Block, surface: int, surfaces: Surfaces) -> bool:
    """Put the surface at hand behind those before; gives whether another may show through."""
    raise NotImplementedError


@plays(composed, object)
def _composed(
    members: Members,  # noqa: ARG001
    block: Block,
    surface: int,
    surfaces: Surfaces,
) -> bool:
    return put_behind(block, surface, surfaces)


@making_role
def write(picture: Picture, block: Block) -> None:
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
    block = begun(members, tiles, tile, size, surfaces)
    for surface in range(surfaces.most):
        for n in range(start, end):
            claim(members, tiles.member[n], block)
        if surface == 0:
            claimed(members, tiles, tile, block)
        for n in range(start, end):
            add(members, tiles.member[n], block)
        if not composed(members, block, surface, surfaces):
            break
    write(picture, block)
