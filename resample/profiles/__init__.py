"""What is spread and summed by which weights, in which order: all that plugins may replace."""
