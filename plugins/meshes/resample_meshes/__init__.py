"""Textured triangle meshes: files, textures, rendering."""
