"""Samples with a shape each: ellipsoids of any size and rotation, projected and composited."""
