"""NRRD, MetaImage and NIfTI: what their headers say, and how they are written."""
