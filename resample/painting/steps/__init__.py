"""Windows whose samples come part by part, nearest first."""
