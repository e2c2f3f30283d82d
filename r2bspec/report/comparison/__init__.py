"""Comparisons of stored results in several formats."""
