"""A metric is declared once: name, scope, dimension, value, test, losses, and where it is shown.

A declaration is a function of `metric_declarations` with the decorator `metric`. It returns the
values of the metric in one segment; its docstring is the definition, whose last paragraph is the
formula. Every list, table, page, completion and format follows from the declarations (`DECLARED`).

This module imports no NumPy, so that a spec can be checked with it.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from enum import StrEnum
from typing import Any, Final, Literal, Self, TypeVar

import msgspec

from r2bspec.judge.measure.distribution import part_title, quantile
from r2bspec.language.comparison_grammar import Bound

Statistic = Literal["percentile", "share", "mean", "observation", "search", "sequential"]
"""How a bound on the metric is decided: by the exact binomial test on single messages
(percentile, share), by t over the iterations (mean), by comparing the observed value
(observation), by the bracket of the search (search) or by a probe (sequential)."""

Dimension = Literal["time", "rate", "size", "share", "power", "energy", "count", "none"]

Outputs = Literal["answers", "any", "own pace", "live"]
"""The outputs of a monitor: a known number of answers to inputs, any number of these, of a pace of
their own, or of a graph that has its own source."""

OUTPUTS: Final[tuple[Outputs, ...]] = ("answers", "any", "own pace", "live")

Section = Literal["", "latency", "messages"]
"""A table of the HTML page."""

SECTIONS: Final[tuple[Section, ...]] = ("latency", "messages")

PROCESS: Final = "<process>"
NODE: Final = "<node>"
TOPIC: Final = "<topic>"
MONITOR: Final = "<monitor>"
"""Placeholders in names: for any process, any node of the graph, any topic without the slash that
it begins with, and any monitor whose paths are observed from inside."""

PLACEHOLDERS: Final = (PROCESS, NODE, TOPIC, MONITOR)


class Scope(StrEnum):
    """The kind of thing that a metric belongs to. Only names of monitor metrics have a prefix."""

    measured_for: str

    def __new__(cls, value: str, measured_for: str) -> Self:
        """Return a member with the text that says what it is measured for."""
        member = str.__new__(cls, value)
        member._value_ = value
        member.measured_for = measured_for
        return member

    MONITOR = "monitor", "each monitor; MONITOR.NAME for one of several"
    PLAYBACK = "playback", "the playback"
    PROCESS = "process", "each process of the plan"
    GRAPH = "graph", "the graph"
    MACHINE = "machine", "the machine"
    DEVICE = "device", "the GPUs and processors of the machine; processes on a GPU"
    WORK = "work", "each process of the graph, and the graph"
    SEARCH = "search", "the search for the peak"
    PROBE = "probe", "a probe at one rate"
    ANATOMY = "anatomy", "each node, topic or monitor, with 'benchmark: {anatomy: true}'"

    @property
    def is_sampled(self) -> bool:
        """Whether a missing value means that nothing was sampled, not that nothing arrived."""
        return self in {Scope.PROCESS, Scope.GRAPH, Scope.MACHINE, Scope.DEVICE, Scope.WORK}

    @property
    def of_messages(self) -> bool:
        """Whether values are of single messages, or counts of messages."""
        return self in {Scope.MONITOR, Scope.PLAYBACK, Scope.ANATOMY}

    @property
    def in_probes(self) -> bool:
        """Whether the probes of a search measure it."""
        return self in {Scope.MONITOR, Scope.PLAYBACK}


_UNITS_AND_EXAMPLES: dict[Dimension, tuple[str, str]] = {
    "time": ("s", "<= 50 ms"),
    "rate": ("Hz", ">= 30 Hz"),
    "size": ("B", "<= 64 MiB"),
    "share": ("share", "<= 2 %"),
    "power": ("W", "<= 15 W"),
    "energy": ("J", "<= 500 mJ"),
    "count": ("count", "== 0"),
    "none": ("", ""),
}
"""The unit of values, and a requirement on them."""


class Metric(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A metric, with all parts of its distribution.

    Attributes:
        name: without a monitor and without a part, such as ``latency`` or ``cpu.<process>``.
        what: in a few words.
        read: its value in a segment; see `metric_declarations`.
        text: its definition, in sentences.
        formula: in the terms of the text.
        unit: the unit of values, where the dimension does not say it.
        parts: those that are listed; empty for a metric that is one value. Where one of them is a
            percentile, a requirement can name every other percentile, too.
        whats: in a few words, of parts for which `what` does not say it.
        statistic: the statistic of a metric that is one value; that of a part follows from the
            part.
        noun: what single values are of, in the plural.
        fewer: how many values fewer than messages an iteration has.
        lost_is_slowest: whether an output that never came counts as slower than every other.
        of_pairs: whether it is known only if it is known which input an output answers.
        of_stamps: whether it needs messages with the stamp of an input, or of their source.
        counts_losses: whether it counts outputs that never came.
        counts_faults: whether it counts what should not be at all.
        needs_stamp_matching: whether a monitor that matches by order cannot count it.
        of_one_node: whether the events of the node's own process are enough.
        at_any: whether it is known at a monitor whose inputs have any number of outputs.
        at_own_pace: whether it is known at a monitor whose outputs answer no input; then also
            where inputs have any number of outputs.
        live: whether it is known in a live run, in which the graph has its own source.
        by_turns: whether it can be compared with a baseline by turns.
        level: what is compared between iterations, as words; empty if nothing is.
        more_is_better: as for a rate.
        zero_is_ordinary: whether 0, as of a share, is no sign that nothing arrived.
        required: whether a requirement can name it; others are only reported.
        title: heads its columns, before the part; the name, if empty.
        columns: the parts in the table of a monitor, in reports of every kind; the empty part
            stands for a metric that is one value.
        column_of: the outputs in whose table it is.
        reported_of: the outputs of which results have it.
        section: the table of the HTML page that has it.
        section_parts: the parts that it has there; all, if empty.
        compared: the parts in which `compare` compares two results.
        range_of: the parts of which a result has the range over the iterations.
    """

    name: str
    scope: Scope
    dimension: Dimension
    what: str
    read: Callable[[Any], Any]
    text: str
    formula: str
    unit: str = ""
    parts: tuple[str, ...] = ()
    whats: Mapping[str, str] = {}
    statistic: Statistic = "observation"
    noun: str = "steps"
    fewer: int = 0
    lost_is_slowest: bool = False
    of_pairs: bool = False
    of_stamps: bool = False
    counts_losses: bool = False
    counts_faults: bool = False
    needs_stamp_matching: bool = False
    of_one_node: bool = False
    at_any: bool = False
    at_own_pace: bool = False
    live: bool = False
    by_turns: bool = False
    level: str = ""
    more_is_better: bool = False
    zero_is_ordinary: bool = False
    required: bool = True
    title: str = ""
    columns: tuple[str, ...] = ()
    column_of: tuple[Outputs, ...] = OUTPUTS
    reported_of: tuple[Outputs, ...] = OUTPUTS
    section: Section = ""
    section_parts: tuple[str, ...] = ()
    compared: tuple[str, ...] = ()
    range_of: tuple[str, ...] = ()

    @property
    def placeholder(self) -> str:
        """The placeholder in its name; empty for none."""
        return next((each for each in PLACEHOLDERS if each in self.name), "")

    @property
    def has_percentiles(self) -> bool:
        """Whether a requirement can name every percentile."""
        return any(quantile(part) is not None for part in self.parts)

    @property
    def infos(self) -> tuple[MetricInfo, ...]:
        """The metric in each listed part."""
        return tuple(MetricInfo(self, part) for part in self.parts or ("",))

    def known_of(self, outputs: Outputs) -> bool:
        """Return True if the metric is known at a monitor with such outputs."""
        if outputs == "any":
            return self.at_any or self.at_own_pace
        return {"own pace": self.at_own_pace, "live": self.live}.get(outputs, True)

    @property
    def full_formula(self) -> str:
        """The formula, followed by the rule of percentiles if it has percentiles."""
        return f"{self.formula}; {PERCENTILE_RULE}" if self.has_percentiles else self.formula

    def part(self, part: str) -> MetricInfo | None:
        """Return the metric in a part; None if it has no such part."""
        is_known = part in (self.parts or ("",)) or (
            self.has_percentiles and quantile(part) is not None
        )
        return MetricInfo(self, part) if is_known else None

    def subject_in(self, name: str) -> str | None:
        """Return the subject in a name without part; None if the name is of another metric.

        Empty for a metric without a placeholder.
        """
        if not self.placeholder:
            return "" if name == self.name else None
        before, _, after = self.name.partition(self.placeholder)
        has_both = name.startswith(before) and name.endswith(after)
        subject = name[len(before) : len(name) - len(after)] if has_both else ""
        # Only names of processes have dots.
        return subject if subject and (self.placeholder == PROCESS or "." not in subject) else None


class MetricInfo(msgspec.Struct, frozen=True):
    """A part of a metric, for one process, node or topic if its name has a placeholder.

    Attributes:
        part: such as ``p99``; empty for a metric that is one value.
        subject: in the place of the placeholder; empty if the placeholder is left.
    """

    metric: Metric
    part: str = ""
    subject: str = ""

    @property
    def series(self) -> str:
        """The name without the part, such as ``latency`` or ``blur.callback``."""
        name, placeholder = self.metric.name, self.metric.placeholder
        return name.replace(placeholder, self.subject) if placeholder and self.subject else name

    @property
    def name(self) -> str:
        """The dotted name without a monitor, such as ``latency.p99``."""
        return f"{self.series}.{self.part}" if self.part else self.series

    @property
    def scope(self) -> Scope:
        """The scope of the metric."""
        return self.metric.scope

    @property
    def dimension(self) -> Dimension:
        """The dimension of values and bounds."""
        return self.metric.dimension

    @property
    def unit(self) -> str:
        """The unit of values: ``s``, ``Hz``, ``B``, ``share`` or ``count``.

        A share is a fraction; of processor time, one core is 1.
        """
        return self.metric.unit or _UNITS_AND_EXAMPLES[self.dimension][0]

    @property
    def quantile(self) -> float | None:
        """The fraction of messages at or below the value; None if it is no percentile."""
        return quantile(self.part)

    @property
    def statistic(self) -> Statistic:
        """The statistic by which a bound is decided."""
        if not self.part:
            return self.metric.statistic
        if self.part == "mean":
            return "mean"
        return "observation" if self.quantile is None else "percentile"

    @property
    def description(self) -> str:
        """A description in a few words."""
        what, q = self.metric.whats.get(self.part, self.metric.what), self.quantile
        if q is not None:
            return f"{what}: {q * 100:g} % of the values are at or below"
        word = {"min": "smallest", "mean": "mean", "max": "largest"}.get(self.part, "")
        return f"{word} {what}" if word and self.part not in self.metric.whats else what

    @property
    def place(self) -> str:
        """Its place below a monitor in ``result.json``, such as ``values/latency/p99``."""
        has_distribution = self.metric.has_percentiles
        return f"values/{self.series}/{self.part}" if has_distribution else f"values/{self.name}"

    @property
    def title(self) -> str:
        """The heading of its column."""
        title = self.metric.title
        several = len(self.metric.parts) > 1
        return f"{title} {part_title(self.part)}".strip() if several else title or self.name

    @property
    def may_be_zero(self) -> bool:
        """Whether 0 is an ordinary value, and no sign that nothing arrived."""
        return self.dimension == "share" or self.metric.zero_is_ordinary

    @property
    def example(self) -> str:
        """An example of a requirement."""
        return f"{self.name} {_UNITS_AND_EXAMPLES[self.dimension][1]}".rstrip()

    def accepts(self, bound: Bound) -> bool:
        """Return True if a bound has the dimension of this metric.

        'of offered' applies to rates only; 'of baseline' to every metric that has a value in each
        iteration and is not a count.
        """
        if bound.of_offered:
            return self.dimension == "rate"
        if bound.of_baseline:
            return self.dimension not in {"count", "none"}
        return bound.dimension == self.dimension


DECLARED: Final[list[Metric]] = []
"""Every metric, in the order of lists and complete tables; import it from `metric_declarations`."""

_Read = TypeVar("_Read", bound=Callable[..., Any])

PERCENTILE_RULE: Final = (
    "pQ: the k-th of the n values in ascending order, k = ceil(Q/100 · n); always an observed value"
)


def metric(
    name: str, scope: Scope, dimension: Dimension, what: str, **traits: Any
) -> Callable[[_Read], _Read]:
    """Declare a metric by a function; `Metric` describes its traits."""

    def declare(read: _Read) -> _Read:
        text, _, formula = inspect.cleandoc(read.__doc__ or "").rpartition("\n\n")
        declared = Metric(
            name=name,
            scope=scope,
            dimension=dimension,
            what=what,
            read=read,
            text=" ".join(text.split()),
            formula=" ".join(formula.split()),
            **traits,
        )
        DECLARED.append(declared)
        return read

    return declare
