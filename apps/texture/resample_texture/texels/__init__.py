"""From texels to pictures, and back: cells cut, placed, added and resolved."""
