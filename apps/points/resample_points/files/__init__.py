"""Read point clouds: PLY, PCD, LAS, E57, KITTI, text columns, NumPy arrays."""
