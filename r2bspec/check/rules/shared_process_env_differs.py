"""Nodes in one process that want different values of an environment variable."""

from __future__ import annotations

from collections.abc import Iterator

from r2bspec.check.context import Context
from r2bspec.check.example import example
from r2bspec.check.finding import Finding, Pointer
from r2bspec.check.rule import Rule
from r2bspec.diagnostics.model import Path, Severity


def _find(context: Context) -> Iterator[Finding]:
    if context.spec.graph.placement != "shared":
        return
    first: dict[str, tuple[str, Path]] = {}
    for node in context.wiring.measure.nodes:
        for name, value in node.node.env.items() if node.node.kind == "python" else ():
            path = (*node.path, "env", name)
            wanted, before = first.setdefault(name, (value, path))
            if wanted != value:
                yield Finding(
                    message=f"two nodes of one process want different values of {name}",
                    path=path,
                    help="write 'placement: separate', or the same value for both",
                    related=(Pointer("the other value", before),),
                )


RULE = Rule(
    code="R2B615",
    title="two values of an environment variable in one process",
    severity=Severity.ERROR,
    why="With 'placement: shared' all Python nodes run in one process, and a process has one "
    "environment.",
    failing=example(
        graph="""
            placement: shared
            nodes:
              relay:
                python: r2bspec.nodes.RelayNode
                remappings: {input: image, output: relayed}
                env: {OMP_NUM_THREADS: "1"}
              next:
                python: r2bspec.nodes.RelayNode
                remappings: {input: relayed}
                env: {OMP_NUM_THREADS: "4"}
        """
    ),
    passing=example(
        graph="""
            placement: separate
            nodes:
              relay:
                python: r2bspec.nodes.RelayNode
                remappings: {input: image, output: relayed}
                env: {OMP_NUM_THREADS: "1"}
              next:
                python: r2bspec.nodes.RelayNode
                remappings: {input: relayed}
                env: {OMP_NUM_THREADS: "4"}
        """
    ),
    find=_find,
)
