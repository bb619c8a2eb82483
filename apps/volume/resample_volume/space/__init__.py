"""What else is seen in space: axes, boxes, cubes, scale bars, meshes, and slabs of depth."""
