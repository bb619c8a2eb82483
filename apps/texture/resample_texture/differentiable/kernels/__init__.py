"""The numba code of warps with gradients, in float64: gradients are those of what is computed."""
