"""What is drawn around a volume: axes, boxes, cubes, scale bars, and slabs of depth."""
