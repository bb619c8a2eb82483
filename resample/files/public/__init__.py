"""Public files, downloaded once and checked."""
