"""Paint windows from samples that are loaded in parts, nearest first."""
