"""What can be written of a requirement or a quantity: metrics, operators, bounds and units."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from lsprotocol import types

from r2bspec.language.declaration import Rule
from r2bspec.language.quantities import QUANTITIES, Duration, Quantity
from r2bspec.language_server.analysis import Analysis
from r2bspec.language_server.cursor_context import CursorContext
from r2bspec.language_server.proposals import Proposal
from r2bspec.language_server.symbols import names_of

_OPERATORS: Final = ("<", "<=", ">", ">=", "==", "!=")
_NUMBER: Final = re.compile(r"\d+(?:\.\d*)?\Z")
_QUANTITIES: Final[Mapping[str, type[Quantity]]] = QUANTITIES | {"time": Duration}
"""The quantities by their names, and by the dimensions of metrics."""
_SPELLINGS: Final = frozenset({"µs"})
"""Units that are others in another spelling."""
_BOUNDS: Final = {
    "time": ("50 ms", "100 us", "1 s"),
    "rate": ("30 Hz", "95 % of offered", "95 % of baseline"),
    "share": ("1 %", "5 %"),
    "size": ("100 MiB", "1 GiB"),
    "count": ("0", "1"),
}


def quantities(rule: Rule, before: str) -> Iterator[Proposal]:
    """The units after a number, at a value that is a quantity.

    Args:
        rule: of the value.
        before: what is written of the value.
    """
    kind = rule.quantity
    if rule.is_parsed and kind is not None and issubclass(kind, Quantity):
        yield from _units(kind, before.split(), ends_in_space=before.endswith(" "))


def requirements(analysis: Analysis, context: CursorContext) -> Iterator[Proposal]:
    """Metrics; after a metric the operators; after an operator the bounds with their units."""
    words = context.before.split()
    ends_in_space = context.before.endswith(" ")
    if not words or (len(words) == 1 and not ends_in_space):
        yield from _metrics(analysis)
    elif len(words) == 1 or (len(words) == 2 and not ends_in_space):
        yield from (
            Proposal(each, kind=types.CompletionItemKind.Operator, order=index)
            for index, each in enumerate(_OPERATORS)
        )
    elif words[1] in _OPERATORS:
        yield from _bounds(_dimension(words[0]), words[2:], ends_in_space=ends_in_space)


def _metrics(analysis: Analysis) -> Iterator[Proposal]:
    from r2bspec.measure.metric_catalogue import METRICS, MetricError, names
    from r2bspec.measure.metric_reference import example_requirement, find_metric

    spec_context = analysis.known
    processes = spec_context.processes if spec_context is not None else ()
    monitors = names_of(analysis, "monitor")
    listed = names(processes)
    for order, name in enumerate(listed):
        info = METRICS.get(name)
        if info is None:
            try:
                info = find_metric(name)
            except MetricError:
                continue
        proposal = Proposal(
            name,
            detail=info.dimension,
            documentation=f"{info.description}\n\nFor example: `{example_requirement(info)}`",
            kind=types.CompletionItemKind.Function,
            order=100 + order,
        )
        yield proposal
        if info.scope == "monitor" and len(monitors) > 1:
            for monitor in monitors:
                yield Proposal(
                    f"{monitor}.{name}",
                    proposal.detail,
                    proposal.documentation,
                    kind=proposal.kind,
                    order=300 + order,
                )
    yield Proposal("sustained", "the rate is sustained", kind=types.CompletionItemKind.Function)


def _dimension(metric: str) -> str:
    from r2bspec.measure.metric_catalogue import MetricError
    from r2bspec.measure.metric_reference import find_metric

    for name in (metric, metric.partition(".")[2]):
        try:
            return find_metric(name).dimension
        except MetricError:
            continue
    return ""


def _bounds(dimension: str, words: Sequence[str], *, ends_in_space: bool) -> Iterator[Proposal]:
    """What can follow an operator, after the words that are written of it."""
    kind = _QUANTITIES.get(dimension)
    if not words:
        yield from (Proposal(each, dimension, order=5) for each in _BOUNDS.get(dimension, ()))
    elif kind is None:
        return
    elif len(words) == 1 or (len(words) == 2 and not ends_in_space):
        yield from _units(kind, words, ends_in_space=ends_in_space)
        if len(words) == 1 and not ends_in_space and _NUMBER.match(words[0]):
            yield Proposal(f"{words[0]} % of baseline", "of the base version", order=30)
            if dimension == "rate":
                yield Proposal(f"{words[0]} % of offered", "of the rate played", order=31)
    elif len(words) == 2:
        if words[1] == "%":
            yield Proposal("of baseline", "of the base version", order=30)
        yield Proposal("in 99 % of 1 s windows", "in a share of short windows", order=40)


def _units(
    kind: type[Quantity], words: Sequence[str], *, ends_in_space: bool
) -> Iterator[Proposal]:
    if not words or len(words) > 2 or not _NUMBER.match(words[0]):
        return
    # With a space after it, the number is a word of its own, which a proposal does not replace.
    number = f"{words[0]} " if len(words) == 1 and not ends_in_space else ""
    for order, unit in enumerate(each for each in kind.units if each not in _SPELLINGS):
        yield Proposal(
            f"{number}{unit}", kind.kind, kind=types.CompletionItemKind.Unit, order=1 + order
        )
