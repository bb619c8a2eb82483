"""Point clouds in memory or in files, their columns and colors; 3D Gaussians."""
