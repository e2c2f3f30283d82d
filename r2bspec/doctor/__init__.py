"""Checks of the machine: one file per topic, each a function from a `System` to results."""
