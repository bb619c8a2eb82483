"""Pictures: scenes with a truth, comparisons, and warps of OpenCV and OpenImageIO."""
