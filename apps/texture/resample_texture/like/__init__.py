"""Calls in place of OpenCV's, scikit-image's and SciPy's, with their parameters and conventions."""
