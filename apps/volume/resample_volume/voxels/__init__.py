"""Classify and shade voxels: from a volume and its look to samples."""
