"""Data that are packed: what they become, told before or while they are unpacked."""
