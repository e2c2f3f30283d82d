"""A history of runs in one SQLite file, used by `run --history`."""

from __future__ import annotations

from r2bspec.compare.history.errors import HistoryError
from r2bspec.compare.history.model import HistoryEntry, HistoryMetric
from r2bspec.compare.history.store import History, open_history, user_history

__all__ = [
    "History",
    "HistoryEntry",
    "HistoryError",
    "HistoryMetric",
    "open_history",
    "user_history",
]
