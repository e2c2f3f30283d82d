"""All checks, in the order in which they are shown."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from r2bspec.doctor.checkup import CheckResult, System
from r2bspec.doctor.dataset_disk import check_datasets
from r2bspec.doctor.leftovers import check_leftovers
from r2bspec.doctor.native_build import check_native
from r2bspec.doctor.opencv_check import check_vision
from r2bspec.doctor.processor import check_processor
from r2bspec.doctor.ros_installation import check_ros
from r2bspec.doctor.shared_memory import check_shared_memory
from r2bspec.doctor.socket_buffers import check_sockets

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
