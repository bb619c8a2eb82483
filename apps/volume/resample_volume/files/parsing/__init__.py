"""What readers of volumes share: headers, texts, numbers, sections, and how voxels lie in files."""
