"""Errors of plan files."""

from __future__ import annotations

from typing import Final

from r2bspec.errors import R2bspecError
from r2bspec.exit_status import ExitStatus

PLAN_UNREADABLE: Final = "R2B610"
PLAN_FOREIGN: Final = "R2B611"
PLAN_BROKEN: Final = "R2B612"


class PlanError(R2bspecError):
    """A file cannot be used as a plan. The message names the file; `hint` is the remedy."""

    code = PLAN_BROKEN
    exit_code = ExitStatus.USAGE
