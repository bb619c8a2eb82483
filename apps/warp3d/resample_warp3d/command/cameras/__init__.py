"""Cameras of sources and targets as the command line names them."""
