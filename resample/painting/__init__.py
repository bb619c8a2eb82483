"""Paint samples to pictures: validation, projection, grouping into runs, painting."""
