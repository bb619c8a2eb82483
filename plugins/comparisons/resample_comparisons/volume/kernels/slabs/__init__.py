"""Sheets of samples, slabs that cut them, and fields that are classified in them."""
