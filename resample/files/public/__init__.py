"""Download and verify public files."""
