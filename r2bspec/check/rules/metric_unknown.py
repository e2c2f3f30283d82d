"""Requirements on unknown metrics or monitors."""

from __future__ import annotations

from r2bspec.check.requirement_metrics import unknown_metrics
from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    Pointer,
    Rule,
    quote,
    quoted_list,
)


def _find(context: Context) -> Findings:
    for each in unknown_metrics(context):
        error = each.error
        yield Finding(
            message=str(error),
            path=each.located.path,
            part=each.located.metric_part,
            help=f"did you mean {quote(error.suggestion)}?"
            if error.suggestion
            else f"known are {quoted_list(error.known)}",
            related=_declaration(error.suggestion, each.located.requirement.text, context),
        )


def _declaration(suggestion: str, written: str, context: Context) -> tuple[Pointer, ...]:
    """The declaration of the suggested monitor."""
    monitor = suggestion.partition(".")[0]
    if monitor not in context.spec.monitors or written.lstrip().startswith(f"{monitor}."):
        return ()
    return (Pointer(f"{quote(monitor)} is declared here", ("monitors", monitor), key=True),)


RULE = Rule(code="R2B501", find=_find)
