"""Every metric: its name, what it measures, its dimension, and how it is judged.

Grammar of a metric's name, as a requirement writes it::

    metric = [monitor "."] name ["." part]          latency.p99, detections.latency.p99
           | ("cpu" | "memory" | "work") "." process "." part    cpu.apriltag.mean, work.graph.p50
           | node "." family ["." part]                 blur.callback.p99, blur.load
           | topic ".transport." part                   camera/image.transport.p50

This module computes nothing and imports no NumPy, so that a spec can be checked with it.

``r2bspec docs METRIC`` and docs/metrics.md show what each of them means.
Everything but the definitions comes from the catalogue, so that a new metric appears there by
itself; the definitions are prose, in `metric_definitions.yaml`.
"""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Iterator
from functools import cache
from pathlib import Path
from typing import Final, Literal

import msgspec
from msgspec.structs import replace

from r2bspec.diagnostics import did_you_mean
from r2bspec.judge.measure.distribution import PARTS, SHORT_PERCENTILES, quantile
from r2bspec.language.comparison_grammar import Bound
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


Statistic = Literal["percentile", "share", "mean", "observation", "search", "sequential"]
"""How a bound on the metric is decided: by the exact binomial test on single messages
(percentile, share), by t over the iterations (mean), by comparing the observed value
(observation), by the bracket of the search (search) or by a probe (sequential)."""

Scope = Literal[
    "monitor",
    "playback",
    "process",
    "graph",
    "machine",
    "work",
    "search",
    "probe",
    "anatomy",
]
"""What the metric belongs to; those of scope ``anatomy`` belong to a node or a topic. Only the
metrics of a monitor are prefixed with its name."""

Dimension = Literal["time", "rate", "size", "share", "count", "none"]

WHOLE_GRAPH: Final = "graph"
"""All processes of the graph together, in place of a process in the names of metrics."""

PROCESS = "<process>"
"""Placeholder for the name of any process in the catalogue's names."""

NODE = "<node>"
TOPIC = "<topic>"
MONITOR = "<monitor>"
"""Placeholders for any node of the graph, for any topic, without the slash that it begins with, and
for any monitor, in the names of metrics that are observed from inside."""


class Subjects(msgspec.Struct, frozen=True):
    """What a run has metrics of.

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
        """Those of a run of a plan."""
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
        """The names that a placeholder stands for."""
        return {
            PROCESS: self.processes,
            NODE: self.nodes,
            TOPIC: self.topics,
            MONITOR: self.monitors,
        }[placeholder]


NO_SUBJECTS: Final = Subjects()


class MetricInfo(msgspec.Struct, frozen=True):
    """One metric.

    Attributes:
        name: the dotted name without a monitor, such as ``latency.p99``.
        unit: the unit of values: ``s``, ``Hz``, ``B``, ``share`` (a fraction; of processor time,
            one core is 1), ``count``, or empty for none. That of ``sustained``, which has no
            bound, is the unit of the delivered rate.
        quantile: for percentiles, the fraction of messages at or below; otherwise None.
        subject: the process, node or topic in the name.
    """

    name: str
    scope: Scope
    dimension: Dimension
    unit: str
    statistic: Statistic
    description: str
    quantile: float | None = None
    subject: str = ""

    @property
    def family(self) -> str:
        """The name up to the first dot; where that is a node or topic, the word after it."""
        name = self.name
        if self.scope == "anatomy":
            name = name.removeprefix(f"{self.subject}.")
        return name.partition(".")[0]

    @property
    def series(self) -> str:
        """The name of the values behind a metric of a node or topic, such as ``blur.callback``."""
        head, _, last = self.name.rpartition(".")
        return head if quantile(last) is not None or last in {"mean", "max"} else self.name

    @property
    def part(self) -> str:
        """The name after the last dot, or empty."""
        if self.scope == "anatomy":
            return self.name.removeprefix(self.series).removeprefix(".")
        return self.name.rpartition(".")[2] if "." in self.name else ""

    def accepts(self, bound: Bound) -> bool:
        """Whether a bound has this metric's dimension.

        'of offered' applies to rates only; 'of baseline' to every metric that has a value in each
        iteration and is not a count.
        """
        if bound.of_offered:
            return self.dimension == "rate"
        if bound.of_baseline:
            return self.dimension not in {"count", "none"}
        return bound.dimension == self.dimension


_UNITS_AND_EXAMPLES: dict[Dimension, tuple[str, str]] = {
    "time": ("s", "<= 50 ms"),
    "rate": ("Hz", ">= 30 Hz"),
    "size": ("B", "<= 64 MiB"),
    "share": ("share", "<= 2 %"),
    "count": ("count", "== 0"),
    "none": ("", ""),
}
"""The unit of values, and a requirement on them."""

_TIME_FAMILIES = {
    "latency": "time from publication of the input to reception of the output",
    "latency_from_due": "time from the due time of the input to reception of the output",
    "age": "time from publication of the newest input in an output to its reception",
    "interval": "time between consecutive outputs",
    "jitter": "absolute difference of consecutive intervals",
}
"""Families that have one value per message."""


_ANATOMY_FAMILIES = {
    "wait": (NODE, "time from when the middleware has received a message to when it is taken"),
    "take": (NODE, "time to take a message from the middleware"),
    "callback": (NODE, "time from the beginning of a callback to its end"),
    "transport": (TOPIC, "time from the stamp of the publication to that of the reception"),
    "path": (MONITOR, "time from publication of the input to reception, on the path followed"),
}
"""Families of nodes, topics and monitors with one value per message, observed from inside."""


def _time_metric(scope: Scope, family: str, part: str, what: str, subject: str = "") -> MetricInfo:
    """A part of the distribution of some times."""
    q = quantile(part)
    statistic: Statistic = "percentile" if q is not None else "observation"
    text = f"{what}: {q * 100:g} % of the values are at or below" if q is not None else what
    if part == "mean":
        statistic, text = "mean", f"mean {what}"
    elif part in _EXTREMES:
        text = f"{_EXTREMES[part]} {what}"
    info = _metric(f"{family}.{part}", scope, "time", statistic, text)
    return replace(info, quantile=q, subject=subject)


_EXTREMES = {"min": "smallest", "max": "largest"}


def _metric(
    name: str, scope: Scope, dimension: Dimension, statistic: Statistic, description: str
) -> MetricInfo:
    unit, _ = _UNITS_AND_EXAMPLES[dimension]
    return MetricInfo(name, scope, dimension, unit, statistic, description)


def _work(subject: str, part: str) -> MetricInfo:
    """A metric of the processor time that a process, or the graph, uses for a step."""
    return _time_metric("work", f"work.{subject}", part, "processor time per step", subject)


def _anatomy(family: str, part: str) -> MetricInfo:
    """A metric of a node or topic, with a placeholder in its name."""
    subject, what = _ANATOMY_FAMILIES[family]
    return _time_metric("anatomy", f"{subject}.{family}", part, what, subject)


ANATOMY_SHARES: Final = (".load", ".overtaken", ".share")
"""How the names of metrics of nodes end that have one value; see `_anatomy_share`."""


def _anatomy_share(name: str, description: str) -> MetricInfo:
    return replace(_metric(name, "anatomy", "share", "mean", description), subject=NODE)


_LATENESS_DESCRIPTION = "time from when a publication was due to when it began"

_CATALOGUE: tuple[MetricInfo, ...] = (
    _metric("throughput.mean", "monitor", "rate", "mean", "output rate: outputs / window of time"),
    *(
        _time_metric("monitor", family, part, what)
        for family, what in _TIME_FAMILIES.items()
        for part in PARTS
    ),
    _metric("sent", "playback", "count", "observation", "steps played"),
    _metric("received", "monitor", "count", "observation", "messages received, matched or not"),
    _metric("missed", "monitor", "count", "observation", "expected outputs not received"),
    _metric("drop_rate", "monitor", "share", "share", "missed / expected outputs"),
    _metric("duplicates", "monitor", "count", "observation", "repeated outputs of a step"),
    _metric("reordered", "monitor", "count", "observation", "outputs after that of a later step"),
    _metric("unmatched", "monitor", "count", "observation", "messages that match no step"),
    _metric(
        "playback.rate", "playback", "rate", "mean", "published rate: (n - 1) / (last - first)"
    ),
    *(
        _time_metric("playback", "playback.lateness", part, _LATENESS_DESCRIPTION)
        for part in (*SHORT_PERCENTILES, "max")
    ),
    _metric(f"cpu.{PROCESS}.mean", "process", "share", "mean", "processor time; one core is 100 %"),
    _metric(
        f"cpu.{PROCESS}.max", "process", "share", "observation", "the same in the busiest sample"
    ),
    _metric(f"memory.{PROCESS}.max", "process", "size", "observation", "largest resident set"),
    _metric("cpu.graph.mean", "graph", "share", "mean", "the same of all processes of the graph"),
    _metric("cpu.graph.max", "graph", "share", "observation", "the same in their busiest sample"),
    _metric(
        "memory.graph.max", "graph", "size", "observation", "largest sum of their resident sets"
    ),
    *(
        _work(subject, part)
        for subject in (PROCESS, WHOLE_GRAPH)
        for part in ("mean", "p10", "p25", "p50", "p90")
    ),
    _metric("cpu.system.mean", "machine", "share", "mean", "CPU of the machine; one core is 100 %"),
    _metric("cpu.system.max", "machine", "share", "observation", "the same in the busiest sample"),
    _metric(
        "memory.system.max",
        "machine",
        "size",
        "observation",
        "largest memory in use on the machine",
    ),
    *(
        _anatomy(family, part)
        for family in _ANATOMY_FAMILIES
        for part in ("mean", *SHORT_PERCENTILES, "max")
    ),
    _anatomy_share(f"{NODE}.load", "time in callbacks / window of time"),
    _anatomy_share(f"{NODE}.overtaken", "messages that it never took / messages sent to it"),
    _anatomy_share(f"path.{NODE}.share", "mean share of the latency that is spent in the node"),
    _metric("peak.rate", "search", "rate", "search", "highest sustained rate"),
    replace(
        _metric(
            "sustained", "probe", "none", "sequential", "whether the offered rate is sustained"
        ),
        unit="Hz",
    ),
)

METRICS: dict[str, MetricInfo] = {info.name: info for info in _CATALOGUE}
"""Every metric by name; ``<process>`` stands for any process, and more percentiles than those
listed exist (see `r2bspec.judge.measure.distribution.quantile`)."""


_PROCESS_FAMILIES = ("cpu", "memory", "work")

_OWN_PACE_FAMILIES = ("throughput", "age", "interval", "jitter", "received")
"""Families of a monitor's metrics that do not depend on what was played."""


def available_live(info: MetricInfo) -> bool:
    """Whether a metric is known in a live run, in which the graph has its own source."""
    known = {*_OWN_PACE_FAMILIES, "latency", "cpu", "memory"}
    return info.scope == "anatomy" or info.family in known


def available_at_own_pace(info: MetricInfo) -> bool:
    """Whether a metric of a monitor is known where no output is expected."""
    return info.family in _OWN_PACE_FAMILIES


def resolve(
    metric: str, monitors: Collection[str], subjects: Subjects = NO_SUBJECTS
) -> tuple[str | None, MetricInfo]:
    """Find the metric of a requirement's dotted name.

    A metric of a monitor may be written without the monitor: it then refers to the only
    monitor, or, with several, to each of them that has it (the monitor returned is None). A
    name that is a metric by itself takes precedence over a monitor with the name of a metric's
    family.

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
        only = next(iter(monitors)) if len(monitors) == 1 and info.scope == "monitor" else None
        return only, info
    first, _, rest = metric.partition(".")
    if first in monitors:
        if not rest:
            raise _unknown_metric(metric, f"{metric!r} is a monitor, without a metric", subjects)
        info = _find(rest, subjects)
        if info is None:
            of_one = replace(subjects, processes=(), nodes=(), topics=(), monitors=())
            raise _unknown_metric(rest, f"there is no metric {rest!r}", of_one, prefix=f"{first}.")
        if info.scope != "monitor":
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


def _find(name: str, subjects: Subjects) -> MetricInfo | None:
    if name in METRICS and "<" not in name:
        return METRICS[name]
    family, _, part = name.rpartition(".")
    if quantile(part) is not None:
        if family in _TIME_FAMILIES:
            return _time_metric("monitor", family, part, _TIME_FAMILIES[family])
        if family == "playback.lateness":
            return _time_metric("playback", family, part, _LATENESS_DESCRIPTION)
    return _find_process(family, part, subjects) or _find_anatomy(name, subjects)


def _find_process(family: str, part: str, subjects: Subjects) -> MetricInfo | None:
    kind, _, process = family.partition(".")
    if kind == "work" and quantile(part) is not None:
        is_known = process == WHOLE_GRAPH or process in subjects.processes
        return _work(process, part) if is_known else None
    template = METRICS.get(f"{kind}.{PROCESS}.{part}")
    if template is None or process not in subjects.processes:
        return None
    return replace(template, name=f"{family}.{part}", subject=process)


def _find_anatomy(name: str, subjects: Subjects) -> MetricInfo | None:
    first, *rest = name.split(".")
    is_share = first == "path" and rest[1:] == ["share"]
    subject = rest[0] if is_share else first
    family = rest[0] if rest and not is_share else ""
    placeholder = _ANATOMY_FAMILIES.get(family, (NODE, ""))[0]
    named = subjects.named_by(placeholder)
    if placeholder == TOPIC and subject not in named:
        subject = f"{subjects.namespace}/{subject}"
        name = ".".join([subject, *rest])
    if subject not in named:
        return None
    generic = f"path.{NODE}.share" if is_share else ".".join([placeholder, *rest])
    template = METRICS.get(generic)
    if template is None and len(rest) == 2 and quantile(rest[1]) and rest[0] in _ANATOMY_FAMILIES:
        template = _anatomy(rest[0], rest[1])
    return None if template is None else replace(template, name=name, subject=subject)


def names(subjects: Subjects = NO_SUBJECTS) -> tuple[str, ...]:
    """The names of all metrics, with those of each process, node and topic written out."""
    listed: list[str] = []
    for name in METRICS:
        placeholder = next((word for word in name.split(".") if word.startswith("<")), None)
        if placeholder is None:
            listed.append(name)
        else:
            named = sorted(subjects.named_by(placeholder))
            listed += [name.replace(placeholder, subject) for subject in named]
    return tuple(dict.fromkeys(listed))


def _unknown_metric(name: str, message: str, subjects: Subjects, prefix: str = "") -> MetricError:
    """The error for an unknown name: if its first word is a family, only that family is listed."""
    family = name.partition(".")[0]
    everything = names(subjects)
    known = (
        tuple(metric_name for metric_name in everything if metric_name.partition(".")[0] == family)
        or everything
    )
    close = did_you_mean(name, known)
    return MetricError(
        message,
        tuple(prefix + metric_name for metric_name in known),
        prefix + close if close else "",
    )


MODES = ("looping", "sweeping", "timeline", "live")
"""The values of ``playback.mode``."""


class Definition(msgspec.Struct, frozen=True):
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
    from r2bspec.safe_io.safe_yaml import load_texts

    rows = load_texts(_DEFINITIONS_FILE.read_text(encoding="utf-8"))
    return {
        name: Definition(row["text"], row["formula"].replace("{percentiles}", _PERCENTILE_RULE))
        for name, row in rows.items()
    }


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

SCOPES: dict[Scope, str] = {
    "monitor": "each monitor; MONITOR.NAME for one of several",
    "playback": "the playback",
    "process": "each process of the plan",
    "graph": "the graph",
    "machine": "the machine",
    "work": "each process of the graph, and the graph",
    "search": "the search for the peak",
    "probe": "a probe at one rate",
    "anatomy": "each node, topic or monitor, with 'benchmark: {anatomy: true}'",
}


def stem(info: MetricInfo) -> str:
    """The key of a metric's definition: its name, if necessary without the last part."""
    if info.scope == "anatomy":
        placeholder = _ANATOMY_FAMILIES.get(info.family, (NODE, ""))[0]
        is_share = info.name.startswith("path.") and info.name.endswith(".share")
        return f"path.{NODE}.share" if is_share else f"{placeholder}.{info.family}"
    template = info.name.replace(info.subject, PROCESS, 1) if info.subject else info.name
    return template if template in definitions() else template.rpartition(".")[0]


def definition(info: MetricInfo) -> Definition:
    """The definition of a metric."""
    return definitions()[stem(info)]


def modes(info: MetricInfo) -> tuple[str, ...]:
    """The playback modes in which a metric has a value."""
    if info.scope in {"search", "probe"}:
        return MODES[:2]
    return MODES if available_live(info) else MODES[:-1]


def example_requirement(info: MetricInfo) -> str:
    """A requirement on the metric."""
    _, bound = _UNITS_AND_EXAMPLES[info.dimension]
    return f"{info.name} {bound}".rstrip()


def find_metric(name: str) -> MetricInfo:
    """The metric of a name, with any monitor, process, node or topic in it.

    Raises:
        MetricError: there is none; with what was probably meant.
    """
    first, _, rest = name.partition(".")
    for candidate in (name, rest):
        if candidate in METRICS:
            return METRICS[candidate]
    processes = Subjects(processes=(rest.rpartition(".")[0],) if first in _PROCESS_FAMILIES else ())
    named = replace(
        processes, nodes=(first, rest.partition(".")[0]), topics=(first,), monitors=(first,)
    )
    for candidate in (name, rest):
        with contextlib.suppress(MetricError):
            return resolve(candidate, (), named)[1]
    try:
        # No node of that name is known: what is suggested has none.
        return resolve(name, (), processes)[1]
    except MetricError as error:
        close = error.suggestion or did_you_mean(name, names())
        raise MetricError(str(error), error.known, close) from None


def groups() -> Iterator[tuple[str, tuple[MetricInfo, ...]]]:
    """The metrics by stem, in the order of the catalogue."""
    families: dict[str, list[MetricInfo]] = {}
    for info in METRICS.values():
        families.setdefault(stem(info), []).append(info)
    for name, infos in families.items():
        yield name, tuple(infos)


_INTRODUCTION = """\
# Metrics

Every metric that a requirement of `slos:` can name, as `r2bspec docs metrics` and
`r2bspec docs latency.p99` print them. This page is generated.

The name of a monitor before a metric (`detections.latency.p99`) selects the monitor; without it, a
requirement applies to each. `<process>` is the name of any process of the plan. Every other
percentile can be named, too: `p42`, `p99_5` for 99.5 %.

- *n* counts the outputs of one segment, *t* are their arrival times in ascending order.
- *Expected* outputs are one for each step, or as many as `ratio` says; *answered* ones arrived.
- A percentile pQ is the k-th of the n values in ascending order, k = ceil(Q/100 · n).
- Percentiles are judged by the exact binomial test, means by Student's t, `min` and `max` by
  observation; other [tests](verdicts.md#which-test-decides-which-requirement) are named.
- `latency.{mean,p99}` stands for `latency.mean` and `latency.p99`; in brackets is the unit that
  `result.json` has. Metrics exist in all modes of playback, unless their section says otherwise.
- Metrics of `<node>`, `<topic>` and `path` need `benchmark: {anatomy: true}`.
"""


def markdown_page() -> str:
    """docs/metrics.md."""
    import textwrap

    blocks = [_INTRODUCTION]
    for name, infos in groups():
        meant = definitions()[name]
        formula = meant.formula.replace(f"; {_PERCENTILE_RULE}", "").replace("; ", ";\n    ")
        block = [f"## {name}\n", f"{textwrap.fill(meant.text, 100)}\n", f"    {formula}\n"]
        block.append(textwrap.fill(_names_and_unit(infos), 100))
        blocks.append("\n".join(block) + "\n")
    return "\n".join(blocks)


def _names_and_unit(infos: tuple[MetricInfo, ...]) -> str:
    """Return the names of the metrics of one stem, with their unit and modes.

    How they are judged is said where no part of their names says it.
    """
    parts: dict[str, list[str]] = {}
    for info in infos:
        family, _, part = info.name.rpartition(".")
        if part in ("min", "mean", "max") or quantile(part) is not None:
            parts.setdefault(f"{family}.", []).append(part)
        else:
            parts[info.name] = []
    names = [
        f"`{family}{{{','.join(of)}}}`" if len(of) > 1 else f"`{family}{''.join(of)}`"
        for family, of in parts.items()
    ]
    first = infos[0]
    only = "" if modes(first) == MODES else f", {_IN_MODES[modes(first)]}"
    judged = f", judged by {JUDGED[first.statistic][1]}" if first.name in parts else ""
    return f"{', '.join(names)} ({first.unit}{only}){judged}."


_IN_MODES = {MODES[:-1]: "not live", MODES[:2]: "looping and sweeping only"}
