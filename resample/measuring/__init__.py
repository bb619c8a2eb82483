"""How good pictures are, in numbers and side by side."""
