"""Volumes stored as stacks of pictures: TIFF, PNG, DICOM."""
