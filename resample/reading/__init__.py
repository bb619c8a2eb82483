"""The one door for files: limits, neighbours, arrays and texts of files that nobody vouches for."""
