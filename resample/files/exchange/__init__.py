"""What callers give and get: arrays, images of other libraries, results as pictures."""
