"""How volumes are held: arrays, bricks, recordings, uneven grids; what is kept of their values."""
