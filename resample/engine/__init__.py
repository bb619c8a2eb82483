"""The only numba code of the core: bare arrays and numbers, no options, no validation."""
