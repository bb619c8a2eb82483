"""Refine depth maps: find their defects, and repair them by the picture's colors."""
