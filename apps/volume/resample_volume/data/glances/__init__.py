"""What is known of values in bricks after each was read once."""
