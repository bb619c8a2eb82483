"""Write painted scenes: deep pictures."""
