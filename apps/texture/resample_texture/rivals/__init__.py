"""The ways to warp that people use today, to be compared with."""
