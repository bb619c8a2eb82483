"""Geometry of clouds: order along a curve, normals and discs of points, cameras that frame them."""
