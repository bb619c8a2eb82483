"""Loops of truths and peers."""
