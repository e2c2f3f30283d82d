"""Short ways to a checked spec."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import data_bags
from r2bspec.check import check
from r2bspec.diagnostics import Diagnostic
from r2bspec.language.load_spec import load_spec


def findings(text: str, *, file: str = "spec.r2b.yaml", offline: bool = False) -> list[Diagnostic]:
    """Everything that is said about a spec."""
    return check(load_spec(text, file=file, environ={}), offline=offline)


def codes(text: str, *, file: str = "spec.r2b.yaml", offline: bool = False) -> list[str]:
    """The codes of that, in the order of the document."""
    return [each.code for each in findings(text, file=file, offline=offline)]


def write_bag(folder: Path, times_ns: dict[str, Iterable[int]]) -> Path:
    """A bag of strings, recorded at these times."""
    words = data_bags.text("x")
    messages = [(topic, time_ns, words) for topic, times in times_ns.items() for time_ns in times]
    return data_bags.write_bag(folder, messages, storage="mcap", topics=times_ns)
