"""What painters have in common: scenes, plans of pictures, and parts of samples, nearest first."""
