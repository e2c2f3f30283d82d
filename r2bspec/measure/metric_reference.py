"""What every metric of the catalogue means: definitions, formulas, modes, and how it is judged.

``r2bspec metrics``, ``r2bspec explain METRIC`` and docs/metrics.md show it. Everything but the
definitions comes from the catalogue, so that a new metric appears here by itself; the definitions
are prose, in `metric_definitions.yaml`.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from r2bspec.diagnostics import did_you_mean
from r2bspec.measure.metric_catalogue import (
    METRICS,
    PROCESS,
    Dimension,
    MetricError,
    MetricInfo,
    Scope,
    Statistic,
    available_live,
    names,
    resolve,
)
from r2bspec.safe_io.safe_yaml import load_texts

MODES = ("looping", "sweeping", "timeline", "live")
"""The values of ``playback.mode``."""


@dataclass(frozen=True, slots=True)
class Definition:
    """What the metrics of one stem measure.

    Attributes:
        text: in sentences.
        formula: in the terms of the text.
    """

    text: str
    formula: str


_PERCENTILE_RULE = (
    "pQ: the k-th of the n values in ascending order, k = ceil(Q/100 · n); always an observed value"
)

_DEFINITIONS_FILE = Path(__file__).with_name("metric_definitions.yaml")


@cache
def definitions() -> dict[str, Definition]:
    """By stem: the name of a metric without its part (see `stem`)."""
    rows = load_texts(_DEFINITIONS_FILE.read_text(encoding="utf-8"))
    return {
        name: Definition(row["text"], row["formula"].replace("{percentiles}", _PERCENTILE_RULE))
        for name, row in rows.items()
    }


JUDGED: dict[Statistic, str] = {
    "percentile": "exact binomial test on single messages",
    "share": "exact binomial test on single messages",
    "mean": "Student's t over the iterations",
    "observation": "an observation: the value is compared, without a confidence",
    "search": "the final bracket of the search",
    "truth": "compared with the truth on one more iteration, without a confidence",
    "sequential": "one sequential probe",
}

_JUDGED_SHORT: dict[Statistic, str] = {
    "percentile": "exact binomial",
    "share": "exact binomial",
    "mean": "Student's t",
    "observation": "observation",
    "search": "the bracket",
    "truth": "the value",
    "sequential": "a sequential probe",
}
"""As in the table of docs/metrics.md; `JUDGED` in full."""

_BOUNDS: dict[Dimension, str] = {
    "time": "50 ms",
    "rate": "30 Hz",
    "size": "64 MiB",
    "share": "2 %",
    "count": "0",
    "none": "",
}

SCOPES: dict[Scope, str] = {
    "monitor": "each monitor; MONITOR.NAME for one of several",
    "truth": "a monitor with 'truth'; MONITOR.NAME for one of several",
    "playback": "the playback",
    "process": "each process of the plan",
    "machine": "the machine",
    "search": "the search for the peak",
    "probe": "a probe at one rate",
}


def stem(info: MetricInfo) -> str:
    """The key of a metric's definition: its name, if necessary without the last part."""
    template = info.name if not info.process else info.name.replace(info.process, PROCESS, 1)
    return template if template in definitions() else template.rpartition(".")[0]


def definition(info: MetricInfo) -> Definition:
    """The definition of a metric."""
    return definitions()[stem(info)]


def modes(info: MetricInfo) -> tuple[str, ...]:
    """The playback modes in which a metric has a value."""
    if info.scope in {"search", "probe"}:
        return ("looping", "sweeping")
    return MODES if available_live(info) else MODES[:-1]


def example_requirement(info: MetricInfo) -> str:
    """A requirement on the metric."""
    if not _BOUNDS[info.dimension]:
        return info.name
    operator = ">=" if info.dimension == "rate" else "==" if info.dimension == "count" else "<="
    return f"{info.name} {operator} {_BOUNDS[info.dimension]}"


def find_metric(name: str) -> MetricInfo:
    """The metric of a name, with any monitor or process in it.

    Raises:
        MetricError: there is none; with what was probably meant.
    """
    first, _, rest = name.partition(".")
    process = rest.rpartition(".")[0]
    candidates = (name, rest) if rest else (name,)
    for each in candidates:
        if each in METRICS:
            return METRICS[each]
    error: MetricError | None = None
    for each in candidates:
        try:
            return resolve(each, (), (process,) if first in {"cpu", "memory"} else ())[1]
        except MetricError as found:
            error = error or found
    close = did_you_mean(name, names()) if error is None or not error.suggestion else ""
    assert error is not None  # noqa: S101 - there is at least one candidate
    raise MetricError(str(error), error.known, error.suggestion or close)


def groups() -> Iterator[tuple[str, tuple[MetricInfo, ...]]]:
    """The metrics by stem, in the order of the catalogue."""
    found: dict[str, list[MetricInfo]] = {}
    for info in METRICS.values():
        found.setdefault(stem(info), []).append(info)
    for name, infos in found.items():
        yield name, tuple(infos)


def as_builtins(info: MetricInfo) -> dict[str, object]:
    """One metric as JSON has it."""
    meant = definition(info)
    return {
        "name": info.name,
        "unit": info.unit,
        "dimension": info.dimension,
        "of": info.scope,
        "description": info.description,
        "definition": meant.text,
        "formula": meant.formula,
        "modes": list(modes(info)),
        "statistic": info.statistic,
        "judged": JUDGED[info.statistic],
        "example": example_requirement(info),
        "quantile": info.quantile,
    }


_INTRODUCTION = """\
# Metrics

Every metric that a requirement of `slos:` can name. `r2bspec metrics` prints this list,
`r2bspec explain latency.p99` one of them. This page is written by the program from its catalogue.

A metric of a monitor may be prefixed with the name of the monitor (`detections.latency.p99`);
without it, a requirement applies to each monitor. `<process>` is the name of any process of the
plan. Besides the percentiles listed, every other one can be named: `p42`, `p99_5` for 99.5 %.
Units are those of values in `result.json`; requirements write theirs, as in `latency.p99 < 50 ms`.

- *n* counts the outputs of one segment, *t* are their arrival times in ascending order.
- *Expected* outputs are one for each step, or as many as `ratio` says; *answered* ones arrived.
- A percentile pQ is the k-th of the n values in ascending order, k = ceil(Q/100 · n): always an
  observed value.
- Metrics have a value in all modes of playback, unless their section says in which.
- [verdicts.md](verdicts.md#which-test-decides-which-requirement) describes the tests by which
  metrics are judged.
"""


def markdown_page() -> str:
    """docs/metrics.md."""
    blocks = [_INTRODUCTION]
    for name, infos in groups():
        meant = definitions()[name]
        formula = meant.formula.replace(f"; {_PERCENTILE_RULE}", "").replace("; ", ";\n    ")
        block = [f"## {name}\n", f"{textwrap.fill(meant.text, 100)}\n", f"    {formula}\n"]
        if modes(infos[0]) != MODES:
            block.append(f"Modes: {', '.join(modes(infos[0]))}.\n")
        rows = list(_rows(infos))
        if len(rows) > 1:
            block += ["| name | unit | meaning | judged by |", "| --- | --- | --- | --- |"]
            block += [f"| {' | '.join(row)} |" for row in rows]
        else:
            named, unit, _, judged = rows[0]
            block.append(f"{named}: unit {unit}, judged by {judged}.")
        blocks.append("\n".join(block) + "\n")
    return "\n".join(blocks)


def _rows(infos: tuple[MetricInfo, ...]) -> Iterator[tuple[str, ...]]:
    """One for each metric; percentiles of the same values share one."""
    percentiles = [info for info in infos if info.statistic == "percentile"]
    for info in infos:
        if info in percentiles[1:]:
            continue
        members = percentiles if info in percentiles else [info]
        description = info.description.replace("|", "\\|")
        if info in percentiles:
            description = description.partition(":")[0]
        named = ", ".join(f"`{member.name}`" for member in members)
        yield named, info.unit or "–", description, _JUDGED_SHORT[info.statistic]
