"""Limits proposed by a calibration, as an edit of the spec."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

from r2bspec.check.check_context import Context
from r2bspec.check.finding_location import to_diagnostic
from r2bspec.check.rule import Finding
from r2bspec.check.rules.calibrated_noise import (
    MAX_LOG_MARGIN,
    NarrowMargin,
    limit_text,
    margin_below_noise,
    narrow_margins,
)
from r2bspec.diagnostics.edits import apply_edits
from r2bspec.language.load_spec import LoadedSpec, load_spec
from r2bspec.language.located_tree import ListNode, MapNode, ScalarNode, TreeNode, lookup
from r2bspec.language.spec import Spec
from r2bspec.record.calibration_file import Calibration

_OBJECTIVE_NAME = "no_regression"
_DEFAULT_LIMITS = (("throughput.mean", ">="), ("latency.p50", "<="))
"""The proposal for a spec without requirements of the baseline."""


def propose_limits(loaded: LoadedSpec, found: Calibration, text: str) -> tuple[str, list[str]]:
    """A spec with limits above the noise.

    Margins below the noise are widened to it; margins above it are unchanged, because they are a
    decision of the user. If there is no requirement of the baseline, an objective is added.

    Args:
        loaded: the spec, with its calibration file.
        found: the calibration.
        text: the text of the spec.

    Returns:
        The text, changed or not, and what has to be changed by hand, a sentence each.
    """
    if loaded.spec is None:
        return text, []
    of_baseline = [
        requirement
        for objective in loaded.spec.slos.values()
        for requirement in objective.require
        if requirement.bound is not None and requirement.bound.of_baseline
    ]
    if not of_baseline:
        return _with_objective(loaded, loaded.spec, found, text)
    edits, left = [], []
    for each in narrow_margins(Context(loaded, loaded.spec, offline=True)):
        if not each.proposed:
            left.append(_too_noisy(each))
            continue
        finding = Finding(
            message="",
            path=each.known_metric.located.path,
            part=each.part,
            replacement=each.proposed,
        )
        edit = to_diagnostic(
            finding, margin_below_noise.code, margin_below_noise.page.severity, loaded
        ).edit
        if edit is not None and edit.span.file == loaded.file:
            edits.append(edit)
        else:
            left.append(
                f"the limit of '{each.known_metric.located.requirement.text}' is set in another "
                f"file: change it to {each.proposed} there"
            )
    return apply_edits(text, edits), left


def _too_noisy(each: NarrowMargin) -> str:
    return (
        f"'{each.known_metric.located.requirement.text}': {each.detectable_text}; increase "
        "'benchmark.iterations', make iterations longer, or use a quieter machine"
    )


def _with_objective(
    loaded: LoadedSpec, spec: Spec, found: Calibration, text: str
) -> tuple[str, list[str]]:
    requirements = list(_requirements(spec, found))
    if not requirements:
        return text, ["the noise of every metric is too large here to propose a limit"]
    rate = spec.benchmark.rates[0]
    names = itertools.chain(
        [_OBJECTIVE_NAME], (f"{_OBJECTIVE_NAME}_{n}" for n in itertools.count(2))
    )
    name = next(each for each in names if each not in spec.slos)
    lines = [f"{name}:", f"  at: {rate}", "  require:"]
    lines += [f"    - {each}" for each in requirements]
    proposed = insert_objective(loaded, text, lines)
    by_hand = [f"add an objective by hand: {'; '.join(requirements)}"]
    if proposed is None:
        return text, by_hand
    again = load_spec(proposed, file=loaded.file)
    return (proposed, []) if again.spec is not None else (text, by_hand)


def _requirements(spec: Spec, found: Calibration) -> Iterator[str]:
    if not spec.benchmark.rates:
        return
    at_hz = spec.benchmark.rates[0].hz
    several = len(spec.monitors) > 1
    for noise in found.metrics:
        for metric, op in _DEFAULT_LIMITS:
            margin = noise.margin(spec.benchmark.iterations)
            if (noise.metric, noise.at_hz) != (metric, at_hz) or margin is None:
                continue
            if margin <= MAX_LOG_MARGIN:
                name = f"{noise.monitor}.{metric}" if several else metric
                yield f"{name} {op} {limit_text(margin, ceiling=op == '<=')} of baseline"


def insert_objective(loaded: LoadedSpec, text: str, lines: list[str]) -> str | None:
    """The text with an objective at the end of ``slos``; None if it has to be added by hand."""
    slos = lookup(loaded.tree, ("slos",)) if loaded.tree is not None else None
    if slos is None:
        end = "" if text.endswith("\n") or not text else "\n"
        body = "".join(f"  {line}\n" for line in lines)
        return f"{text}{end}\nslos:\n{body}"
    if not isinstance(slos, MapNode) or not slos.entries:
        return None
    keys = [entry.key_span for entry in slos.entries.values()]
    columns = {key.column for key in keys}
    first = next(iter(keys))
    written = text.splitlines(keepends=True)
    if any(key.file != loaded.file for key in keys) or len(columns) > 1:
        return None
    # In flow style the keys follow a brace.
    if written[first.line - 1][: first.column - 1].strip():
        return None
    last = max(_last_line(entry.value) for entry in slos.entries.values())
    indent = " " * (first.column - 1)
    if not written[last - 1].endswith("\n"):
        written[last - 1] += "\n"
    return "".join([*written[:last], *(f"{indent}{line}\n" for line in lines), *written[last:]])


def _last_line(node: TreeNode) -> int:
    """The last line of a value."""
    if isinstance(node, MapNode) and node.entries:
        return max(_last_line(entry.value) for entry in node.entries.values())
    if isinstance(node, ListNode) and node.items:
        return max(_last_line(item) for item in node.items)
    span = node.span
    return span.end_line if isinstance(node, ScalarNode) else max(span.line, span.end_line)
