"""Scenes, plans of pictures and parts of samples, which all painters share."""
