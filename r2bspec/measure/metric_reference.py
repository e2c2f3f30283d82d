"""What every metric of the catalogue means: definitions, formulas, modes, and how it is judged.

``r2bspec metrics``, ``r2bspec explain METRIC`` and docs/metrics.md show it. Everything but the
definitions comes from the catalogue, so that a new metric appears here by itself.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from dataclasses import dataclass

from r2bspec.diagnostics import did_you_mean
from r2bspec.measure.metric_catalogue import (
    BAD_PIXELS,
    DENSITY,
    METRICS,
    PROCESS,
    TAG_FALSE,
    TAG_MISSED,
    TAG_POSITION_ERROR,
    Dimension,
    MetricError,
    MetricInfo,
    Scope,
    Statistic,
    available_live,
    names,
    resolve,
)

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

DEFINITIONS: dict[str, Definition] = {
    "throughput": Definition(
        "The outputs of a monitor per window of time, each expected output counted once. The "
        "window w is the time in which the expected outputs are due: their number times the period "
        "p, or the played time where outputs have none. Times count from when the first output "
        "could come: the publication of the first step plus the shortest latency. A graph that "
        "answers all steps within w has the offered rate; the outputs of a slower one extend the "
        "time, to that of the most favourable output.",
        "n / w if t_n ≤ w, or else the maximum over k of k / max(w, t_k + p); "
        "n outputs, output k of them at t_k",
    ),
    "latency": Definition(
        "The time from the publication of a step to the arrival of its output. Published is when "
        "the publishing of the first input of the step began; received is when the middleware "
        "received the first output. If several steps lead to one output, the last one counts. In "
        "a live graph, the time from the header stamp. A requirement on a percentile or on the "
        "maximum counts a missed output as later than every other one.",
        f"received − published, for each expected output; {_PERCENTILE_RULE}",
    ),
    "latency_from_due": Definition(
        "As latency, but from the time at which the publication of the step was due. A delay of "
        "the player counts, so that the value is free of coordinated omission.",
        f"received − due, for each expected output; {_PERCENTILE_RULE}",
    ),
    "interval": Definition(
        "The time between two consecutive outputs, in the order of arrival. Missed outputs make "
        "it longer; duplicates are left out.",
        f"t[i+1] − t[i]; {_PERCENTILE_RULE}",
    ),
    "jitter": Definition(
        "How much consecutive intervals differ.",
        f"|(t[i+2] − t[i+1]) − (t[i+1] − t[i])|; {_PERCENTILE_RULE}",
    ),
    "sent": Definition("Steps that the player has published.", "number of steps"),
    "received": Definition(
        "Messages that the monitor received, whether they match a step or not.",
        "received = answered + duplicates + unmatched",
    ),
    "missed": Definition(
        "Expected outputs that were not received until the drain time was over.",
        "missed = expected − answered",
    ),
    "drop_rate": Definition("The share of the expected outputs that missed.", "missed / expected"),
    "duplicates": Definition(
        "Outputs of a step that already has one.", "received − answered − unmatched"
    ),
    "reordered": Definition(
        "First outputs of a step that arrived after the output of a later step (RFC 4737).",
        "number of outputs whose step is before the latest step seen",
    ),
    "unmatched": Definition(
        "Messages that match no step: by their stamp, or more than expected by order.",
        "received − answered − duplicates",
    ),
    "playback.rate": Definition(
        "The rate at which the player published the steps.", "(n − 1) / (t_last − t_first)"
    ),
    "playback.lateness": Definition(
        "How late the player began to publish a step. A run whose player is late by too much is "
        "invalid.",
        f"published − due, for each step; {_PERCENTILE_RULE}",
    ),
    f"cpu.{PROCESS}": Definition(
        "The processor time of a process, with its threads and descendants; 100 % is one "
        "core. Sampled five times a second.",
        "mean: (C(end) − C(begin)) / (end − begin), C the processor time used; max: the same "
        "between two samples at least 100 ms apart",
    ),
    f"memory.{PROCESS}": Definition(
        "The largest resident set of a process and its descendants at a sample. Shared pages "
        "count in every process that maps them.",
        "max over the samples",
    ),
    "cpu.system": Definition(
        "The processor time of the whole machine, other programs included; 100 % is one core.",
        "as cpu.<process>",
    ),
    "memory.system": Definition(
        "The largest memory in use on the machine, caches left out.", "max over the samples"
    ),
    BAD_PIXELS: Definition(
        "How many of the disparities that a monitor received are wrong: off by more than 2 pixels "
        "of the recorded image, as the Middlebury evaluation counts (bad 2.0). Only pixels whose "
        "point both cameras see are compared, and only those that have a disparity; how many have "
        "none is told by the density. It needs 'truth: {kind: disparity}' at the monitor.",
        "bad / answered, over all pixels of all images",
    ),
    DENSITY: Definition(
        "For how many pixels a disparity was found, of those whose point both cameras see.",
        "answered / compared",
    ),
    TAG_MISSED: Definition(
        "In how many images the tag was not found, of those in which all of it is visible. A "
        "detection answers the tag if its position is off by at most 10 % of the tag's distance, "
        "and its rotation by at most 20 degrees. It needs 'truth: {kind: tag}' at the monitor.",
        "images without an answer / images with a visible tag",
    ),
    TAG_FALSE: Definition(
        "How many detections do not answer the tag, or answer it a second time.",
        "(detections − answers) / detections; 0 without detections",
    ),
    TAG_POSITION_ERROR: Definition(
        "How far the detected positions are from the true ones, as a share of the tag's distance "
        "from the camera. Only detections that answer the tag count.",
        "mean of |found − true| / |true|, over the answers",
    ),
    "peak.rate": Definition(
        "The highest rate that the search found to be sustained. It needs benchmark.search.",
        "the lower end of the final bracket of the search",
    ),
    "sustained": Definition(
        "Whether the graph sustains the rate of the objective: its backlog does not grow. A "
        "requirement is the word alone, without a bound.",
        "a sequential test on the backlog of one probe",
    ),
}
"""By stem: the name of a metric without its part (see `stem`)."""

JUDGED: dict[Statistic, str] = {
    "percentile": "exact binomial test on single messages",
    "share": "exact binomial test on single messages",
    "mean": "Student's t over the iterations",
    "observation": "an observation: the value is compared, without a confidence",
    "search": "the final bracket of the search",
    "truth": "compared with the truth on one more iteration, without a confidence",
    "sequential": "one sequential probe",
}

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
    return template if template in DEFINITIONS else template.rpartition(".")[0]


def definition(info: MetricInfo) -> Definition:
    """The definition of a metric."""
    return DEFINITIONS[stem(info)]


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
- The column "modes" lists the values of `playback.mode` for which there is a value.
- [verdicts.md](verdicts.md) describes the tests of the column "judged by".
"""


def markdown_page() -> str:
    """docs/metrics.md."""
    blocks = [_INTRODUCTION]
    for name, infos in groups():
        meant = DEFINITIONS[name]
        formula = meant.formula.replace("; ", ";\n    ")
        block = [f"## {name}\n", f"{textwrap.fill(meant.text, 100)}\n", f"    {formula}\n"]
        block += [
            "| name | unit | meaning | modes | judged by |",
            "| --- | --- | --- | --- | --- |",
        ]
        block += [f"| {' | '.join(_row(info))} |" for info in infos]
        blocks.append("\n".join(block) + "\n")
    return "\n".join(blocks)


def _row(info: MetricInfo) -> tuple[str, ...]:
    shown = "all" if modes(info) == MODES else ", ".join(modes(info))
    description = info.description.replace("|", "\\|")
    return f"`{info.name}`", info.unit or "–", description, shown, JUDGED[info.statistic]
