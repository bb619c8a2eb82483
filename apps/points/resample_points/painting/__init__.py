"""Paint clouds, in memory or from files in parts; 3D Gaussians."""
