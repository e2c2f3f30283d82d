"""Threads of containers that have only one, or cannot be told how many."""

from __future__ import annotations

from collections.abc import Iterator

from r2bspec.check.check_context import Context
from r2bspec.check.example_spec import example
from r2bspec.check.finding import Finding
from r2bspec.check.message_text import pluralize
from r2bspec.check.rule import Rule
from r2bspec.diagnostics.diagnostic import Severity
from r2bspec.diagnostics.quote import quote
from r2bspec.language.spec import Container


def _find(context: Context) -> Iterator[Finding]:
    for name, container in context.spec.containers.items():
        why = _reason(container) if container.threads > 1 else ""
        if why:
            yield Finding(
                message=f"{pluralize(container.threads, 'thread')} of {quote(name)} have no "
                "effect: "
                f"{why}",
                path=("containers", name, "threads"),
                help="write 'executor: multi_threaded'"
                if container.executable == "python"
                else "write 'executable: component_container_mt'",
            )


def _reason(container: Container) -> str:
    if container.executable == "component_container_mt":
        return ""
    if container.executable == "python":
        return "" if container.executor == "multi_threaded" else "its executor has only one"
    return f"{container.executable} cannot be told how many"


RULE = Rule(
    code="R2B222",
    title="a number of threads without effect",
    severity=Severity.WARNING,
    why="Only component_container_mt and Python containers with a multi-threaded executor spin "
    "their nodes with a number of threads.",
    failing=example(
        containers="{perception: {executable: python, threads: 4}}",
        graph="""
            nodes:
              relay:
                python: r2bspec.nodes.RelayNode
                container: perception
                remappings: {input: image}
        """,
    ),
    passing=example(
        containers="{perception: {executable: python, executor: multi_threaded, threads: 4}}",
        graph="""
            nodes:
              relay:
                python: r2bspec.nodes.RelayNode
                container: perception
                remappings: {input: image}
        """,
    ),
    find=_find,
)
