"""What can be wrong with the name of a metric."""

from __future__ import annotations


class MetricError(ValueError):
    """A dotted name that is no metric of this run.

    Attributes:
        known: the names that would have been understood in its place.
        suggestion: the known name that the wrong one most resembles, or empty.
    """

    def __init__(self, message: str, known: tuple[str, ...] = (), suggestion: str = "") -> None:
        super().__init__(message)
        self.known = known
        self.suggestion = suggestion
