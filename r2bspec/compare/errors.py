"""Errors in results that are to be read or compared."""

from __future__ import annotations

from r2bspec.errors import ExitStatus, R2bspecError


class SamplesMissingError(R2bspecError):
    """Only the result of a run is known, and its samples are needed."""

    code = "R2B661"
    exit_code = ExitStatus.USAGE


class UnreadableResultError(R2bspecError):
    """A file is not a result."""

    code = "R2B662"
    exit_code = ExitStatus.USAGE
    way_out = "Name a run folder or a result.json."


class IncomparableError(R2bspecError):
    """Results that differ in more than their numbers."""

    code = "R2B663"
    exit_code = ExitStatus.USAGE
