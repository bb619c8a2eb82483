"""Public volumes, downloaded once and checked."""
