"""Transfer functions: presets, files, labels, and statistics behind them."""
