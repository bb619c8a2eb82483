"""Files of calibrated cameras as other programs write them."""
