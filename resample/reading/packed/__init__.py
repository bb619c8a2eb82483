"""Compressed data, with limits on their unpacked size."""
