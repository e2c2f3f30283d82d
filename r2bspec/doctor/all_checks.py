"""All checks, in the order in which they are shown."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from r2bspec.doctor import machine
from r2bspec.doctor.checkup import CheckResult, System
from r2bspec.doctor.installation import check_native, check_ros, check_vision
from r2bspec.doctor.leftovers import check_leftovers

# The processor first, because the processes that other checks start add to its load.
CHECKS: tuple[Callable[[System], list[CheckResult]], ...] = (
    machine.check_processor,
    machine.check_shared_memory,
    machine.check_sockets,
    check_ros,
    check_native,
    check_vision,
    machine.check_datasets,
    check_leftovers,
)


def examine(system: System) -> Iterator[CheckResult]:
    """Run all checks, and yield each result immediately."""
    for check in CHECKS:
        yield from check(system)
