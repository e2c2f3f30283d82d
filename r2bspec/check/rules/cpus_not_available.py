"""CPUs that this machine does not have."""

from __future__ import annotations

import os
from collections.abc import Iterator

from r2bspec.check.rule_api import Context, Finding, Findings, Path, Rule


def _find(context: Context) -> Findings:
    available = os.cpu_count() or 1
    for path, cpus in _pinned_cpus(context):
        for index, cpu in enumerate(cpus):
            if cpu >= available:
                yield Finding(
                    message=f"this machine has no CPU {cpu}",
                    path=(*path, index),
                    help=f"its CPUs are numbered from 0 to {available - 1}",
                    machine_dependent=True,
                )


def _pinned_cpus(context: Context) -> Iterator[tuple[Path, tuple[int, ...]]]:
    for name, container in context.spec.containers.items():
        yield ("containers", name, "cpus"), container.cpus
    for _, node in context.nodes:
        yield (*node.path, "cpus"), node.node.cpus


RULE = Rule(code="R2B638", find=_find)
