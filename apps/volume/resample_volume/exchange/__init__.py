"""Convert volumes of other libraries: VTK, PyVista, SimpleITK, nibabel, xarray, yt."""
