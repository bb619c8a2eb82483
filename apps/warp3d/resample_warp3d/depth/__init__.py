"""Depth images: files, what their numbers mean, and which samples are one surface."""
