"""Shared parts of all command lines, and the `resample` command."""
