"""Targets beyond McMillan's equation: lenses, panoramas, parallel rays."""
