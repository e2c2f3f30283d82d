"""Threads of containers that have only one, or cannot be told how many."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example, pluralize, quote
from r2bspec.language.spec import Container


def _find(context: Context) -> Findings:
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
    severity="warning",
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
