"""The synthetic datasets: their sequences, rendering, cache, and ground truth."""
