"""VTK's XML files: elements, data blocks and images."""
