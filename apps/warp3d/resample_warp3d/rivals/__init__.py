"""The ways to warp depth images that people use today, to be compared with."""
