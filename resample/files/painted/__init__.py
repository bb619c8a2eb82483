"""Write painted scenes: deep pictures, and windows of one picture."""
