"""Messages to the user, background colors and standard streams."""
