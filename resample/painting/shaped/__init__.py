"""Paint samples with a shape each: 3D Gaussians, ellipsoids; for cameras of any kind."""
