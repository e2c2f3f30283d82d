"""Errors of a fleet."""

from __future__ import annotations

from r2bspec.errors import ExitStatus, R2bspecError, UsageError


class FleetError(R2bspecError):
    """The fleet cannot be used, or what ran on a host failed."""

    code = "R2B682"
    way_out = "The log of its worker has more; run again with --resume."


class NoHostError(UsageError):
    """No host of the fleet is what a run requires."""

    code = "R2B683"


class ArchiveError(UsageError):
    """The files of a spec or a run folder cannot travel."""

    code = "R2B686"
    way_out = "Send fewer or smaller files, or play the spec on the host itself."


class HostLostError(FleetError):
    """The hosts of a run left the fleet, or the scheduler did."""

    code = "R2B688"
    way_out = "Start its worker or the scheduler again, and run with --resume."


class HostRunError(FleetError):
    """A run on a host ended without a result."""

    def __init__(self, message: str, *, status: ExitStatus, code: str, hint: str) -> None:
        super().__init__(message, hint=hint, code=code)
        self.exit_code = status
