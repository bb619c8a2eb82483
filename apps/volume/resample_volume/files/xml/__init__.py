"""VTK's files in XML: their elements, their blocks of values, and images in them."""
