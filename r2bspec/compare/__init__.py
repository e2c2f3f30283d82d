"""Runs that are compared with others: interleaved pairs, earlier runs, and a graph with itself."""
