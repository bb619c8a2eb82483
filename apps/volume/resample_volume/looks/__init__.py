"""Which color and opacity values get."""
