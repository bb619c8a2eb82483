"""Calibrated cameras as programs that reconstruct scenes write them."""
