"""The beginning and the end of the report: what was run, the search, what to know, the verdict."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.text import Text

from r2bspec.measure.units import show
from r2bspec.record.model import SearchRecord
from r2bspec.report.model import Result
from r2bspec.report.terminal.style import QUIET, heading, outcome_text
from r2bspec.slo.model import Verdict


def header(result: Result) -> RenderableType:
    """What was run, with what, and where."""
    title = result.title or result.name
    where = [
        _known(result.machine, "cpu"),
        f"{_known(result.machine, 'cores')} cores" if "cores" in result.machine else "",
        _known(result.dataset, "source"),
        f"r2bspec {result.versions['r2bspec']}" if "r2bspec" in result.versions else "",
    ]
    lines = [Text(title, style="bold"), Text(" · ".join(filter(None, where)), style=QUIET)]
    if result.judged_by:
        lines.append(Text(f"judged by the objectives of {result.judged_by}", style=QUIET))
    return Group(*(line for line in lines if line.plain))


def _known(facts: dict[str, Any], key: str) -> str:
    return str(facts.get(key) or "")


def search_section(search: SearchRecord | None) -> RenderableType | None:
    """The peak as a bracket, what limited it, and every probe in the order it was made."""
    if search is None or not search.probes:
        return None
    probes = Text("  ")
    for number, probe in enumerate(search.probes):
        probes.append(" " if number else "")
        probes.append(
            f"{probe.rate_hz:.4g}{'✔' if probe.holds else '✘'}",
            style="green" if probe.holds else "red",
        )
    lines: list[RenderableType] = [heading("search", f"peak {_peak(search)}"), probes]
    failed = [probe for probe in search.probes if probe.rate_hz == search.fails_hz]
    if failed and not failed[-1].holds:
        last = failed[-1]
        reason = f"at {show(last.rate_hz, 'Hz')}: {last.reason}"
        lines.append(Padding(Text(reason, style=QUIET), (0, 0, 0, 2)))
    return Group(*lines)


def _peak(search: SearchRecord) -> str:
    limits = {
        "graph": "limited by the graph",
        "player": "limited by the player, not by the graph",
        "range": "limited by the range of the search",
        "interrupted": "the search was interrupted",
    }
    if search.holds_hz is None:
        found = f"below {show(search.fails_hz, 'Hz')}"
    elif search.fails_hz is None:
        found = f"at least {show(search.holds_hz, 'Hz')}"
    else:
        found = f"between {show(search.holds_hz, 'Hz')} and {show(search.fails_hz, 'Hz')}"
    return f"{found} · {limits[search.limited_by]} · {len(search.probes)} probes"


def notes_section(result: Result) -> RenderableType | None:
    """What a reader must know to trust the numbers; None if there is nothing."""
    notes = [*_notes(result)]
    if not notes:
        return None
    return Group(
        heading("notes"), *(Padding(Text(note), (0, 0, 0, 2), expand=False) for note in notes)
    )


def _notes(result: Result) -> Iterator[str]:
    if result.status != "complete":
        yield f"The run is {result.status}: {result.reason or 'no reason was recorded'}"
    if result.metrics.incomplete:
        yield f"Cut short, and in no number: {', '.join(result.metrics.incomplete)}"
    for one in result.verdict.unusable:
        yield f"Nothing can be judged at {show(one.offered_hz, 'Hz')}: {one.reason}"
    yield from _odd_messages(result)
    for process in result.processes:
        if process.exit_code not in {0, None}:
            ended = f"exit code {process.exit_code}"
            if process.exit_code is not None and process.exit_code < 0:
                ended = f"signal {-process.exit_code}"
            yield f"Process {process.name} ended with {ended}"


def _odd_messages(result: Result) -> Iterator[str]:
    """Messages that arrived otherwise than once, in order, and in answer to an input."""
    for rate in result.metrics.rates:
        for name, seen in rate.pooled.monitors.items():
            where = f"{name} at {show(rate.offered_hz, 'Hz')}"
            if not seen.received:
                yield f"{where} received nothing"
            odd = {
                "came twice or more": seen.duplicates,
                "were overtaken": seen.reordered,
                "answer no input": seen.unmatched,
            }
            said = [f"{show(count, 'count')} {what}" for what, count in odd.items() if count]
            if said:
                yield f"{where}: of {show(seen.received, 'count')} messages {', '.join(said)}"


def overall(verdict: Verdict) -> RenderableType:
    """The one line that everything above comes to."""
    return Text.assemble(outcome_text(verdict.outcome), "  ", verdict.reason)
