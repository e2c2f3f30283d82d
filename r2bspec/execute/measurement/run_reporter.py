"""What a session and its measurement report while they go on, and to which functions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from r2bspec.execute.host.resource_sampler import ResourceSampler
from r2bspec.execute.progress import Progress


@dataclass(frozen=True)
class RunReporter:
    """Whom a batch tells what it does: of a phase its name and a text, notes, and segments.

    `resources` samples; it is told when.
    """

    phase: Callable[[str, str], None]
    note: Callable[[str], None]
    segment: Callable[[], None]
    progress: Progress
    resources: ResourceSampler
