"""Surfaces over pixels: elliptical stamps, what is in front, and sub-pixels to pixels."""
