"""Where texels go: matrices, corners, maps, lenses and planes."""
