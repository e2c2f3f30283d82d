"""All checks, in the order in which they are shown."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from r2bspec.doctor.checkup import CheckResult, System
from r2bspec.doctor.installation import check_native, check_ros, check_vision
from r2bspec.doctor.leftovers import check_leftovers
from r2bspec.doctor.machine import (
    check_datasets,
    check_processor,
    check_shared_memory,
    check_sockets,
)

# The processor first, because the processes that other checks start add to its load.
CHECKS: tuple[Callable[[System], list[CheckResult]], ...] = (
    check_processor,
    check_shared_memory,
    check_sockets,
    check_ros,
    check_native,
    check_vision,
    check_datasets,
    check_leftovers,
)


def examine(system: System) -> Iterator[CheckResult]:
    """Run all checks; yields each result immediately."""
    for check in CHECKS:
        yield from check(system)
