"""Compiling a `Spec` to a `Plan` with a pure function, and the formats of a plan."""
