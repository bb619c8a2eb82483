"""Triangle meshes and glTF files, checked while they are read."""
