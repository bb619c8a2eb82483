"""Filters, reconstruction kernels, interpolations and compositing orders, all open to plugins."""
