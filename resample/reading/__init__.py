"""Safe reading of untrusted files: limits, references to other files, arrays, texts."""
