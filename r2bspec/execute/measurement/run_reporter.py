"""The functions to which a session and its measurement report their progress."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from r2bspec.execute.host.resource_sampler import HostWatch, ResourceSampler
from r2bspec.execute.progress import Progress


@dataclass(frozen=True)
class RunReporter:
    """Where a session reports phases (name and text), notes and segments.

    `resources` takes samples at requested times; `host` says what other programs did.
    """

    phase: Callable[[str, str], None]
    note: Callable[[str], None]
    segment: Callable[[], None]
    progress: Progress
    resources: ResourceSampler
    host: HostWatch
