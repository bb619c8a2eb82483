"""Volumes of further formats: FITS, HDF5, NetCDF, MRC, OpenVDB, microscopes', MGH, MINC."""
