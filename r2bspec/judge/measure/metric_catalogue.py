"""The metrics by name: the metric of a requirement, the metrics of a run, and their page.

Grammar of a metric's name, as a requirement writes it::

    metric = [monitor "."] name ["." part]          latency.p99, detections.latency.p99
           | ("cpu" | "memory" | "work") "." process "." part    cpu.apriltag.mean, work.graph.p50
           | node "." family ["." part]                 blur.callback.p99, blur.load
           | topic ".transport." part                   camera/image.transport.p50

This module computes nothing and imports no NumPy, so that a spec can be checked with it. The
metrics are declared in `r2bspec.judge.measure.metric_declarations`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from functools import cache
from typing import Final

import msgspec
from msgspec.structs import replace

from r2bspec.diagnostics import did_you_mean
from r2bspec.judge.measure.metric import (
    MONITOR,
    NODE,
    PROCESS,
    TOPIC,
    Metric,
    MetricInfo,
    Scope,
    Statistic,
)
from r2bspec.judge.measure.metric_declarations import DECLARED
from r2bspec.plan.plan import Plan


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


WHOLE_GRAPH: Final = "graph"
"""All processes of the graph together, in place of a process in the names of metrics."""


class Subjects(msgspec.Struct, frozen=True):
    """The processes, nodes and topics for which a run has metrics.

    Attributes:
        topics: without the slash that they begin with.
        monitors: of which paths are observed from inside.
        namespace: in which topics can be named without it, without the slash.
    """

    processes: tuple[str, ...] = ()
    nodes: tuple[str, ...] = ()
    topics: tuple[str, ...] = ()
    monitors: tuple[str, ...] = ()
    namespace: str = ""

    @classmethod
    def of_plan(cls, plan: Plan) -> Subjects:
        """Return the subjects of a run of a plan."""
        measured = plan.processes_in("measure")
        nodes = dict.fromkeys(node.node for process in measured for node in process.nodes)
        topics = dict.fromkeys(topic.name.removeprefix("/") for topic in plan.topics)
        return cls(
            processes=tuple(process.name for process in measured),
            nodes=tuple(nodes),
            topics=tuple(topics),
            monitors=tuple(monitor.name for monitor in plan.monitors),
            namespace=plan.namespace.strip("/"),
        )

    def named_by(self, placeholder: str) -> tuple[str, ...]:
        """Return the names that a placeholder stands for."""
        return {
            PROCESS: self.processes,
            NODE: self.nodes,
            TOPIC: self.topics,
            MONITOR: self.monitors,
        }[placeholder]


NO_SUBJECTS: Final = Subjects()


def listed() -> dict[str, MetricInfo]:
    """Return every metric that a requirement can name, by name.

    Placeholders stand for processes, nodes, topics and monitors, and more percentiles exist than
    those listed (see `r2bspec.judge.measure.distribution.quantile`).
    """
    return {info.name: info for metric in DECLARED if metric.required for info in metric.infos}


def resolve(
    metric: str, monitors: Collection[str], subjects: Subjects = NO_SUBJECTS
) -> tuple[str | None, MetricInfo]:
    """Return the metric that a requirement names, and its monitor.

    A metric of a monitor may be written without the monitor: it then refers to the only monitor,
    or, if there are several, to every monitor that has it (the returned monitor is None). A name
    that is a metric by itself takes precedence over a monitor with the name of a metric's family.

    Args:
        metric: the dotted name as written.
        monitors: the names of the monitors of the spec.
        subjects: what there are further metrics of.

    Returns:
        The monitor's name, or None where the metric belongs to no single monitor; and the
        metric.

    Raises:
        MetricError: no such metric, monitor or process.
    """
    info = _find(metric, subjects)
    if info is not None:
        only = next(iter(monitors)) if len(monitors) == 1 and info.scope is Scope.MONITOR else None
        return only, info
    first, _, rest = metric.partition(".")
    if first in monitors:
        if not rest:
            raise _unknown_metric(metric, f"{metric!r} is a monitor, without a metric", subjects)
        info = _find(rest, subjects)
        if info is None:
            of_one = replace(subjects, processes=(), nodes=(), topics=(), monitors=())
            raise _unknown_metric(rest, f"there is no metric {rest!r}", of_one, prefix=f"{first}.")
        if info.scope is not Scope.MONITOR:
            raise MetricError(
                f"{rest!r} is not a metric of a monitor", known=(rest,), suggestion=rest
            )
        return first, info
    if rest and _find(rest, subjects) is not None:
        known = tuple(sorted(monitors))
        close = did_you_mean(first, known)
        raise MetricError(
            f"there is no monitor {first!r}", known, f"{close}.{rest}" if close else ""
        )
    raise _unknown_metric(metric, f"there is no metric {metric!r}", subjects)


def _find(name: str, subjects: Subjects | None) -> MetricInfo | None:
    """Return the metric of a name; of any subject, if `subjects` is None."""
    head, _, last = name.rpartition(".")
    split = [(name, ""), *([(head, last)] if head else [])]
    required = [metric for metric in DECLARED if metric.required]
    # A name without a placeholder takes precedence.
    for metric in sorted(required, key=lambda metric: bool(metric.placeholder)):
        for series, part in split:
            subject, info = metric.subject_in(series), metric.part(part)
            if subject is None or info is None:
                continue
            if not metric.placeholder or subjects is None:
                return replace(info, subject=subject)
            named = subjects.named_by(metric.placeholder)
            if metric.placeholder == TOPIC and subject not in named:
                subject = f"{subjects.namespace}/{subject}"
            if subject in named:
                return replace(info, subject=subject)
    return None


def names(subjects: Subjects = NO_SUBJECTS) -> tuple[str, ...]:
    """Return the names of all metrics, with those of each process, node and topic written out."""
    written_out: list[str] = []
    for name, info in listed().items():
        if info.metric.placeholder:
            named = sorted(subjects.named_by(info.metric.placeholder))
            written_out += [replace(info, subject=subject).name for subject in named]
        else:
            written_out.append(name)
    return tuple(dict.fromkeys(written_out))


def monitor_metrics() -> Iterator[MetricInfo]:
    """Yield every metric of a monitor that results have, in the order of complete tables."""
    for metric in DECLARED:
        if metric.scope is Scope.MONITOR:
            yield from metric.infos


def series_with(has: Callable[[Metric], bool]) -> tuple[str, ...]:
    """Return the names, without part, of the metrics of a monitor that have a trait."""
    return tuple(
        metric.name
        for metric in DECLARED
        if metric.required and metric.scope is Scope.MONITOR and has(metric)
    )


def unknown_metric(name: str) -> MetricInfo:
    """Return a placeholder for a metric that does not exist."""
    return MetricInfo(
        Metric(
            name=name,
            scope=Scope.PROBE,
            dimension="none",
            what="",
            text="",
            formula="",
            read=lambda _: None,
            required=False,
        )
    )


def measured_metric(name: str) -> MetricInfo | None:
    """Return the metric of a name among the values of a segment; None for a name of none.

    The name of a metric with a distribution has no part, and neither has what is returned.
    """
    return _measured_metric(name, tuple(DECLARED))


@cache
def _measured_metric(name: str, declared: tuple[Metric, ...]) -> MetricInfo | None:
    head, _, part = name.rpartition(".")
    # A name without a placeholder takes precedence.
    for metric in sorted(declared, key=lambda metric: bool(metric.placeholder)):
        has_part = bool(metric.parts) and not metric.has_percentiles
        subject = metric.subject_in(head if has_part else name)
        is_listed = not has_part or part in metric.parts
        if metric.scope is not Scope.MONITOR and subject is not None and is_listed:
            return MetricInfo(metric, part if has_part else "", subject)
    return None


_OTHER_NAMES: Final = {
    **dict.fromkeys(("fps", "hz", "rate", "frequency", "output_rate"), "throughput.mean"),
    **dict.fromkeys(("delay", "response_time"), "latency.p99"),
    **dict.fromkeys(("loss", "lost", "dropped", "drops"), "drop_rate"),
    **dict.fromkeys(("cpu", "cpu_usage", "cpu_load"), "cpu.graph.mean"),
    "max_latency": "latency.max",
    **dict.fromkeys(("memory", "memory_usage", "ram", "rss"), "memory.graph.max"),
}
_OTHER_PARTS: Final = {"avg": "mean", "average": "mean", "median": "p50"}
"""Words of other tools, and the words for them here."""
_PARTS: Final = ("min", "mean", "p50", "p90", "p95", "p99", "max")


def _translated(name: str) -> str:
    """Return a name of other tools as it is written here; empty for a name of none."""
    series, _, part = name.rpartition(".")
    if series and part in _OTHER_PARTS:
        return f"{series}.{_OTHER_PARTS[part]}"
    return _OTHER_NAMES.get(series if part in _PARTS else name, "")


def _unknown_metric(name: str, message: str, subjects: Subjects, prefix: str = "") -> MetricError:
    """Return the error for an unknown name, with the names of its family, or all."""
    family = name.partition(".")[0]
    everything = names(subjects)
    known = (
        tuple(metric_name for metric_name in everything if metric_name.partition(".")[0] == family)
        or everything
    )
    translated = _translated(name)
    close = translated if translated in everything else did_you_mean(name, known)
    return MetricError(
        message,
        tuple(prefix + metric_name for metric_name in known),
        prefix + close if close else "",
    )


MODES = ("looping", "sweeping", "timeline", "live")
"""The values of ``playback.mode``."""

_BINOMIAL = ("exact binomial test on single messages", "exact binomial")

JUDGED: dict[Statistic, tuple[str, str]] = {
    "percentile": _BINOMIAL,
    "share": _BINOMIAL,
    "mean": ("Student's t over the iterations", "Student's t"),
    "observation": (
        "an observation: the value is compared, without a confidence",
        "observation",
    ),
    "search": ("the final bracket of the search", "the bracket"),
    "sequential": ("one sequential probe", "a sequential probe"),
}
"""How metrics are judged: in full, and as in the table of docs/metrics.md."""


def modes(metric: Metric) -> tuple[str, ...]:
    """Return the playback modes in which a metric has a value."""
    if metric.scope in {Scope.SEARCH, Scope.PROBE}:
        return MODES[:2]
    return MODES if metric.live else MODES[:-1]


def find_metric(name: str) -> MetricInfo:
    """Return the metric of a name with any monitor, process, node or topic in it.

    Raises:
        MetricError: there is none; with what was probably meant.
    """
    for candidate in (name, name.partition(".")[2]):
        info = listed().get(candidate) or _find(candidate, None)
        if info is not None:
            return info
    first, _, rest = name.partition(".")
    process = rest.rpartition(".")[0]
    of_process = any(metric.name == f"{first}.{PROCESS}" for metric in DECLARED)
    try:
        # No node of that name is known: what is suggested has none.
        return resolve(name, (), Subjects(processes=(process,) if of_process else ()))[1]
    except MetricError as error:
        close = error.suggestion or did_you_mean(name, names())
        raise MetricError(str(error), error.known, close) from None


_INTRODUCTION = """\
# Metrics

Every metric that a requirement of `slos:` can name. `r2bspec docs metrics` prints this page,
`r2bspec docs latency.p99` one metric.

`detections.latency.p99` is a metric of the monitor `detections`; without a monitor, a requirement
applies to every monitor. `<process>` is any process of the plan. Other percentiles can be named,
too: `p42`, `p99_5` for 99.5 %.

- *n* is the number of outputs of a segment, *t* are their arrival times in ascending order.
- A step has one *expected* output, or as many as `ratio` says; *answered* outputs arrived.
- A percentile pQ is the k-th of the n values in ascending order, k = ceil(Q/100 · n).
- Percentiles are judged by the exact binomial test, means by Student's t, `min` and `max` by
  observation; other [tests](verdicts.md#which-test-decides-which-requirement) are named.
- `latency.{mean,p99}` means `latency.mean` and `latency.p99`, with their unit in `result.json`.
- Metrics of `<node>`, `<topic>` and `path` need `benchmark: {anatomy: true}`.
"""


def markdown_page() -> str:
    """Return the generated tables of docs/metrics.md."""
    import textwrap

    blocks = [_INTRODUCTION]
    for metric in DECLARED:
        if metric.required:
            formula = metric.formula.replace("; ", ";\n    ")
            # What is in angle brackets would be taken for HTML.
            name = f"`{metric.name}`" if metric.placeholder else metric.name
            block = [f"## {name}\n", f"{textwrap.fill(metric.text, 100)}\n"]
            block += [f"    {formula}\n", textwrap.fill(_names_and_unit(metric), 100)]
            blocks.append("\n".join(block) + "\n")
    return "\n".join(blocks)


def _names_and_unit(metric: Metric) -> str:
    """Return the names of a metric in its parts, with unit and modes.

    How it is judged is said where no part says it.
    """
    parts = ",".join(metric.parts)
    suffix = f".{{{parts}}}" if len(metric.parts) > 1 else f".{parts}" if parts else ""
    first = metric.infos[0]
    only = "" if modes(metric) == MODES else f", {_IN_MODES[modes(metric)]}"
    judged = "" if parts else f", judged by {JUDGED[first.statistic][1]}"
    return f"`{metric.name}{suffix}` ({first.unit}{only}){judged}."


_IN_MODES = {MODES[:-1]: "not live", MODES[:2]: "looping and sweeping only"}
