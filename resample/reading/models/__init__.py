"""Triangle meshes and glTF files that nobody vouches for."""
