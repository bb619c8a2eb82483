"""Read 3D Gaussians: PLY and compressed PLY, `.splat`, SOG and SPZ; write PLY."""
