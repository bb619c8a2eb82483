"""Depth images as sheets of cells: holes, filling, layers behind silhouettes."""
