"""Nodes that wait for /clock, which nothing publishes."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    NodeWiring,
    Path,
    PhaseWiring,
    Rule,
    quote,
)

_CLOCK = "/clock"
_PARAMETER = "use_sim_time"


def _find(context: Context) -> Findings:
    if context.spec.playback.clock:
        return
    for phase in context.wiring.phases:
        for node in phase.nodes:
            place = _place(context, node)
            if place is None or phase.publishers(_CLOCK):
                continue
            path, key = place
            known = not _other_publishers(phase, node)
            yield Finding(
                message=f"{node.key} has {quote('use_sim_time: true')} and waits for /clock, "
                f"which nothing {'' if known else 'known '}publishes",
                path=path,
                key=key,
                help="remove it, or let a node publish /clock"
                if context.spec.live
                else "write 'playback: {clock: true}' to publish it, or remove the parameter",
                severity=None if known else "info",
            )


def _place(context: Context, node: NodeWiring) -> tuple[Path, bool] | None:
    """Where a node is told to use /clock, and whether the key is meant; None if it is not."""
    if node.parameters.get(_PARAMETER) is True:
        path = context.parameter_path(node, _PARAMETER)
        return (path, False) if path is not None else ((*node.path, "parameters"), True)
    launch = node.node.launch
    given = launch.arguments.get(_PARAMETER) if launch is not None else None
    if str(given).lower() == "true":
        return (*node.path, "launch", "arguments", _PARAMETER), False
    return None


def _other_publishers(phase: PhaseWiring, node: NodeWiring) -> bool:
    """Whether another node may publish /clock, because its publishers are unknown."""
    return any(each is not node for each in phase.possible_publishers)


RULE = Rule(code="R2B233", find=_find)
