"""Textured triangles."""
