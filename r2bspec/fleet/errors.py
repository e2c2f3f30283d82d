"""Errors of a fleet."""

from __future__ import annotations

from r2bspec.errors import ExitStatus, R2bspecError, UsageError


class FleetError(R2bspecError):
    """The fleet could not do it; another attempt may help."""

    code = "R2B682"
    way_out = "Run again; 'r2bspec fleet status' shows what the hosts do."


class FleetNotInstalledError(UsageError):
    """The extra `fleet` is not installed."""

    code = "R2B682"


class HostRefusesError(UsageError):
    """This host cannot make a run; another one may."""

    way_out = "Choose other hosts with --hosts; 'r2bspec fleet hosts' shows what each has."


class NoHostError(HostRefusesError):
    """No host of the fleet is what a run requires."""

    code = "R2B683"


class VersionDiffersError(UsageError):
    """Host and client have different versions."""

    code = "R2B684"


class NotAllowedError(HostRefusesError):
    """The owner of a host does not allow what a spec does."""

    code = "R2B685"


class TransferError(FleetError):
    """What arrived is not what was sent."""

    code = "R2B686"
    way_out = "Run again; if that does not help, restart the worker of the host."


class FalseAnswerError(HostRefusesError):
    """What a host says cannot be so; another host makes the run."""

    code = "R2B686"

    def __init__(self, host: str, what: str) -> None:
        super().__init__(
            f"the host {host} does not do what it is asked: {what}",
            hint="Nothing of it is counted. Restart its worker; if that does not help, install "
            "r2bspec anew there, or leave the host out with --hosts.",
        )


class InsecureFleetError(UsageError):
    """A connection beyond this machine without TLS, or unusable certificates."""

    code = "R2B687"


class HostLostError(FleetError):
    """A host left the fleet, or the scheduler did."""

    code = "R2B688"
    way_out = "Start its worker or the scheduler again, and run with --resume."


class HostFullError(FleetError):
    """The disk of a host is full."""

    code = "R2B689"
    exit_code = ExitStatus.RUN_FAILED


class BundleTooLargeError(UsageError):
    """The files of a spec are too many to be sent with it."""

    code = "R2B686"
