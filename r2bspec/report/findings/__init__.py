"""Findings of `validate` and of every other verb: one module for each format."""
