"""From a volume and its look to samples: what is seen of it, and how it is lit."""
