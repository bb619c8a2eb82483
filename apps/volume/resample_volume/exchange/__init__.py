"""Volumes that other libraries hold: data sets of VTK's, images, labeled arrays, grids of yt's."""
