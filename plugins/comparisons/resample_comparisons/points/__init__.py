"""3D Gaussians: comparisons of ways to render them, and Mitsuba."""
