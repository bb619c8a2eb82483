"""Combine several sources: match depths and colors, drop outliers, blend."""
