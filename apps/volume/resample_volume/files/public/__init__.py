"""Download public volumes."""
