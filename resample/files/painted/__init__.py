"""Write painted scenes: pictures of any format, deep pictures, and windows of one picture."""
