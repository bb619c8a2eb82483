"""A page in the browser that shows what a command would paint, while its options are changed."""
