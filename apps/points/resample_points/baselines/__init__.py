"""Other renderers of 3D Gaussians, for comparison, where they are installed."""
