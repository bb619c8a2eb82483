"""The library's own door: scattered measurements and particles, without an application."""
