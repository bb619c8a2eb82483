"""Depth images: files, encodings, equations, and links between samples of a surface."""
