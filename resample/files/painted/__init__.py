"""Painted scenes as files: pictures of any format, deep pictures, and windows put together."""
