"""Scenes: what is prepared once and rendered often; previews, and what is seen at a point."""
