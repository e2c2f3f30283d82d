"""Errors in the names of metrics."""

from __future__ import annotations


class MetricError(ValueError):
    """A dotted name that is not a metric of this run.

    Attributes:
        known: the valid names in its place.
        suggestion: the known name most similar to the wrong one, or empty.
    """

    def __init__(self, message: str, known: tuple[str, ...] = (), suggestion: str = "") -> None:
        super().__init__(message)
        self.known = known
        self.suggestion = suggestion
