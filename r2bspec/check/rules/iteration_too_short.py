"""Iterations that play fewer than two messages."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Pointer, Rule, pluralize
from r2bspec.language.quantities import Duration

_MIN_MESSAGES = 2


def _find(context: Context) -> Findings:
    duration = context.spec.benchmark.duration
    for index, rate in enumerate(context.spec.benchmark.rates):
        steps = round(rate.hz * duration.seconds)
        if steps < _MIN_MESSAGES:
            needed = Duration(round(_MIN_MESSAGES / rate.hz * 1e9))
            yield Finding(
                message=f"an iteration of {duration} at {rate} plays {pluralize(steps, 'message')}",
                path=("benchmark", "rates", index),
                help=f"set 'duration' to {needed} or longer, for at least two messages",
                related=(Pointer(f"an iteration takes {duration}", ("benchmark", "duration")),),
            )


RULE = Rule(code="R2B513", find=_find)
