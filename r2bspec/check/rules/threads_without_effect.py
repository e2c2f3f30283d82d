"""Thread counts of containers whose executor does not use them."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote
from r2bspec.language.spec import Container


def _find(context: Context) -> Findings:
    for name, container in context.spec.containers.items():
        why = _reason(container) if container.threads > 1 else ""
        if why:
            yield Finding(
                message=f"{quote(f'threads: {container.threads}')} of {quote(name)} has no effect: "
                f"{why}",
                path=("containers", name, "threads"),
                help="set 'executor: multi_threaded'"
                if container.executable == "python"
                else "set 'executable: component_container_mt'",
            )


def _reason(container: Container) -> str:
    if container.executable == "component_container_mt":
        return ""
    if container.executable == "python":
        return "" if container.executor == "multi_threaded" else "its executor is single-threaded"
    return f"{container.executable} has no such setting"


RULE = Rule(code="R2B222", find=_find)
