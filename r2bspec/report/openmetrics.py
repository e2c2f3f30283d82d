"""OpenMetrics text, as Prometheus and its relatives scrape it or read it from a file.

All numbers are gauges or summaries over all iterations of a rate; times are seconds, shares ratios.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.measure.distribution import PERCENTILES, Distribution, part_value
from r2bspec.judge.measure.metric_catalogue import ANATOMY_SHARES
from r2bspec.judge.measure.metrics import RateMetrics, RunMetrics
from r2bspec.judge.measure.units import rate_name
from r2bspec.judge.result import Result
from r2bspec.judge.verdict import EXIT_CODES
from r2bspec.record.run_record import HarnessOverheadRecord
from r2bspec.report.report_wording import own_pace
from r2bspec.report.result_table import METRICS, measured

_SUMMARIES = {
    "latency": "Time from publication of the input to reception of the output.",
    "latency_from_due": "Time from the due time of the input to reception of the output.",
    "reaction": "Time from an input event to the first output that meets the condition.",
    "age": "Time from publication of the newest input in an output to its reception.",
    "interval": "Time between consecutive outputs.",
    "jitter": "Absolute difference of consecutive intervals.",
}

_GAUGES = {
    "throughput.mean": ("throughput_hertz", "hertz", "Outputs per second."),
    "drop_rate": ("drop_ratio", "ratio", "Missed outputs / expected outputs."),
    **{
        count: (f"{count}_messages", "messages", about)
        for count, about in {
            "sent": "Steps played.",
            "answered": "Expected outputs received.",
            "missed": "Expected outputs not received.",
            "received": "Messages received, matched or not.",
            "duplicates": "Repeated outputs of a step.",
            "reordered": "Outputs received after that of a later step.",
            "unmatched": "Messages that match no step.",
            "late": "Outputs received after the period of the last step.",
            "overdue": "Unmatched messages that match a step of an earlier segment.",
        }.items()
    },
}
"""The metrics of a monitor that are one number: name of the family, unit, and description."""

_PEAKS = {
    "r2bspec_peak_hertz": "Highest sustained rate: lower bound of the peak.",
    "r2bspec_peak_below_hertz": "Lowest rate not sustained: upper bound of the peak.",
}

_OUTCOMES = ("pass", "fail", "inconclusive")

Labels = Mapping[str, str]


@dataclass
class _Family:
    """One metric family with its samples."""

    name: str
    kind: str
    about: str
    unit: str = ""
    samples: list[tuple[str, Labels, float]] = field(default_factory=list)

    def add(self, labels: Labels, value: float | None, suffix: str = "") -> None:
        """Add a sample; nothing for None, and for a negative time in a summary.

        The format forbids these. An output that came before its step, matched by order, has one.
        """
        if value is not None and not (self.kind == "summary" and value < 0):
            self.samples.append((suffix, labels, value))

    def add_states(self, labels: Labels, states: Iterable[str], current: str) -> None:
        """Add a sample for each state, 1 for the current one."""
        for state in states:
            self.add({**labels, self.name: state}, int(state == current))

    def lines(self) -> Iterator[str]:
        if not self.samples:
            return
        yield f"# TYPE {self.name} {self.kind}"
        if self.unit:
            yield f"# UNIT {self.name} {self.unit}"
        yield f"# HELP {self.name} {_escaped(self.about)}"
        for suffix, labels, value in self.samples:
            shown = ",".join(f'{key}="{_escaped(text)}"' for key, text in labels.items())
            yield f"{self.name}{suffix}{{{shown}}} {value!r}"


def render(report_input: ReportInput) -> bytes:
    """The exposition, ended by ``# EOF`` as the format wants it."""
    lines = [line for family in _families(report_input) for line in family.lines()]
    return "\n".join([*lines, "# EOF", ""]).encode()


def _families(report_input: ReportInput) -> Iterator[_Family]:
    result = report_input.result
    named = {"benchmark": result.name}
    yield _info(report_input)
    verdict = _Family("r2bspec_verdict", "stateset", "Outcome of the run.")
    verdict.add_states(named, EXIT_CODES, result.verdict.outcome)
    yield verdict
    yield from _requirements(result)
    yield from _of_monitors(result.metrics, named)
    yield from _of_processes(result.metrics.rates, named)
    yield from _of_parts(result.metrics.rates, named)
    search = result.metrics.search
    if search is not None and search.holds_hz is not None:
        for (name, about), value in zip(
            _PEAKS.items(), (search.holds_hz, search.upper_hz), strict=True
        ):
            peak = _Family(name, "gauge", about, "hertz")
            peak.add(named, value)
            yield peak
    yield _harness_overhead(result.harness_overhead, named)


def _info(report_input: ReportInput) -> _Family:
    result = report_input.result
    family = _Family("r2bspec_run", "info", "Identity of the run.")
    labels = {
        "benchmark": result.name,
        "run_id": result.run_id,
        "plan_hash": result.plan_hash,
        "started_at": result.started_at,
        "cpu": str(result.machine.get("cpu", "")),
        "r2bspec": result.versions.get("r2bspec", ""),
    }
    family.add(labels, 1, "_info")
    return family


def _requirements(result: Result) -> Iterator[_Family]:
    outcomes = _Family("r2bspec_requirement", "stateset", "Outcome of each requirement.")
    about = "Head over base, for requirements of the baseline."
    ratios = _Family("r2bspec_baseline_ratio", "gauge", about, "ratio")
    named, pace = {"benchmark": result.name}, own_pace(result.metrics)
    for requirement in result.verdict.requirements:
        labels = {
            "requirement": requirement.text.strip(),
            "monitor": requirement.monitor or "",
            "offered_hz": _rate(requirement.at_hz, pace) if requirement.at_hz is not None else "",
        }
        states = {**named, "objective": requirement.objective, **labels}
        outcomes.add_states(states, _OUTCOMES, requirement.outcome)
        if requirement.compared is not None:
            for name in ("estimate", "lower", "upper", "limit"):
                ratios.add({**named, **labels, "value": name}, getattr(requirement, name))
    yield outcomes
    yield ratios


def _of_monitors(metrics: RunMetrics, named: Labels) -> Iterator[_Family]:
    rows = [
        (
            {
                **named,
                "offered_hz": _rate(row.rate.offered_hz, row.rate.pace),
                "monitor": row.monitor,
            },
            row.seen,
        )
        for row in measured(metrics)
    ]
    for key, about in _SUMMARIES.items():
        family = _Family(f"r2bspec_{key}_seconds", "summary", about, "seconds")
        for labels, seen in rows:
            times = getattr(seen, key)
            # In a live run, what was sent is unknown, and so are some times.
            if times and (times.n or seen.sent is not None):
                _add_summary(family, times, labels)
        if any(getattr(seen, key) for _, seen in rows):
            yield family
    for metric, (name, unit, about) in _GAUGES.items():
        gauge = _Family(f"r2bspec_{name}", "gauge", about, unit)
        for labels, seen in rows:
            gauge.add(labels, METRICS[metric].value(seen))
        yield gauge


def _add_summary(family: _Family, times: Distribution, labels: Labels) -> None:
    for part, q in PERCENTILES.items():
        family.add({**labels, "quantile": f"{q:g}"}, part_value(times, part))
    family.add(labels, times.n, "_count")
    family.add(labels, (times.mean or 0.0) * times.n, "_sum")


def _harness_overhead(overheads: tuple[HarnessOverheadRecord, ...], named: Labels) -> _Family:
    about = "Latency of harness and transport without the graph; included in the latencies."
    family = _Family("r2bspec_harness_overhead_seconds", "summary", about, "seconds")
    for overhead in overheads:
        labels = {
            **named,
            "topic": overhead.topic,
            "offered_hz": _rate(overhead.rate_hz),
            "placement": overhead.placement,
            "processes": str(overhead.processes or ""),
        }
        for part, value_ns in overhead.latencies_ns.items():
            family.add({**labels, "quantile": f"{PERCENTILES[part]:g}"}, value_ns / 1e9)
        family.add(labels, overhead.received, "_count")
    return family


def _of_processes(rates: tuple[RateMetrics, ...], named: Labels) -> Iterator[_Family]:
    cpu = _Family("r2bspec_cpu_ratio", "gauge", "Mean processor time; one core is 1.", "ratio")
    memory = _Family("r2bspec_memory_bytes", "gauge", "Largest resident set.", "bytes")
    for rate in rates:
        machine = {"": rate.pooled.machine} if rate.pooled.machine is not None else {}
        for process, use in {**rate.pooled.processes, **machine}.items():
            labels = {**named, "offered_hz": _rate(rate.offered_hz, rate.pace), "process": process}
            cpu.add(labels, use.cpu_mean)
            memory.add(labels, use.memory_max_bytes)
    yield cpu
    yield memory


def _of_parts(rates: tuple[RateMetrics, ...], named: Labels) -> Iterator[_Family]:
    about = "Time of a part of a node, topic or monitor, observed from inside."
    times = _Family("r2bspec_part_seconds", "summary", about, "seconds")
    about = "Load, overtaken messages or share of a path of a node, observed from inside."
    shares = _Family("r2bspec_part_ratio", "gauge", about, "ratio")
    for rate in rates:
        for series, values in (rate.pooled.anatomy or {}).items():
            labels = {**named, "offered_hz": _rate(rate.offered_hz, rate.pace), "part": series}
            if series.endswith(ANATOMY_SHARES):
                shares.add(labels, values.mean)
            else:
                _add_summary(times, values, labels)
    yield times
    yield shares


def _rate(rate_hz: float, pace: str = "") -> str:
    return f"{rate_hz:g}" if rate_hz else rate_name(0.0, pace)


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace("\n", "\\n").replace('"', '\\"')
