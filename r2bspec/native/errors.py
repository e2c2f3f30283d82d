"""Errors of building native code."""

from __future__ import annotations

from r2bspec.errors import R2bspecError
from r2bspec.exit_status import ExitStatus

NOT_BUILT = "R2B668"


class BuildError(R2bspecError):
    """The native part of the harness cannot be built on this machine."""

    code = NOT_BUILT
    exit_code = ExitStatus.USAGE
