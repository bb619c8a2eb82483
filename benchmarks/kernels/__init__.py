"""What the machine can do at most, and how much work a picture is."""
