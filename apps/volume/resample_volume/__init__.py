"""Volume rendering by hybrid forward resampling."""
