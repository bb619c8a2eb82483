"""Core functions that need no application: scattered measurements and particles."""
