"""Axes, boxes, orientation cubes, scale bars and depth slabs around a volume."""
