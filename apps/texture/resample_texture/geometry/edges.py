"""What lies beyond the edges of a source."""

from enum import StrEnum


class Edge(StrEnum):
    """Edge modes: what lies beyond the source's edges.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_texture import Edge, warp
    >>> row, right = np.uint8([[1, 2, 3, 4]]), [[1, 0, 2], [0, 1, 0]]
    >>> for edge in Edge:
    ...     print(f"{edge:11}", *warp(row, right, (1, 6), edge=edge).image[0])
    transparent 0 0 1 2 3 4
    clamp       1 1 1 2 3 4
    wrap        3 4 1 2 3 4
    mirror      2 1 1 2 3 4
    """

    TRANSPARENT = "transparent"  # nothing: coverage ends there
    CLAMP = "clamp"  # the outermost texels, repeated
    WRAP = "wrap"  # the source again: a b c | a b c
    MIRROR = "mirror"  # the source's mirror image: a b c | c b a
