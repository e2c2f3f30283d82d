"""All checks, in the order in which they are shown."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from r2bspec.execute.doctor.datasets import check_datasets
from r2bspec.execute.doctor.leftovers import check_leftovers
from r2bspec.execute.doctor.model import Check, System
from r2bspec.execute.doctor.processor import check_processor
from r2bspec.execute.doctor.ros import check_ros
from r2bspec.execute.doctor.shared_memory import check_shared_memory
from r2bspec.execute.doctor.sockets import check_sockets
from r2bspec.execute.doctor.vision import check_vision

# The processor first: what the other checks start would show in its load.
CHECKS: tuple[Callable[[System], list[Check]], ...] = (
    check_processor,
    check_shared_memory,
    check_sockets,
    check_ros,
    check_vision,
    check_datasets,
    check_leftovers,
)


def examine(system: System) -> Iterator[Check]:
    """Make every check; each is yielded as soon as it is made."""
    for check in CHECKS:
        yield from check(system)
