"""Picture quality, in numbers and side by side."""
