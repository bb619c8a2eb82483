"""Volume data: arrays, bricks, recordings, rectilinear grids, and cached statistics."""
