"""Point clouds in memory or in files, their columns, colors by a column; 3D Gaussians."""
