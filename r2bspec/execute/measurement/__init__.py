"""Measuring: iterations, the peak search, and the overhead of the harness."""
