"""Drop-in replacements for OpenCV, scikit-image and SciPy, with their conventions."""
