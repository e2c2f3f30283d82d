"""A comparison as workflow commands of GitHub Actions: an annotation for what is not the same."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from r2bspec.compare.comparison import Comparison, Outcome
from r2bspec.report.comparison.text import metric_text, summary, title
from r2bspec.report.formats.github import command

MAX_ANNOTATIONS = 9
"""GitHub keeps ten annotations of a step; one is the summary."""

_KINDS: dict[Outcome, str] = {
    "worse": "warning",
    "can't tell": "notice",
    "improved": "notice",
}
"""Comparisons of stored results are advisory: nothing is an error. Metrics that are the same are
left out."""


def to_github(comparisons: Sequence[Comparison]) -> bytes:
    """The commands, a line each: for each result a summary, then its metrics, the worse first."""
    return "".join(f"{line}\n" for one in comparisons for line in _lines(one)).encode()


def _lines(one: Comparison) -> Iterator[str]:
    worse = any(line.outcome == "worse" for line in one.lines)
    yield command("warning" if worse else "notice", title(one), summary(one), {})
    annotated = [line for kind in _KINDS for line in one.lines if line.outcome == kind]
    for line in annotated[:MAX_ANNOTATIONS]:
        head = f"{metric_text(line)}: {line.outcome}"
        yield command(_KINDS[line.outcome], head, line.reason, {})
