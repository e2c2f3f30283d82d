"""Parts of the harness whose process in the graph is not decided."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote, quoted_list
from r2bspec.plan.graph_placement import Place, find_places
from r2bspec.plan.process_plans import graph_processes


def _find(context: Context) -> Findings:
    spec, wiring = context.spec, context.wiring
    if spec.harness.placement != "graph":
        return
    if spec.graph.placement == "harness":
        yield Finding(
            message="the nodes are placed in the process of the harness, and the harness in the "
            "processes of the nodes",
            path=("graph", "placement"),
            help="remove one of 'graph.placement: harness' and 'harness.placement: graph'",
        )
        return
    for place in find_places(spec, wiring, graph_processes(spec, wiring)):
        if not place.process:
            yield Finding(
                message=_message(place),
                path=(*place.path, "in") if place.named else place.path,
                help=_help(place),
            )


def _message(place: Place) -> str:
    what = "the player" if place.path == ("harness",) else f"monitor {quote(place.part)}"
    does = "read the inputs" if place.path == ("harness",) else "publish its topic"
    if place.named:
        return f"no process of the graph is, or has a node, named {quote(place.named)}"
    if place.external:
        return f"{what} cannot join a process of the graph: external nodes {does}"
    return f"it is not decided which process gets {what}: several may {does}"


def _help(place: Place) -> str:
    if place.external or not place.choices:
        return "let r2bspec start the nodes, or write 'harness: {placement: separate}'"
    where = "harness" if place.path == ("harness",) else f"monitors.{place.part}"
    return f"set '{where}.in' to one of the processes: {quoted_list(place.choices)}"


RULE = Rule(code="R2B672", find=_find)
