"""Parts that readers of volumes share: headers, texts, numbers, sections, voxel layouts."""
