"""CPUs that a machine with the required number of cores may not have."""

from __future__ import annotations

from collections.abc import Iterator

from r2bspec.check.rule_api import Context, Finding, Findings, Path, Rule


def _find(context: Context) -> Findings:
    requires = context.spec.requires
    if requires is None or not requires.cores:
        return
    for path, cpus in _pinned_cpus(context):
        if cpus and max(cpus) >= requires.cores:
            yield Finding(
                message=f"CPU {max(cpus)} is pinned, but a machine with "
                f"{requires.cores} cores is accepted",
                path=path,
                help=f"set 'requires.cores' to {max(cpus) + 1}: CPUs are numbered from 0",
            )


def _pinned_cpus(context: Context) -> Iterator[tuple[Path, tuple[int, ...]]]:
    for name, container in context.spec.containers.items():
        yield ("containers", name, "cpus"), container.cpus
    for _, node in context.nodes:
        yield (*node.path, "cpus"), node.node.cpus


RULE = Rule(code="R2B675", find=_find)
