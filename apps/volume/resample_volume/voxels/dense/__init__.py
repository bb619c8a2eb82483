"""What windows of dense volumes depend on of all voxels together, found brick by brick."""
