"""Point clouds in memory or in files, their columns, and colors by a column."""
