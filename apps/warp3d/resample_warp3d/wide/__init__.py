"""Sources and targets that McMillan's equation does not know: lenses, panoramas, parallel rays."""
