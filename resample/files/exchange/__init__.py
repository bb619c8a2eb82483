"""Conversions of arguments and results: arrays, images of other libraries, pictures."""
