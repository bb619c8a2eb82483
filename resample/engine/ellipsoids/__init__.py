"""Ellipsoids seen by a camera, painted as elliptical splats."""
