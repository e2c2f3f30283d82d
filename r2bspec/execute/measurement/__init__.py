"""The measurement: iterations, and the peak search."""
