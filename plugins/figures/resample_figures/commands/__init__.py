"""The command `figures` of each application."""
