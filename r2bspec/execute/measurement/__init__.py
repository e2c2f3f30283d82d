"""The measurement: iterations, the peak search, and the harness overhead."""
