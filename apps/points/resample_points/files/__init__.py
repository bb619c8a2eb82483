"""Read point clouds: PLY, PCD, LAS, text columns, NumPy arrays."""
